"""Observability for every input: is a plant in the normal form (4) of paper 003, and do its couplings stay away from zero?"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import dtype_of, refuse, require_integer
from jaxobs.plants import AbstractBlockTriangular, AbstractFlowPlant

Box = tuple[Sequence[float] | np.ndarray, Sequence[float] | np.ndarray]
LOST = 1e-12  # a singular value, or a coupling, below this share of the largest entry of the Jacobian counts as zero


@dataclasses.dataclass(frozen=True)
class Structure:
    """What `structure` saw at `count` points. F_i depends on x_1, ..., x_{i+1} only where `triangular`.

    lower, upper (n - 1,): of dF_i/dx_{i+1} (for blocks: of the singular values of dF_i/dx_{i+1}, the lowest and the highest).
    slopes (n, n): the largest |dF_i/dx_j|, j <= i. uniformly_observable: triangular, y = x_1, and no coupling that vanishes or
    changes its sign. A counterexample is proof; its absence on `count` points is none.
    """

    triangular: bool
    uniformly_observable: bool
    lower: np.ndarray
    upper: np.ndarray
    slopes: np.ndarray
    count: int
    why: str


@eqx.filter_jit
def _jacobians(plant: Any, xs: Any, us: Any) -> tuple[Any, Any]:
    def at(x, u):
        flow = jax.jacfwd(lambda x: plant.flow(jnp.zeros((), x.dtype), x, u))(x)
        return flow, jax.jacfwd(lambda x: plant.h(x, u))(x)

    return jax.vmap(at)(xs, us)


def structure(
    plant: AbstractFlowPlant, *, states: Box, inputs: Box | None = None, count: int = 256, seed: int = 0
) -> Structure:
    """The pattern of dF/dx on `count` random points and the corners of the box of inputs (paper 003, (4)-(5)):

        dF_i/dx_j = 0 for j > i + 1,      y = x_1,      dF_i/dx_{i+1} != 0 and of one sign.

    states, inputs: (lowest, highest), each (n,) and (m,), in the units of x and u; the latter needed if m > 0. With more than
    10 inputs only the lowest and the highest corner are taken; at the corners, too, x is random. count: random points, seed:
    theirs. A coupling that takes both signs vanishes in between, so some input hides the states behind it. Block triangular
    plants are judged by (5): the rank of each dF_i/dx_{i+1}. The flow is taken at t = 0.

    ValueError for boxes of another size, not finite or with lowest > highest, and count < 1. Source: paper 003, (4)-(5);
    Gauthier and Kupka, 1994 (observability for every input).
    """
    require_integer("structure", "count", count, 1, "It is the number of random points.")
    low, high = _box("states", states, plant.n)
    u_low, u_high = _box("inputs", ((), ()) if inputs is None else inputs, plant.m)
    rng = np.random.default_rng(seed)
    corners = list(itertools.product(*zip(u_low, u_high, strict=True))) if plant.m <= 10 else [u_low, u_high]
    us = np.concatenate([rng.uniform(u_low, u_high, (count, plant.m)), np.reshape(corners, (len(corners), plant.m))])
    xs = rng.uniform(low, high, (len(us), plant.n))
    dtype = dtype_of(plant)
    flow, output = (np.asarray(j, float) for j in _jacobians(plant, jnp.asarray(xs, dtype), jnp.asarray(us, dtype)))
    blocks = tuple(plant.blocks) if isinstance(plant, AbstractBlockTriangular) else (1,) * plant.n
    owner = np.repeat(np.arange(len(blocks)), blocks)
    slopes = np.where(owner[:, None] >= owner[None, :], np.max(np.abs(flow), axis=0), 0.0)
    scale = float(np.max(np.abs(flow)))
    lower, upper = _couplings(flow, blocks)

    def found(triangular: bool, observable: bool, why: str) -> Structure:
        return Structure(triangular, observable, lower, upper, slopes, len(us), why)

    beyond = (owner[None, :] > owner[:, None] + 1) & (flow != 0)
    if np.any(beyond):
        k, i, j = (int(v) for v in np.argwhere(beyond)[0])
        where = f"{flow[k, i, j]:.6g} at x = {_row(xs[k])}, u = {_row(us[k])}"
        return found(False, False, f"not triangular: dF_{i + 1}/dx_{j + 1} = {where}")
    seen = np.zeros_like(output[0])
    seen[:, : blocks[0]] = np.eye(plant.p, blocks[0])
    if np.any(output != seen):
        return found(True, False, "not in normal form: y is not x_1")
    for i in range(len(blocks) - 1):
        if lower[i] <= LOST * scale and upper[i] >= -LOST * scale:
            kind = "loses rank" if max(blocks) > 1 else "vanishes" if lower[i] * upper[i] >= 0 else "changes its sign"
            values = f"between {lower[i]:.6g} and {upper[i]:.6g}"
            why = f"not uniformly observable: dF_{i + 1}/dx_{i + 2} {kind} ({values}), and with it what is behind x_{i + 1}"
            return found(True, False, why)
    return found(True, True, f"uniformly observable as far as {len(us)} points show: triangular, and no coupling vanishes")


def require_triangular(owner: str, plant: AbstractFlowPlant, *, count: int = 64, seed: int = 0) -> None:
    """ValueError, with the entry and the point, if some F_i of the plant depends on a state beyond x_{i+1}."""
    box = np.full(plant.n, -2.0), np.full(plant.n, 2.0)
    inputs = None if plant.m == 0 else (np.full(plant.m, -2.0), np.full(plant.m, 2.0))
    found = structure(plant, states=box, inputs=inputs, count=count, seed=seed)
    if not found.triangular:
        fix = "Order the states so that each is seen through the one before it, or use jaxobs.designs.lpv_lmi."
        raise refuse(owner, "plant", f"{type(plant).__name__}, {found.why}", "g_i of x_1, ..., x_i alone", fix)


def _couplings(flow: np.ndarray, blocks: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    edges = np.cumsum([0, *blocks])
    lower, upper = [], []
    for i in range(len(blocks) - 1):
        part = flow[:, edges[i] : edges[i + 1], edges[i + 1] : edges[i + 2]]
        values = part[:, 0, :] if set(blocks) == {1} else np.linalg.svd(part, compute_uv=False)
        lower.append(float(np.min(values)))
        upper.append(float(np.max(values)))
    return np.asarray(lower), np.asarray(upper)


def _box(field: str, box: Box, size: int) -> tuple[np.ndarray, np.ndarray]:
    low, high = (np.asarray(side, float).reshape(-1) for side in box)
    if low.shape != (size,) or high.shape != (size,) or not np.all(np.isfinite([low, high])) or np.any(low > high):
        given = f"{low.tolist()} to {high.tolist()}"
        raise refuse("structure", field, given, f"{size} finite pairs, lowest <= highest", "Give (lowest, highest).")
    return low, high


def _row(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in values) + ")"
