"""The high-gain observer in chain coordinates."""

import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Scalar, param
from jaxobs.observers._gains import check_gains, named, powers, require_chain, scaled_poles
from jaxobs.observers.base import AbstractFlowObserver, AbstractModelled
from jaxobs.plants import AbstractChain


class HighGain(AbstractModelled, AbstractFlowObserver):
    """z' = f(z, u) + diag(gamma^i) alphas (y - h(z)), estimate z (paper 000, (6) with (15)).

    model: a chain of n states. alphas (n,): a Hurwitz polynomial. gamma [1/s]: gain scale. ValueError for anything else.
    """

    model: AbstractChain
    alphas: Float[Array, " n"] = param()
    gamma: Scalar = param()

    def __check_init__(self):
        require_chain(self, self.model)
        check_gains(self, self.alphas, self.gamma, self.n, f"n = {self.n} coefficients")

    def gain(self) -> Float[Array, " n"]:
        return named(self.alphas * powers(self.gamma, self.n))

    def error_poles(self) -> np.ndarray | None:
        """The poles of the linear part of the error, where they are concrete."""
        return scaled_poles(self.alphas, self.gamma)

    def init(self, xhat0):
        return xhat0

    def flow(self, t, z, u, y):
        return self.model.flow(t, z, u) + self.gain() * (y - self.model.h(z, u))

    def split(self, t, z, u, y):
        a, b = self.model.split(t, z, u)
        return a.at[:, 0].add(-self.gain()), b + self.gain() * y

    def estimate(self, t, z, u, y):
        return z

    def predict(self, t, z, u):
        return self.model.h(z, u)
