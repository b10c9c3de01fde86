"""The q-integral high-gain observer, in its bounded form."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Scalar, param, require_integer, static
from jaxobs.observers._gains import check_gains, named, powers, require_chain, scaled_poles
from jaxobs.observers.base import AbstractFlowObserver, AbstractModelled
from jaxobs.plants import AbstractChain


class IntegralHighGain(AbstractModelled, AbstractFlowObserver):
    """The innovation passes q integrators before it is injected; with a_i = alphas_i gamma^i and z = (eps, xhat),

        eps_i'  = eps_{i+1} - a_i eps_1  (i < q),      eps_q' = (y - xhat_1) - a_q eps_1
        xhat_j' = (xhat_{j+1} or phi(xhat, u)) + a_{q+j} eps_1.

    For q = 0, eps_1 is y - xhat_1: the plain high-gain observer. Equal to paper 000, (40), with eps = xi - xihat; the printed
    form integrates y itself q times and drifts away. (Paper 001, (3), has the same structure.)

    model: a chain of n states. alphas (n + q,): a Hurwitz polynomial. gamma [1/s]: gain scale. q: integer >= 0. eps(0) = 0.
    """

    model: AbstractChain
    alphas: Float[Array, " N"] = param()
    gamma: Scalar = param()
    q: int = static(default=1)

    def __check_init__(self):
        require_chain(self, self.model)
        require_integer(self, "q", self.q, 0, "It counts the integrators between innovation and injection.")
        what = f"n + q = {self.n} + {self.q} coefficients"
        check_gains(self, self.alphas, self.gamma, self.n + self.q, what)

    def gain(self) -> Float[Array, " N"]:
        return named(self.alphas * powers(self.gamma, self.n + self.q))

    def error_poles(self) -> np.ndarray | None:
        """The poles of the linear part of the error, where they are concrete."""
        return scaled_poles(self.alphas, self.gamma)

    def init(self, xhat0):
        return jnp.concatenate([jnp.zeros((self.q,), xhat0.dtype), xhat0])

    def flow(self, t, z, u, y):
        eps, xhat = z[: self.q], z[self.q :]
        innovation = y - self.model.h(xhat, u)
        chain = jnp.concatenate([eps[1:], innovation]) if self.q else eps
        injected = eps[:1] if self.q else innovation
        return jnp.concatenate([chain, self.model.flow(t, xhat, u)]) + signed(self.gain(), self.q) * injected

    def split(self, t, z, u, y):
        q = self.q
        a, b = self.model.split(t, z[q:], u)
        linear = jnp.zeros((q + self.n, q + self.n), a.dtype).at[q:, q:].set(a)
        linear = linear.at[:q, :q].set(jnp.eye(q, k=1, dtype=a.dtype))
        linear = linear.at[:, 0].add(signed(self.gain(), q) if q else -self.gain())
        if q == 0:
            return linear, b + self.gain() * y
        return linear.at[q - 1, q].add(-1), jnp.concatenate([jnp.zeros((q - 1,), b.dtype), y, b])

    def estimate(self, t, z, u, y):
        return z[self.q :]

    def predict(self, t, z, u):
        return self.model.h(z[self.q :], u)


def signed(gain: Float[Array, " N"], q: int) -> Float[Array, " N"]:
    """How eps_1 acts: -a_i on the q integrators, +a_{q+j} on the estimate."""
    return jnp.concatenate([-gain[:q], gain[q:]])
