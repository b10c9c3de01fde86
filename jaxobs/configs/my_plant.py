"""A plant of your own: replace the equations, then `jaxobs design my_plant.py --within u1=-1:1`."""

import jax.numpy as jnp

from jaxobs import Scalar, param
from jaxobs.plants import AbstractChain


class MyPlant(AbstractChain):
    """x1' = x2, x2' = -w^2 sin(x1) - d x2 + u, y = x1: an angle [rad] and its rate [rad/s]."""

    w: Scalar = param(default=1.0)  # 1/s
    d: Scalar = param(default=0.1)  # 1/s
    n = 2
    m = 1

    def phi(self, x, u):
        return -(self.w**2) * jnp.sin(x[0]) - self.d * x[1] + u[0]
