"""The Van der Pol oscillator in phase coordinates (a chain) and in Lienard coordinates (triangular)."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param
from jaxobs.plants.forms import AbstractChain, AbstractTriangular


class VanDerPol(AbstractChain):
    """x1' = x2, x2' = mu (1 - x1^2) x2 - x1, y = x1 (named in paper 004, section VI; the output is our choice)."""

    mu: Scalar = param(default=1.0)
    n = 2
    m = 0

    def phi(self, x, u):
        return self.mu * (1 - x[0] ** 2) * x[1] - x[0]


class Lienard(AbstractTriangular):
    """x1' = x2 + mu (x1 - x1^3 / 3), x2' = -x1, y = x1: the same oscillator, with its nonlinearity on the measured state."""

    mu: Scalar = param(default=1.0)
    n = 2
    m = 0

    def a(self, u):
        return jnp.ones((1,), self.mu.dtype)

    def g(self, x, u):
        return jnp.stack([self.mu * (x[0] - x[0] ** 3 / 3), -x[0]])
