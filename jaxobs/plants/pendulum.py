"""The inverted pendulum with an accelerated pivot: paper 000, (66)."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param
from jaxobs.plants.forms import AbstractChain


class Pendulum(AbstractChain):
    """x1' = x2, x2' = a sin(x1) + u cos(x1) - b x2, y = x1; angles in rad, time in the paper's units (a = 1, b = 0).

    phi has the Lipschitz constant rho = sup sqrt((a cos x1 - u sin x1)^2 + b^2) = sqrt(a^2 + max|u|^2 + b^2): for a = 1, b = 0
    and |u| <= 1/2 that is sqrt(1.25); the paper takes 3/2.
    """

    a: Scalar = param(default=1.0)
    b: Scalar = param(default=0.0)
    n = 2
    m = 1

    def phi(self, x, u):
        return self.a * jnp.sin(x[0]) + u[0] * jnp.cos(x[0]) - self.b * x[1]
