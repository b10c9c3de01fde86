"""A chain whose coupling is the input: what can be seen depends on u (paper 003, example 1, (24))."""

import jax.numpy as jnp

from jaxobs._module import dtype_of
from jaxobs.plants.forms import AbstractStateAffine


class GatedChain(AbstractStateAffine):
    """x1' = u x2, x2' = 0, y = x1: x2 is seen only while u is away from zero."""

    n = 2
    m = 1
    p = 1

    def a(self, u):
        return jnp.zeros((2, 2), u.dtype).at[0, 1].set(u[0])

    def b(self, u):
        return jnp.zeros((2,), u.dtype)

    def c(self):
        return jnp.asarray([[1.0, 0.0]], dtype_of(self))
