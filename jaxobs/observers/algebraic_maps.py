"""Maps from the output's derivatives to the state: the two of the Duffing oscillator, and rational ones of any system."""

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import param, refuse, require_instance, require_positive, require_shape, static
from jaxobs.observers.algebraic import AbstractAlgebraicMap
from jaxobs.plants import AbstractFlowPlant, Duffing


class DuffingRoot(AbstractAlgebraicMap):
    """x1 = the one real root of b x1^3 + (1 + a) x1 = y - y',    x2 = y - x1     (paper 001, (40); a = b = 1 there).

    With c = 1 + a: x1 = 2 sqrt(c / (3 b)) sinh(asinh((3 / (2 c)) sqrt(3 b / c) (y - y')) / 3). Needs one derivative and is
    defined everywhere: the left side increases with x1. b > 0 and a > -1.
    """

    model: Duffing
    order = 1
    input_order = 0

    def __check_init__(self):
        require_instance(self, "model", self.model, Duffing, "It is the map of this one plant; see jaxobs.designs.eliminate.")
        require_positive(self, "model", self.model.b, "b > 0: for b = 0 the system is linear, x1 = (y - y') / (1 + a).")
        require_positive(self, "model", 1 + self.model.a, "1 + a > 0: else the cubic has several roots.")

    def state(self, y, u):
        b, c = self.model.b, 1 + self.model.a
        size = jnp.sqrt(c / (3 * b))
        x1 = 2 * size * jnp.sinh(jnp.arcsinh(1.5 / (c * size) * (y[0] - y[1])) / 3)
        return jnp.stack([x1, y[0] - x1])

    def denominators(self, y, u):
        return jnp.ones((2,), y.dtype)


class DuffingRational(AbstractAlgebraicMap):
    """x1 = (9 b y^2 (y - y') - 2 c d) / (4 c^2 + 9 b c y^2 - 3 b y d),   x2 = y - x1,  c = 1 + a,  d = y'' + 2 y' + (a - 2) y.

    Paper 001, (41), corrected (a = b = 1 there: the denominator is 16 + 18 y^2 - 3 y d). On the system's own trajectories the
    denominator is 4 c^2 + 9 b c y^2 + 6 b c y x1 + 9 (b y x1)^2 > 0; with errors in the derivatives it may vanish.
    """

    model: Duffing
    order = 2
    input_order = 0

    def __check_init__(self):
        require_instance(self, "model", self.model, Duffing, "It is the map of this one plant; see jaxobs.designs.eliminate.")

    def state(self, y, u):
        b, c = self.model.b, 1 + self.model.a
        x1 = (9 * b * y[0] ** 2 * (y[0] - y[1]) - 2 * c * self._d(y)) / self.denominators(y, u)[0]
        return jnp.stack([x1, y[0] - x1])

    def denominators(self, y, u):
        b, c = self.model.b, 1 + self.model.a
        bottom = 4 * c**2 + 9 * b * c * y[0] ** 2 - 3 * b * y[0] * self._d(y)
        return jnp.stack([bottom, jnp.ones_like(bottom)])

    def _d(self, y):
        return y[2] + 2 * y[1] + (self.model.a - 2) * y[0]


class RationalMap(AbstractAlgebraicMap):
    """x_i = N_i(v) / D_i(v),    v = (y, ..., y^(order), u_1, u_1', ..., u_1^(input_order), u_2, ...).

    A polynomial is sum_k coefficients_k prod_j v_j^{exponents_kj}; `exponents` holds a table of integers for each of N_1, D_1,
    N_2, D_2, ..., `coefficients` the numbers beside all their rows, one after the other. jaxobs.designs.eliminate makes them.
    """

    model: AbstractFlowPlant
    order: int = static()
    input_order: int = static()
    exponents: tuple[tuple[tuple[int, ...], ...], ...] = static()
    coefficients: Float[Array, " K"] = param()

    def __check_init__(self):
        n, fix = self.model.n, "Make the map with jaxobs.designs.eliminate."
        if len(self.exponents) != 2 * n:
            expected = f"{2 * n}: numerator and denominator of each of {n} states"
            raise refuse(self, "exponents", f"{len(self.exponents)} tables", expected, fix)
        width = self.order + 1 + self.model.m * (self.input_order + 1)
        for table in self.exponents:
            require_shape(self, "exponents", np.asarray(table), (len(table), width), "One exponent for each variable.")
        require_shape(
            self, "coefficients", self.coefficients, (sum(map(len, self.exponents)),), "One for each row of exponents."
        )

    def state(self, y, u):
        values = self._polynomials(y, u)
        return values[::2] / values[1::2]

    def denominators(self, y, u):
        return self._polynomials(y, u)[1::2]

    def _polynomials(self, y: Float[Array, " d"], u: Float[Array, "m r"]) -> Float[Array, " _"]:
        """(N_1, D_1, N_2, D_2, ...)."""
        v = jnp.concatenate([y[: self.order + 1], u[:, : self.input_order + 1].reshape(-1)])
        sums, used = [], 0
        for table in self.exponents:
            numbers = self.coefficients[used : used + len(table)]
            monomials = [math.prod((v[j] ** e for j, e in enumerate(row) if e), start=jnp.ones_like(v[0])) for row in table]
            sums.append(numbers @ jnp.stack(monomials))
            used += len(table)
        return jnp.stack(sums)
