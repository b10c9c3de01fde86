"""The Roessler system, seen through any linear output: named in paper 004, section VI, without an output."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar, dtype_of, param
from jaxobs.plants.forms import AbstractLipschitz, require_output


class Rossler(AbstractLipschitz):
    """x1' = -x2 - x3, x2' = x1 + a x2, x3' = b + x3 (x1 - c), y = output x (a = b = 0.2, c = 5.7: O. E. Roessler, Physics
    Letters A 57 (1976)). output (p, 3), by default y = x2.
    """

    alpha: Scalar = param(default=0.2)
    beta: Scalar = param(default=0.2)
    gamma: Scalar = param(default=5.7)
    output: Float[Array, "p 3"] = param(default=((0.0, 1.0, 0.0),))
    n = 3
    m = 0

    def __check_init__(self):
        require_output(self, self.output)

    @property
    def p(self):
        return self.output.shape[0]

    def a(self):
        zero, one = jnp.zeros_like(self.alpha), jnp.ones_like(self.alpha)
        rows = [[zero, -one, -one], [one, self.alpha, zero], [zero, zero, -self.gamma]]
        return jnp.stack([jnp.stack(row) for row in rows])

    def b(self):
        return jnp.asarray([[0.0], [0.0], [1.0]], dtype_of(self))

    def c(self):
        return self.output

    def f(self, x):
        return x[:1] * x[2:]

    def g(self, y, u):
        zero = jnp.zeros_like(self.beta)
        return jnp.stack([zero, zero, self.beta])
