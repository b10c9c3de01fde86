"""The observer that puts the measured state into phi: where phi knows only y and u, its error is exactly linear."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import concrete, param, require_finite, require_shape
from jaxobs.observers._gains import require_chain
from jaxobs.observers.base import AbstractFlowObserver, AbstractModelled
from jaxobs.plants import AbstractChain


class OutputInjection(AbstractModelled, AbstractFlowObserver):
    """z' = A z + B phi(y, u) + L (y - C z), estimate z, for a chain x' = A x + B phi(y, u), y = C x.

    The error obeys e' = (A - L C) e whatever phi is: any Hurwitz gain will do, large or small, and no Lipschitz constant is
    needed (Krener and Isidori 1983; paper 000, (66) is of this kind). If phi knows other states too, they are taken from z, and
    only the slope of phi along x_1 has left the error. Noise in y then passes through phi as well.

    model: a chain of n states. gain L (n, 1), finite. Through Sampled for recorded data.
    """

    model: AbstractChain
    gain: Float[Array, "n p"] = param()

    def __check_init__(self):
        require_chain(self, self.model)
        require_shape(self, "gain", self.gain, (self.model.n, 1), "One row a state, one column: [[l1], [l2], ...].")
        require_finite(self, "gain", self.gain)

    def error_poles(self) -> np.ndarray | None:
        """The poles of the error, where they are concrete."""
        known = concrete(self.gain)
        return None if known is None else np.roots([1.0, *known[:, 0].astype(float)])

    def init(self, xhat0):
        return xhat0

    def _seen(self, z, y):
        """(y, z_2, ..., z_n): the flow of a chain uses x_1 in phi only."""
        return jnp.concatenate([y, z[1:]])

    def flow(self, t, z, u, y):
        return self.model.flow(t, self._seen(z, y), u) + self.gain[:, 0] * (y - self.model.h(z, u))

    def split(self, t, z, u, y):
        a, b = self.model.split(t, self._seen(z, y), u)
        return a.at[:, 0].add(-self.gain[:, 0]), b + self.gain[:, 0] * y

    def estimate(self, t, z, u, y):
        return z

    def predict(self, t, z, u):
        return self.model.h(z, u)
