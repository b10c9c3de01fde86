"""The time-derivative tracker in discrete time: the fading-memory polynomial filter, with any number of integrators."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Scalar, param, require_positive, require_shape, static
from jaxobs.observers._fading import fading_memory_gain, sampled_matrix, start_up_gain
from jaxobs.observers._gains import named
from jaxobs.observers.base import AbstractStepObserver
from jaxobs.observers.tracker import check_start, check_tracker, signs, start_matrix
from jaxobs.plants.integrator_chain import taylor_step


class DiscreteTracker(AbstractStepObserver):
    """Estimates (y, y', ..., y^(n-1)) from samples, without a model and without delay; sigma = e^{-mu dt}, A~ as in Tracker,

        eta-  = e^{A~ dt} eta + B0 y_{k-1} + B1 y_k            (y on a straight line between its samples)
        eta   = eta- - G_k eta-_1  (q > 0),   eta = eta- + G_k (y_k - eta-_1)  (q = 0)
        G_k   = dt H_k^-1 C~',     H_{k+1} = sigma e^{-A~'dt} H_k e^{-A~ dt} + dt C~'C~.

    This is paper 001, (30) and (33), in the corrected form: y_k enters the estimate at k, the gain is that of H_k, and all
    poles lie at sigma (the printed denominators of (35)-(37) are unstable). start = None takes the steady gain from the
    first sample; otherwise H_0 = start + dt C~'C~ and there is no peaking. Polynomials of degree < n are followed without
    error for q = 0; for q > 0 of degree < 2, and beyond that up to dt^2/12 y'', the cost of the straight lines.

    n >= 1, q >= 0, mu [1/s] > 0, dt [s] > 0 (checked against the data), start > 0 (a number, a diagonal or a matrix, as in
    Tracker) or None.
    """

    n: int = static()
    q: int = static()
    mu: Scalar = param()
    dt: Scalar = param()
    start: Float[Array, "..."] | None = param(default=None)
    m = 0
    p = 1

    def __check_init__(self):
        check_tracker(self)
        require_shape(self, "dt", self.dt, (), "One sampling period.")
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")
        if self.start is not None:
            check_start(self, "H_0 = start + dt C'C; None takes the steady gain at once.")

    def init(self, xhat0):
        eta = jnp.concatenate([jnp.zeros((self.q,), xhat0.dtype), xhat0])
        return eta, jnp.zeros((1,), xhat0.dtype), jnp.zeros((), xhat0.dtype)

    def gain(self, k: Scalar) -> Float[Array, " N"]:
        """G_k in the coordinates of the plain shift (all signs +)."""
        size = self.n + self.q
        decrement = -jnp.expm1(-self.mu * self.dt)  # 1 - sigma
        if self.start is None:
            return named(fading_memory_gain(size, decrement, self.dt))
        rate = decrement / self.dt
        grades = rate ** jnp.arange(size, dtype=rate.dtype)
        scaled = (rate * grades[:, None] * start_matrix(self) * grades[None, :]).at[0, 0].add(decrement)
        column = start_up_gain(sampled_matrix(size, 1 - decrement), scaled, decrement * k, self.mu * self.dt * k)
        return decrement * grades * column

    def _ahead(self, z, y):
        """eta-: the state carried to this sample (at the very first sample there is nothing to carry)."""
        eta, last, count = z
        s = signs(self.n, self.q, eta.dtype)
        order = np.arange(self.q, 0, -1)  # xi_i integrates y - xhat_1 for q - i + 1 times
        whole = jnp.asarray([1 / math.factorial(r) for r in order], eta.dtype)
        ramp = jnp.asarray([1 / math.factorial(r + 1) for r in order], eta.dtype)
        driven = self.dt ** jnp.asarray(order, eta.dtype) * (whole * last + ramp * (y - last))
        carried = (s * taylor_step(s * eta, self.dt)).at[: self.q].add(driven)
        return jnp.where(count > 0, carried, eta)

    def _correct(self, z, y):
        ahead = self._ahead(z, y)
        innovation = y - ahead[:1] if self.q == 0 else -ahead[:1]
        return ahead + signs(self.n, self.q, ahead.dtype) * self.gain(z[2]) * innovation

    def step(self, k, z, u, y):
        return self._correct(z, y), y, z[2] + 1

    def estimate(self, k, z, u, y):
        return self._correct(z, y)[self.q :]

    def predict(self, k, z, u):
        xhat, count = z[0][self.q :], z[2]
        return jnp.where(count > 0, taylor_step(xhat, self.dt), xhat)[:1]
