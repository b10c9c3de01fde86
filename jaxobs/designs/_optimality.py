"""The optimal pair of a small semidefinite program to rounding: a solver's proposal, polished by Newton's method.

At an optimum x of max objective'x, S_i = F_i(x) >= 0, with slopes F_ij and duals Z_i >= 0,

    objective_j + sum_i <Z_i, F_ij> = 0,        S_i Z_i + Z_i S_i = 0,

a square system. Its derivative is regular where the pair is strictly complementary and unique. Where it is not, the shortest
step is taken and leaves open directions as they are. Source: Alizadeh, Haeberly and Overton, SIAM J. Optim. 8 (1998), 746-768.
"""

import dataclasses
from functools import lru_cache
from typing import Any

import numpy as np

from jaxobs.designs import sdp
from jaxobs.designs._conic import triangle

STEPS = 20  # two or three suffice, more are taken only where S_i + Z_i is singular
CONVERGED = 1e-14
SINGULAR = 1e-11  # relative singular values below: directions in which the pair is not unique
LOOSE = 1e-4  # relative error of the pair above which no value is returned
EDGE = 1e-6  # relative distance to its reach at which an entry counts as held there
ROUGH = 1e-9  # relative: what rounding leaves of symmetry and of affinity
Program = tuple[list[np.ndarray], list[np.ndarray]]


def pair(problem: Any, tolerance: float, fault, constant, linear, offset, objective) -> tuple[Any, ...]:
    """(x, duals, open x, open duals, (gap, error, margin, reached), infeasible) of a `sdp_value.SdpProblem`, from coefficients.

    fault: what is left of asymmetry and of curvature, relative. open: a direction in which the pair is not unique, zero where
    it is. x and the duals are NaN where nothing is to be relied on.
    """
    is_margin = problem.maximise is None
    x, duals = np.full(len(objective) + is_margin, np.nan), [np.full(first.shape, np.nan) for first in constant]
    numbers = np.array([np.inf, np.inf, np.nan, np.nan])
    if fault > ROUGH or not all(np.all(np.isfinite(one)) for one in (fault, offset, objective, *constant, *linear)):
        return x, duals, x, duals, numbers, np.asarray(False)
    if is_margin:
        slopes, objective, reach = sdp.phase_one(problem.unknowns, constant, linear)
    else:
        constant = [first - problem.margin * np.eye(len(first)) for first in constant]
        slopes, reach = linear, sdp.reach_of(problem.unknowns)
    found, proposed = sdp.proposal((constant, slopes), objective, reach)
    if found is not None:
        found, proposed, open_x, open_duals, error = polished((constant, slopes), objective, reach, found, proposed)
        gap, scale = duality_gap((constant, slopes), objective, reach, found, proposed)
        numbers[:2] = gap, error
        if gap <= tolerance * (scale + abs(float(offset))) and error <= LOOSE:
            numbers[2] = sdp.lowest((constant, slopes), found) + (found[-1] if is_margin else problem.margin)
            numbers[3] = np.max(np.abs(found) / reach)
            return found, proposed, open_x, open_duals, numbers, np.asarray(False)
    infeasible = not is_margin and sdp.largest_margin(problem.unknowns, constant, linear).is_infeasible
    return x, duals, x, duals, numbers, np.asarray(infeasible)


def duality_gap(program: Program, objective, reach, x, duals) -> tuple[float, float]:
    """(the gap, |objective'x| + sum_i |Z_i| |F_i(0)|). An x that violates F_i >= 0 by d is charged d tr Z_i, what it gains by
    that to first order."""
    value, violation = float(objective @ x), max(0.0, -sdp.lowest(program, x))
    gained = violation * sum(float(np.trace(z)) for z in duals)
    bound = sdp.dual_bound(program, objective, reach, duals)
    scale = abs(value) + sum(float(np.linalg.norm(z) * np.linalg.norm(f)) for z, f in zip(duals, program[0], strict=True))
    return max(bound - value, 0.0) + gained, scale


@dataclasses.dataclass(frozen=True)
class Scaled:
    """The program in units in which each F_i, its slopes and the largest dual are about one; its free entries x (m,).

    first, slopes: S_i (d_i,) at x = 0 and its slopes (m, d_i), as entries of `entries_of`; duals as such too.
    """

    objective: np.ndarray
    first: list[np.ndarray]
    slopes: list[np.ndarray]

    def residual(self, x: np.ndarray, duals: list[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
        """(what both equations miss, the S_i)."""
        slacks = [matrix_of(first + x @ slopes) for first, slopes in zip(self.first, self.slopes, strict=True)]
        missing = [slopes @ z for slopes, z in zip(self.slopes, duals, strict=True)]
        products = [entries_of(s @ matrix_of(z)) for s, z in zip(slacks, duals, strict=True)]
        return np.concatenate([sum(missing, start=self.objective), *products]), slacks

    def jacobian(self, slacks: list[np.ndarray], duals: list[np.ndarray]) -> np.ndarray:
        m = len(self.objective)
        size, at = m + sum(map(len, duals)), m
        found = np.zeros((size, size))
        for s, z, slopes in zip(slacks, duals, self.slopes, strict=True):
            own = slice(at, at + len(z))
            found[:m, own] = slopes
            found[own, :m] = product_with(matrix_of(z)) @ slopes.T
            found[own, own] = product_with(s)
            at += len(z)
        return found


def polished(program: Program, objective, reach, x, duals) -> tuple[Any, ...]:
    """(x, duals, open x, open duals, error): Newton steps as long as they bring the pair closer. Entries at their reach stay.

    error: the length of one more step, relative to the pair in units of `Scaled`.
    """
    rows = [entries_of(slopes) for slopes in program[1]]
    sizes = [np.linalg.norm(f) + np.abs(x) @ np.linalg.norm(r, axis=1) for f, r in zip(program[0], rows, strict=True)]
    sizes = [size if size > 0 else 1.0 for size in sizes]
    largest = max(size * float(np.linalg.norm(z)) for size, z in zip(sizes, duals, strict=True)) or 1.0
    unit = np.sqrt(sum(np.sum(r**2, axis=1) / size**2 for r, size in zip(rows, sizes, strict=True)))
    inside = np.abs(x) < (1 - EDGE) * reach
    free = inside & (unit > 0)
    held = np.where(free, 0.0, np.where(inside, x, np.sign(x) * reach))
    first = [entries_of(f + np.tensordot(held, s, 1)) / size for f, s, size in zip(*program, sizes, strict=True)]
    slopes = [r[free] / size / unit[free, None] for r, size in zip(rows, sizes, strict=True)]
    scaled = Scaled(objective[free] / unit[free] / largest, first, slopes)
    at, z = x[free] * unit[free], [entries_of(dual) * size / largest for dual, size in zip(duals, sizes, strict=True)]
    ends = np.cumsum([len(at), *map(len, z)])[:-1]
    residual, slacks = scaled.residual(at, z)
    error, direction = np.inf, np.zeros(len(residual))
    for _ in range(STEPS):
        step, direction = least_step(scaled.jacobian(slacks, z), residual)
        error = float(np.linalg.norm(step) / (np.linalg.norm(np.concatenate([at, *z])) or 1.0))
        parts = np.split(step, ends)
        moved = [entries_of(sdp.positive_part(matrix_of(own + part))) for own, part in zip(z, parts[1:], strict=True)]
        new, slacks = scaled.residual(at + parts[0], moved)
        if error < CONVERGED or not np.linalg.norm(new) < np.linalg.norm(residual):
            break
        at, z, residual = at + parts[0], moved, new

    def unscaled(own: np.ndarray, duals: list[np.ndarray], rest: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        x = rest.copy()
        x[free] = own / unit[free]
        return x, [matrix_of(one) * largest / size for one, size in zip(duals, sizes, strict=True)]

    way, *ways = np.split(direction, ends)
    return *unscaled(at, z, held), *unscaled(way, ways, np.zeros_like(held)), error


def least_step(jacobian: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The shortest Newton step, and a direction of length one among those that it leaves open, zero if there are none."""
    left, values, right = np.linalg.svd(jacobian)
    seen = values > SINGULAR * values[0]
    mixed = np.random.default_rng(0).normal(size=int(np.sum(~seen)))  # one of them all: none of them is missed by chance
    return -right[seen].T @ (left[:, seen].T @ residual / values[seen]), right[~seen].T @ mixed / (np.linalg.norm(mixed) or 1)


@lru_cache
def _places(k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(rows, columns, weights) of the entries of a symmetric (k, k) matrix, and the matrices of unit entries (d, k, k)."""
    rows, columns, weights = triangle(k)
    units = np.zeros((len(rows), k, k))
    units[np.arange(len(rows)), rows, columns] = units[np.arange(len(rows)), columns, rows] = 1 / weights
    return rows, columns, weights, units


def entries_of(f: np.ndarray) -> np.ndarray:
    """The symmetric part of (..., k, k) as d = k (k + 1) / 2 entries, (..., d), such that inner products are kept."""
    rows, columns, weights, _ = _places(f.shape[-1])
    return (f[..., rows, columns] + f[..., columns, rows]) * (weights / 2)


def matrix_of(entries: np.ndarray) -> np.ndarray:
    """The symmetric matrix (k, k) with these entries (d,)."""
    return np.tensordot(entries, _places(round(np.sqrt(2 * len(entries)) - 0.5))[3], 1)


def product_with(f: np.ndarray) -> np.ndarray:
    """(d, d): the entries of (f Y + Y f) / 2 from those of Y, for symmetric f and Y."""
    return entries_of(f @ _places(len(f))[3])
