"""The chain with a sum of sines at its end: the example of paper 002, section IV."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param, require_integer, static
from jaxobs.plants.forms import AbstractChain


class SineChain(AbstractChain):
    """x_i' = x_{i+1}, x_n' = (k_f / n) sum_i sin(x_i), y = x_1; each df/dx_i lies in [-k_f/n, k_f/n] (n = 5, k_f = 1)."""

    k_f: Scalar = param(default=1.0)
    n: int = static(default=5)
    m = 0

    def __check_init__(self):
        require_integer(self, "n", self.n, 1, "It is the number of states.")

    def phi(self, x, u):
        return self.k_f / self.n * jnp.sum(jnp.sin(x))
