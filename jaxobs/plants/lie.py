"""Lie derivatives of the output along the flow, and the observability map that they make; for a constant input."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import refuse, require_integer
from jaxobs.plants.base import AbstractFlowPlant

Map = Callable[[Any], Any]


def lie_derivative(h: Map, f: Map) -> Map:
    """L_f h = dh/dx f(x), a function of x: the rate of h along x' = f(x).

    h: x (n,) -> an array of any shape; f: x (n,) -> (n,). Repeated, L_f(L_f h). By forward differentiation: no matrix dh/dx.
    """
    return lambda x: jax.jvp(h, (x,), (f(x),))[1]


def lie_derivatives(plant: AbstractFlowPlant, x: Float[Array, " n"], u: Float[Array, "*m"], order: int) -> Float[Array, "k p"]:
    """(h, L_f h, ..., L_f^order h) at x, (order + 1, p): y and its derivatives where u is constant; the flow is taken at t = 0.

    While u moves, y^(k) also has terms in u', ..., u^(k-1), which are not here. All orders come from one recursion
    H_{k+1} = (h, L_f H_k), whose program doubles with each order: fine up to about 8.

    ValueError for an order that is no integer >= 0. Source: Isidori, Nonlinear Control Systems, 1995, section 1.2.
    """
    require_integer("lie_derivatives", "order", order, 0, "It counts differentiations along the flow.")
    t = jnp.zeros((), x.dtype)

    def field(x):
        return plant.flow(t, x, u)

    def extended(inner):
        def outer(x):
            values, slopes = jax.jvp(inner, (x,), (field(x),))
            return jnp.concatenate([values[:1], slopes])

        return outer

    current = lambda x: plant.h(x, u)[None]  # noqa: E731
    for _ in range(order):
        current = extended(current)
    return current(x)


def observability_map(
    plant: AbstractFlowPlant, x: Float[Array, " n"], u: Float[Array, "*m"], indices: tuple[int, ...] | None = None
) -> Float[Array, " n"]:
    """Phi(x, u) = (h_1, L_f h_1, ..., L_f^{r_1 - 1} h_1, h_2, ...), (n,), for constant u.

    indices (r_1, ..., r_p), r_1 + ... + r_p = n: how many derivatives of each output are taken; (n,) for one output, else to
    be given (`jaxobs.structure.observability` chooses them). x is told by y and its derivatives, locally, where dPhi/dx has
    full rank. ValueError for indices of another sum.

    Source: Gauthier, Hammouri and Othman, 1992; Isidori, Nonlinear Control Systems, 1995, section 5.1 (several outputs).
    """
    chosen = indices_of("observability_map", plant, indices)
    rows = lie_derivatives(plant, x, u, max(chosen) - 1)
    return jnp.concatenate([rows[:r, i] for i, r in enumerate(chosen)])


def indices_of(owner: str, plant: AbstractFlowPlant, indices: tuple[int, ...] | None) -> tuple[int, ...]:
    """(r_1, ..., r_p) with sum n; the only choice for one output if None."""
    if indices is None and plant.p == 1:
        return (plant.n,)
    fix = "jaxobs.structure.observability(plant, states=...).indices is a choice whose map has the most rank."
    if indices is None or len(indices) != plant.p or any(r < 0 for r in indices) or sum(indices) != plant.n:
        raise refuse(owner, "indices", indices, f"{plant.p} integers >= 0 with the sum n = {plant.n}", fix)
    return tuple(indices)
