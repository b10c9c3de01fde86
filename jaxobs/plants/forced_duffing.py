"""The forced Duffing oscillator of paper 004, example 1 (paper 001 has another one, `Duffing`)."""

import jax.numpy as jnp

from jaxobs._module import Scalar, dtype_of, param
from jaxobs.plants.forms import AbstractLipschitz


class ForcedDuffing(AbstractLipschitz):
    """x1' = x2, x2' = -delta x2 - x1^3 + u, y = 0.2 x1 + x2; in the paper delta = 0.1, u = 11 cos t."""

    delta: Scalar = param(default=0.1)
    n = 2
    m = 1
    p = 1

    def a(self):
        zero, one = jnp.zeros_like(self.delta), jnp.ones_like(self.delta)
        return jnp.stack([jnp.stack([zero, one]), jnp.stack([zero, -self.delta])])

    def b(self):
        return jnp.asarray([[0.0], [-1.0]], dtype_of(self))

    def c(self):
        return jnp.asarray([[0.2, 1.0]], dtype_of(self))

    def f(self, x):
        return x[:1] ** 3

    def g(self, y, u):
        return jnp.stack([jnp.zeros_like(u[0]), u[0]])
