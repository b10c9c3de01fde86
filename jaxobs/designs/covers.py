"""Three ways to require a matrix inequality at all parameters of a box: every corner, corners as they are needed, multipliers.

    M(rho) = m - sym(u diag(rho) v) > 0   for all lower <= rho <= upper,        sym(x) = x + x'

with m (k, k) and u (k, r) affine in unknowns. It is affine in rho, so the corners decide ("corners": 2^r matrices); "lazy"
starts with two of them and adds the most violated until none is, so that few are ever used; "multiplier" takes one matrix
instead,

    [ m - sym(u mid v) - v'half tau half v    u  ]
    [ u'                                     tau ]  > 0,   tau diagonal,  mid and half the middle and half the width,

which is sufficient, and necessary for r = 1. Source: Boyd et al., 1994, sections 5.1, 5.2 (multipliers, diagonal norm-bound).
"""

import dataclasses
import itertools
from typing import Literal

import numpy as np
import scipy.linalg

from jaxobs._module import refuse
from jaxobs.designs._conic import Affine, block, constant, diagonal, sym, transpose, value
from jaxobs.designs.polytope import Polytope

Cover = Literal["multiplier", "lazy", "corners"]
AT_ONCE = 3  # corners added by "lazy" in one round


@dataclasses.dataclass(frozen=True)
class Inequality:
    """M(rho) > margin: m (1 + m, k, k), u (1 + m, k, r), v (r, k), tau (1 + m, r, r) for the multipliers.

    Where v changes too, M(rho) = m - sym(u diag(rho) v + u0 diag(rho) dv), and tau0 dv is the first-order change of tau v.
    """

    name: str
    m: Affine
    u: Affine
    v: np.ndarray
    tau: Affine
    margin: float = 0.0
    dv: Affine | None = None
    u0: np.ndarray | None = None
    tau0: np.ndarray | None = None

    def moved(self, rho: np.ndarray, x: np.ndarray | None = None) -> Affine:
        """M(rho) for a stack of rho (..., r), as a function of the unknowns, or at x."""
        m, u, dv = (part if part is None or x is None else value(part, x)[None] for part in (self.m, self.u, self.dv))
        assert m is not None
        assert u is not None
        shift = (u[:, None] * rho[None, :, None, :]) @ self.v
        if dv is not None and self.u0 is not None:
            shift = shift + (self.u0 * rho[:, None, :])[None] @ dv[:, None]
        return m[:, None] - sym(shift) - (constant(self.margin * np.eye(m.shape[-1]), m)[:, None])


class Corners:
    """Every corner, or the corners that were needed so far."""

    multipliers = 0

    def __init__(self, model: Polytope, *, lazy: bool):
        self.rho, self.lazy = model.parameters(), lazy
        self.used: dict[str, list[int]] = {}

    def tau(self) -> np.ndarray:
        return np.zeros((0, 1, 1))

    def matrices(self, one: Inequality) -> list[Affine]:
        if not self.lazy:
            return [one.moved(self.rho)]
        used = self.used.setdefault(one.name, sorted({0, len(self.rho) - 1}))
        return [one.moved(self.rho[used])]

    def misses(self, one: Inequality, x: np.ndarray) -> bool:
        """Whether some corner that was left out is violated at x; the worst few are in from now on."""
        if not self.lazy:
            return False
        lowest = np.linalg.eigvalsh(one.moved(self.rho, x)[0])[:, 0]
        used = self.used[one.name]
        lowest[used] = np.inf
        worst = [int(k) for k in np.argsort(lowest)[:AT_ONCE] if lowest[k] < -one.margin / 2]
        used.extend(worst)
        return bool(worst)

    def lowest(self, one: Inequality, x: np.ndarray, p: np.ndarray) -> float:
        """The largest t with M(rho) >= t p at every corner."""
        t = np.linalg.inv(np.linalg.cholesky(p))
        return float(np.linalg.eigvalsh(t @ one.moved(self.rho, x)[0] @ t.T)[:, 0].min())


class Multiplier:
    """One matrix with a multiplier for each channel; tied channels have their own ones."""

    lazy = False

    def __init__(self, model: Polytope):
        self.multipliers = model.r
        self.middle, self.half = (model.lower + model.upper) / 2, (model.upper - model.lower) / 2

    def tau(self) -> np.ndarray:
        return diagonal(self.multipliers)

    def matrices(self, one: Inequality) -> list[Affine]:
        m = one.moved(self.middle[None])[:, 0]
        tau = one.tau - constant(one.margin * np.eye(self.multipliers), one.tau)
        if one.dv is None:
            wide = self.half[:, None] * one.v
            spread = wide.T @ one.tau @ wide
            return [block([[m - spread, one.u], [transpose(one.u), tau]])]
        assert one.tau0 is not None
        wide = self.half[:, None] * (one.tau @ one.v + one.tau0 @ one.dv)
        nothing = np.zeros_like(tau)
        rows = [[m, one.u, transpose(wide)], [transpose(one.u), tau, nothing], [wide, nothing, tau]]
        return [block(rows)]

    def misses(self, one: Inequality, x: np.ndarray) -> bool:
        return False

    def lowest(self, one: Inequality, x: np.ndarray, p: np.ndarray) -> float:
        """The largest t with M(rho) >= t p for all rho, by these multipliers."""
        (whole,) = (value(matrix, x) for matrix in self.matrices(one))
        k = len(p)
        tau = whole[k:, k:]
        if np.linalg.eigvalsh(tau)[0] <= 0:
            return -np.inf
        rest = whole[:k, :k] - whole[:k, k:] @ np.linalg.solve(tau, whole[k:, :k])
        return float(scipy.linalg.eigvalsh(rest, p)[0])


def cover_of(owner: str, model: Polytope, cover: str) -> Corners | Multiplier:
    """By name; ValueError for another one."""
    if cover not in ("multiplier", "lazy", "corners"):
        expected = '"multiplier", "lazy" or "corners"'
        raise refuse(owner, "cover", repr(cover), expected, "lazy is exact; multiplier is the fastest, and may prove less.")
    return Multiplier(model) if cover == "multiplier" else Corners(model, lazy=cover == "lazy")


def covered(cover: Corners | Multiplier, inequalities: list[Inequality], solve) -> np.ndarray | None:
    """x from `solve(matrices)`, again with the corners that it violated until there are none."""
    for _ in itertools.count():
        x = solve([matrix for one in inequalities for matrix in cover.matrices(one)])
        if x is None or sum(cover.misses(one, x) for one in inequalities) == 0:  # each may add corners
            return x
