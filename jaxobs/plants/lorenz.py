"""The Lorenz system. Its Euler map of paper 004, example 3, is Discretised(Lorenz(), Euler(), 0.001)."""

import jax.numpy as jnp

from jaxobs._module import Scalar, dtype_of, param
from jaxobs.plants.forms import AbstractLipschitz


class Lorenz(AbstractLipschitz):
    """x1' = s (x2 - x1), x2' = r x1 - x2 - x1 x3, x3' = x1 x2 - b x3, y = x2 (s = 10, r = 28, b = 8/3 in paper 004)."""

    sigma: Scalar = param(default=10.0)
    rho: Scalar = param(default=28.0)
    beta: Scalar = param(default=8 / 3)
    n = 3
    m = 0
    p = 1

    def a(self):
        zero, one = jnp.zeros_like(self.sigma), jnp.ones_like(self.sigma)
        rows = [[-self.sigma, self.sigma, zero], [self.rho, -one, zero], [zero, zero, -self.beta]]
        return jnp.stack([jnp.stack(row) for row in rows])

    def b(self):
        return jnp.asarray([[0.0, 0.0], [-1.0, 0.0], [0.0, 1.0]], dtype_of(self))

    def c(self):
        return jnp.asarray([[0.0, 1.0, 0.0]], dtype_of(self))

    def f(self, x):
        return x[0] * jnp.stack([x[2], x[1]])

    def g(self, y, u):
        return jnp.zeros((3,), y.dtype)
