"""The Duffing oscillator whose output mixes both states: paper 001, (40)."""

import jax.numpy as jnp

from jaxobs._module import Scalar, dtype_of, param
from jaxobs.plants.base import AbstractFlowPlant


class Duffing(AbstractFlowPlant):
    """x1' = x2, x2' = -a x1 - b x1^3, y = x1 + x2 (a = b = 1 in the paper); V = x2^2/2 + a x1^2/2 + b x1^4/4 is constant."""

    a: Scalar = param(default=1.0)
    b: Scalar = param(default=1.0)
    n = 2
    m = 0
    p = 1

    def flow(self, t, x, u):
        return jnp.stack([x[1], -self.a * x[0] - self.b * x[0] ** 3])

    def h(self, x, u):
        return x[:1] + x[1:]

    def disturbance_matrix(self):
        return jnp.asarray([[0.0], [1.0]], dtype_of(self))
