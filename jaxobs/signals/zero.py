"""No input."""

import jax.numpy as jnp

from jaxobs._module import require_integer, static
from jaxobs.signals.base import AbstractSignal


class Zero(AbstractSignal):
    """u(t) = 0 in R^m; m = 0 for plants without inputs."""

    m: int = static(default=0)

    def __check_init__(self):
        require_integer(self, "m", self.m, 0, "It is the number of inputs of the plant.")

    def __call__(self, t):
        return jnp.zeros((self.m,), jnp.result_type(t))
