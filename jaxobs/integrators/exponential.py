"""The exponential Runge-Kutta method of Cox and Matthews: the stiff linear part exactly, the rest at order 4."""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Module, Scalar, refuse, require_integer, static
from jaxobs.integrators.base import AbstractIntegrator, repeat
from jaxobs.linalg import phi_functions


class Exponential(AbstractIntegrator):
    """ETDRK4 for z' = A z + b(t, z), with N = b, phi_k at A h (phi_1 at A h/2 in the stages) and

        a = e^{Ah/2} z + h/2 phi_1 N_z,    b = e^{Ah/2} z + h/2 phi_1 N_a,    c = e^{Ah/2} a + h/2 phi_1 (2 N_b - N_z)
        z+ = e^{Ah} z + h [(phi_1 - 3 phi_2 + 4 phi_3) N_z + 2 (phi_2 - 2 phi_3) (N_a + N_b) + (4 phi_3 - phi_2) N_c].

    Exact when b is constant, whatever the gain: a held measurement of a linear observer. Needs an observer with `split`; a
    part without a linear part (the plant) is advanced by classical RK4. The matrices are made once, in balanced
    coordinates; the grid must be uniform. Source: Cox and Matthews, J. Comput. Phys. 176 (2002), eqs (26)-(29).
    """

    substeps: int = static(default=1)
    needs_uniform_grid: ClassVar[bool] = True

    def __check_init__(self):
        require_integer(self, "substeps", self.substeps, 1, "It counts the steps in one grid interval.")

    def prepare(self, field, dt, z):
        if field.split is None:
            raise refuse(self, "field", "an observer or plant without split", "one with split", "Use RK4 or Adaptive for it.")
        linear, _ = field.split(jnp.zeros_like(dt), z)
        return jax.tree.map(lambda a, _: _weights(a, dt / self.substeps), linear, z, is_leaf=lambda a: a is None)

    def step(self, field, cache, t, dt, z):
        h = dt / self.substeps

        def n(t, z):
            return field.split(t, z)[1]  # pyright: ignore[reportOptionalCall]: prepare has refused None

        def each(rule, *states):
            return jax.tree.map(rule, cache, *states, is_leaf=lambda w: isinstance(w, _Weights))

        def advance(t, z):
            n_z = n(t, z)
            a = each(_Weights.half, z, n_z)
            n_a = n(t + h / 2, a)
            b = each(_Weights.half, z, n_a)
            n_b = n(t + h / 2, b)
            c = each(_Weights.half, a, jax.tree.map(lambda n_b, n_z: 2 * n_b - n_z, n_b, n_z))
            return each(_Weights.whole, z, n_z, n_a, n_b, n(t + h, c))

        return repeat(advance, self.substeps, t, dt, z)


class _Weights(Module):
    """The coefficients of one leaf: matrices, or scalars where A = 0."""

    e: Float[Array, "*a"]  # e^{Ah}
    half_e: Float[Array, "*a"]  # e^{Ah/2}
    half_n: Float[Array, "*a"]  # h/2 phi_1(Ah/2)
    n_z: Float[Array, "*a"]
    n_ab: Float[Array, "*a"]
    n_c: Float[Array, "*a"]

    def half(self, z, n):
        return _apply(self.half_e, z) + _apply(self.half_n, n)

    def whole(self, z, n_z, n_a, n_b, n_c):
        return _apply(self.e, z) + _apply(self.n_z, n_z) + _apply(self.n_ab, n_a + n_b) + _apply(self.n_c, n_c)


def _apply(coefficient: Array, vector: Array) -> Array:
    return coefficient @ vector if coefficient.ndim == 2 else coefficient * vector


def _weights(a: Float[Array, "n n"] | None, h: Scalar) -> _Weights:
    if a is None:
        one = jnp.ones_like(h)
        return _Weights(one, one, h / 2, h / 6, h / 3, h / 6)
    e, phi1, phi2, phi3 = phi_functions(a * h, 3)
    half_e, half_phi1 = phi_functions(a * h / 2, 1)
    return _Weights(
        e, half_e, h / 2 * half_phi1, h * (phi1 - 3 * phi2 + 4 * phi3), h * 2 * (phi2 - 2 * phi3), h * (4 * phi3 - phi2)
    )
