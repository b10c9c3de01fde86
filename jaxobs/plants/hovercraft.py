"""A craft located in the plane, with a thruster of unknown strength: two outputs, five states, seen block by block."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param
from jaxobs.plants.forms import AbstractBlockTriangular


class Hovercraft(AbstractBlockTriangular):
    """Position r and velocity v in R^2, thrust strength s; u = (throttle, heading), y = r:

        r' = v,      v' = throttle (cos heading, sin heading) s - drag v / sqrt(1 + |v|^2),      s' = 0

    with blocks (2, 2, 1). The strength can be seen only while the throttle is open: A_2(u) = throttle (cos, sin)' has rank 1
    there and rank 0 otherwise. The drag has the Lipschitz constant `drag` [1/s]. A plant of ours for paper 003, (4) and (25).
    """

    drag: Scalar = param(default=0.5)
    blocks = (2, 2, 1)
    m = 2

    def a(self, u):
        direction = jnp.stack([jnp.cos(u[1]), jnp.sin(u[1])])
        return jnp.eye(2, dtype=u.dtype), u[0] * direction[:, None]

    def g(self, x, u):
        v = x[2:4]
        slowed = -self.drag * v / jnp.sqrt(1 + jnp.sum(v**2))
        return jnp.concatenate([jnp.zeros_like(v), slowed, jnp.zeros_like(x[4:])])
