"""The chain of integrators: no model at all, for differentiation."""

import math

import jax.numpy as jnp

from jaxobs._module import Scalar, dtype_of, param, require_integer, require_positive, static
from jaxobs.plants.base import AbstractStepPlant
from jaxobs.plants.forms import AbstractChain


class IntegratorChain(AbstractChain):
    """x_i' = x_{i+1}, x_n' = 0, y = x_1 (paper 001, (1), without its unknown input)."""

    n: int = static()
    m = 0

    def __check_init__(self):
        require_integer(self, "n", self.n, 1, "It is the number of states: the signal and its n - 1 derivatives.")

    def phi(self, x, u):
        return jnp.zeros_like(x[0])


class SampledChain(AbstractStepPlant):
    """x+ = exp(A dt) x, y = x_1: the same chain over one sampling period, exactly (a Taylor step)."""

    n: int = static()
    dt: Scalar = param()
    m = 0
    p = 1

    def __check_init__(self):
        require_integer(self, "n", self.n, 1, "It is the number of states: the signal and its n - 1 derivatives.")
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")

    def step(self, k, x, u):
        return taylor_step(x, self.dt)

    def h(self, x, u):
        return x[:1]

    def disturbance_matrix(self):
        """A jump of the last derivative."""
        return jnp.zeros((self.n, 1), dtype_of(self)).at[-1].set(1)


def taylor_step(x, dt):
    """exp(A dt) x: (sum_j dt^j / j! x_{i+j})_i."""
    n = x.shape[0]
    weights = [dt**j / math.factorial(j) for j in range(n)]
    return jnp.stack([sum(weights[j] * x[i + j] for j in range(n - i)) for i in range(n)])
