"""The Van der Pol oscillator in phase coordinates (a chain, or with any output) and in Lienard coordinates (triangular)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar, param
from jaxobs.plants.forms import AbstractChain, AbstractLipschitz, AbstractTriangular, require_output


class VanDerPol(AbstractChain):
    """x1' = x2, x2' = mu (1 - x1^2) x2 - x1, y = x1 (named in paper 004, section VI; the output is our choice)."""

    mu: Scalar = param(default=1.0)
    n = 2
    m = 0

    def phi(self, x, u):
        return self.mu * (1 - x[0] ** 2) * x[1] - x[0]


class Lienard(AbstractTriangular):
    """x1' = x2 + mu (x1 - x1^3 / 3), x2' = -x1, y = x1: the same oscillator, with its nonlinearity on the measured state."""

    mu: Scalar = param(default=1.0)
    n = 2
    m = 0

    def a(self, u):
        return jnp.ones((1,), self.mu.dtype)

    def g(self, x, u):
        return jnp.stack([self.mu * (x[0] - x[0] ** 3 / 3), -x[0]])


class VanDerPolSeen(AbstractLipschitz):
    """x1' = x2, x2' = mu (1 - x1^2) x2 - x1, y = output x: the form of paper 004, which names the oscillator without an output.

    output (p, 2), by default y = x1.
    """

    mu: Scalar = param(default=1.0)
    output: Float[Array, "p 2"] = param(default=((1.0, 0.0),))
    n = 2
    m = 0

    def __check_init__(self):
        require_output(self, self.output)

    @property
    def p(self):
        return self.output.shape[0]

    def a(self):
        zero, one = jnp.zeros_like(self.mu), jnp.ones_like(self.mu)
        return jnp.stack([jnp.stack([zero, one]), jnp.stack([-one, self.mu])])

    def b(self):
        return jnp.stack([jnp.zeros_like(self.mu), -self.mu])[:, None]

    def c(self):
        return self.output

    def f(self, x):
        return x[:1] ** 2 * x[1:]

    def g(self, y, u):
        return jnp.zeros((2,), self.mu.dtype)
