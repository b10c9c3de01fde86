"""Explicit one-step methods at a fixed step."""

from typing import ClassVar

import jax

from jaxobs._module import require_integer, static
from jaxobs.integrators.base import AbstractIntegrator, axpy, repeat


class Euler(AbstractIntegrator):
    """z+ = z + dt f(t, z). Order 1; stable on z' = -lambda z for lambda dt < 2."""

    substeps: int = static(default=1)
    stability_limit: ClassVar[float | None] = 2.0
    stability_order: ClassVar[int | None] = 1

    def __check_init__(self):
        require_integer(self, "substeps", self.substeps, 1, "It counts the steps in one grid interval.")

    def prepare(self, field, dt, z):
        return None

    def step(self, field, cache, t, dt, z):
        h = dt / self.substeps
        return repeat(lambda t, z: axpy(h, field.flow(t, z), z), self.substeps, t, dt, z)


class RK4(AbstractIntegrator):
    """The classical Runge-Kutta method. Order 4; stable on z' = -lambda z for lambda dt < 2.785."""

    substeps: int = static(default=1)
    stability_limit: ClassVar[float | None] = 2.785
    stability_order: ClassVar[int | None] = 4

    def __check_init__(self):
        require_integer(self, "substeps", self.substeps, 1, "It counts the steps in one grid interval.")

    def prepare(self, field, dt, z):
        return None

    def step(self, field, cache, t, dt, z):
        h = dt / self.substeps

        def advance(t, z):
            k1 = field.flow(t, z)
            k2 = field.flow(t + h / 2, axpy(h / 2, k1, z))
            k3 = field.flow(t + h / 2, axpy(h / 2, k2, z))
            k4 = field.flow(t + h, axpy(h, k3, z))
            return jax.tree.map(lambda z, a, b, c, d: z + h / 6 * (a + 2 * (b + c) + d), z, k1, k2, k3, k4)

        return repeat(advance, self.substeps, t, dt, z)
