"""The q-integral observer in discrete time, in its bounded form, for the Euler model of a chain."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar, param, require_integer, require_positive, require_shape, static
from jaxobs.observers._gains import require_chain
from jaxobs.observers.base import AbstractModelled, AbstractStepObserver
from jaxobs.observers.integral import signed
from jaxobs.plants import AbstractChain


class StepIntegral(AbstractModelled, AbstractStepObserver):
    """Euler of the q-integral observer: with f the plant's flow, L = (l_1, ..., l_{q+n}) and z = (eps, xhat),

        eps_i+  = eps_i + dt eps_{i+1} - l_i eps_1  (i < q),      eps_q+ = eps_q + dt (y - xhat_1) - l_q eps_1
        xhat_j+ = xhat_j + dt f_j(xhat, u) + l_{q+j} eps_1.

    eps is the error of the q integrals of y, so that (eps, x - xhat) obeys e+ = (I + dt A~ - L C~) e + dt B (phi - phihat), the
    augmented (54); the printed form integrates y itself q times and drifts away. L = dt Z(gamma) C~' makes it the digital form
    of paper 000, (40); L = X^-1 C~' that of the augmented (51). For q = 0, eps_1 is y - xhat_1: StepLuenberger on the Euler
    model.

    model: a chain of n states. gain L (n + q,). dt [s]: the sampling period (checked against the data). q: integer >= 0.
    eps(0) = 0. ValueError for anything else.
    """

    model: AbstractChain
    gain: Float[Array, " N"] = param()
    dt: Scalar = param()
    q: int = static(default=1)

    def __check_init__(self):
        require_chain(self, self.model)
        require_integer(self, "q", self.q, 0, "It counts the integrators between innovation and injection.")
        fix = "One gain for each integrator, then one for each state."
        require_shape(self, "gain", self.gain, (self.model.n + self.q,), fix)
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")

    def init(self, xhat0):
        return jnp.concatenate([jnp.zeros((self.q,), xhat0.dtype), xhat0])

    def step(self, k, z, u, y):
        eps, xhat = z[: self.q], z[self.q :]
        innovation = y - self.model.h(xhat, u)
        chain = jnp.concatenate([eps[1:], innovation]) if self.q else eps
        injected = eps[:1] if self.q else innovation
        t = jnp.asarray(k, self.dt.dtype) * self.dt
        drift = jnp.concatenate([chain, self.model.flow(t, xhat, u)])
        return z + self.dt * drift + signed(self.gain, self.q) * injected

    def estimate(self, k, z, u, y):
        return z[self.q :]

    def predict(self, k, z, u):
        return self.model.h(z[self.q :], u)
