"""Semidefinite programs whose answers are checked: the solver proposes, its values and its duals are recomputed here.

A linear matrix inequality is a NumPy function of its unknowns, affine, returning symmetric matrices F_i that shall be > 0:

    unknowns = {"p": sdp.symmetric(2, trace=2.0), "y": sdp.full(1, 2)}
    found = sdp.feasible(unknowns, lambda p, y: [p, -(a.T @ p + p @ a - y.T @ c - c.T @ y)])

`found.margin` is the smallest eigenvalue of all F_i at the returned values, `found.bound` what no values can exceed (weak
duality). A solver's word, "optimal" or "infeasible", is passed on by neither.
"""

import dataclasses
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.linalg
import scipy.sparse

from jaxobs._module import refuse
from jaxobs.designs import _conic
from jaxobs.designs._conic import clarabel, triangle

ITERATIONS = 80  # of the solver: what takes longer does not converge
ROUNDING = 1e-10  # a bound this close to zero decides nothing
REFINEMENTS = 30  # alternating projections of the duals


@dataclasses.dataclass(frozen=True)
class Unknown:
    """The shape of an unknown and what its entries may not exceed in absolute value (the box that makes bounds finite).

    trace: of a symmetric unknown, fixed; None where it is free.
    """

    shape: tuple[int, ...]
    is_symmetric: bool
    reach: float
    trace: float | None = None

    @property
    def centre(self) -> np.ndarray:
        """The value with all free entries zero."""
        return np.zeros(self.shape) if self.trace is None else np.eye(self.shape[0]) * self.trace / self.shape[0]

    @property
    def basis(self) -> np.ndarray:
        """What each free entry adds to the centre, (entries, *shape)."""
        if not self.is_symmetric:
            return np.eye(int(np.prod(self.shape))).reshape(-1, *self.shape)
        units = _conic.symmetric(self.shape[0])
        if self.trace is None:
            return units
        units[np.trace(units, axis1=1, axis2=2) == 1, -1, -1] -= 1  # the last diagonal entry makes up for the others
        return units[:-1]


def symmetric(n: int, *, reach: float = 1e4, trace: float | None = None) -> Unknown:
    """A symmetric (n, n) matrix. With its trace fixed, a homogeneous problem (P > 0, A'P + P A < 0) has no trivial answer."""
    return Unknown((n, n), True, reach if trace is None else min(reach, trace), trace)


def full(rows: int, columns: int, *, reach: float = 1e4) -> Unknown:
    """Any (rows, columns) matrix."""
    return Unknown((rows, columns), False, reach)


def scalar(*, reach: float = 1e4) -> Unknown:
    """A number."""
    return Unknown((), False, reach)


@dataclasses.dataclass(frozen=True)
class Solution:
    """values: the unknowns by name, {} when no solver gave any. margin: min_i lambda_min(F_i(values)), recomputed; -inf without
    values. value: the objective there (for `feasible` the margin). bound: an upper bound on the objective over the box of the
    unknowns, from the duals, up to rounding. duals: one symmetric matrix >= 0 for each F_i. Source: Boyd and Vandenberghe,
    Convex Optimization, section 5.9.
    """

    values: dict[str, np.ndarray]
    margin: float
    value: float
    bound: float
    duals: tuple[np.ndarray, ...]

    @property
    def is_feasible(self) -> bool:
        """The values satisfy every inequality strictly, in floats."""
        return self.margin > 0

    @property
    def is_infeasible(self) -> bool:
        """For `feasible`: no values within reach satisfy all inequalities (up to rounding). Not the negation of is_feasible."""
        return self.bound < -ROUNDING


Matrices = Sequence[Any]
Unknowns = Mapping[str, Unknown]


def feasible(unknowns: Unknowns, lmis: Callable[..., Matrices]) -> Solution:
    """max t:   F_i(x) >= t I for all i,   |x_j| <= reach_j: values x with the largest common margin t.

    unknowns: by name, from `symmetric`, `full`, `scalar`. lmis(**x): the symmetric F_i (k_i, k_i), affine in x (it is evaluated
    at unit vectors; nothing checks that). Normalise what is homogeneous: fix a trace, or add I - P > 0. Nothing is raised where
    there is no solution or the solvers fail: see `Solution`. Source: Boyd and Vandenberghe, Convex Optimization, section 11.4.
    """
    return largest_margin(unknowns, *_coefficients(unknowns, lmis))


def optimise(
    unknowns: Unknowns, lmis: Callable[..., Matrices], *, maximise: Callable[..., Any], margin: float = 1e-8
) -> Solution:
    """max f(x):   F_i(x) >= margin I for all i,   |x_j| <= reach_j,   with f = maximise(**x), an affine number.

    unknowns and lmis as for `feasible`; margin in the units of the F_i. Nothing is raised where there is no solution or the
    solvers fail: see `Solution`. Source: Boyd and Vandenberghe, Convex Optimization, section 4.6.2.
    """
    constant, linear = _coefficients(unknowns, lmis)
    start, slopes = _coefficients(unknowns, lambda **x: [np.reshape(maximise(**x), (1, 1))])
    shifted = [first - margin * np.eye(len(first)) for first in constant]
    objective, offset = slopes[0][:, 0, 0], float(start[0][0, 0])
    return _solve(unknowns, (shifted, linear), objective, offset, reach_of(unknowns), (constant, linear))


def largest_margin(unknowns: Unknowns, constant: list[np.ndarray], linear: list[np.ndarray]) -> Solution:
    """`feasible`, of F_i(0) (k_i, k_i) and the slopes of F_i (entries, k_i, k_i)."""
    pushed, objective, reach = phase_one(unknowns, constant, linear)
    return _solve(unknowns, (constant, pushed), objective, 0.0, reach, (constant, linear))


def phase_one(
    unknowns: Unknowns, constant: list[np.ndarray], linear: list[np.ndarray]
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """(slopes, objective, reach) of max t:   F_i(x) - t I >= 0, t the last entry."""
    pushed = [np.concatenate([part, -np.eye(len(first))[None]]) for first, part in zip(constant, linear, strict=True)]
    far = max(np.max(np.abs(first), initial=1.0) for first in constant) * 1e4
    return pushed, np.append(np.zeros(len(linear[0])), 1.0), np.append(reach_of(unknowns), far)


def reach_of(unknowns: Unknowns) -> np.ndarray:
    """The reach of every free entry, (entries,)."""
    return np.concatenate([np.full(len(unknown.basis), unknown.reach) for unknown in unknowns.values()])


def _coefficients(unknowns: Unknowns, lmis: Callable[..., Matrices]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """F_i(0), (k_i, k_i), and the slopes of F_i along each free entry, (entries, k_i, k_i), by evaluating at unit vectors."""
    zero = {name: unknown.centre for name, unknown in unknowns.items()}
    constant = [np.asarray(f, float) for f in lmis(**zero)]
    for i, first in enumerate(constant):
        if first.ndim != 2 or first.shape != first.T.shape or not np.allclose(first, first.T, rtol=1e-9, atol=1e-12):
            fix = "Write both triangles: -(A.T @ p + p @ A), not -2 * p @ A."
            raise refuse("sdp", "lmis", f"F_{i} of shape {first.shape}, not symmetric", "symmetric matrices", fix)
    slopes = [
        [np.asarray(f, float) - first for f, first in zip(lmis(**(zero | {name: zero[name] + unit})), constant, strict=True)]
        for name, unknown in unknowns.items()
        for unit in unknown.basis
    ]
    if not slopes:  # a symmetric (1, 1) matrix of given trace is no unknown
        return constant, [np.zeros((0, *first.shape)) for first in constant]
    return constant, [np.stack(one) for one in zip(*slopes, strict=True)]


def _solve(unknowns, program, objective, offset, reach, inequalities) -> Solution:
    """maximise objective'x + offset with program >= 0 and |x| <= reach; `inequalities` are what the margin is taken of."""
    x, duals = proposal(program, objective, reach)
    if x is None:
        return Solution({}, -np.inf, -np.inf, np.inf, ())
    entries = x[: len(inequalities[1][0])]
    margin = lowest(inequalities, entries)
    is_phase_one = len(entries) < len(x)
    bound = dual_bound(program, objective, reach, duals)
    if not (is_phase_one and margin > 0):  # a feasible point is at hand: nothing to refute
        refined = _refined(program, objective, duals)
        if (better := dual_bound(program, objective, reach, refined)) < bound:
            bound, duals = better, refined
    value = margin if is_phase_one else float(objective @ x + offset)
    return Solution(_named(unknowns, entries), margin, value, offset + bound, tuple(duals))


def proposal(program, objective, reach) -> tuple[np.ndarray | None, list[np.ndarray]]:
    """x and the duals as a solver has them; None if no solver has any. SCS is asked only when Clarabel returns nothing."""
    x, duals = _clarabel(program, objective, reach)
    return (x, duals) if x is not None else _scs(program, objective, reach)


def _clarabel(program, objective, reach) -> tuple[np.ndarray | None, list[np.ndarray]]:
    """x and the duals, without a modelling language, which takes longer than the solution."""
    size, box = len(objective), np.diag(1 / reach)
    slopes, offsets, kinds = [box, -box], [np.ones(2 * size)], [clarabel.NonnegativeConeT(2 * size)]
    triangles = []
    for first, part in zip(*program, strict=True):
        rows, columns, weights = triangle(len(first))
        triangles.append((rows, columns, weights))
        slopes.append(-(part[:, rows, columns] * weights).T)
        offsets.append(first[rows, columns] * weights)
        kinds.append(clarabel.PSDTriangleConeT(len(first)))
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_iter = False, ITERATIONS
    matrix, quadratic = scipy.sparse.csc_matrix(np.concatenate(slopes)), scipy.sparse.csc_matrix((size, size))
    solver = clarabel.DefaultSolver(quadratic, -np.asarray(objective, float), matrix, np.concatenate(offsets), kinds, settings)
    found = solver.solve()
    x, z = np.array(found.x), np.array(found.z)[2 * size :]
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(z))):
        return None, []
    duals = []
    for (first, _), (rows, columns, weights) in zip(zip(*program, strict=True), triangles, strict=True):
        dual = np.zeros_like(first)
        dual[rows, columns] = dual[columns, rows] = z[: len(rows)] / weights
        duals.append(positive_part(dual))
        z = z[len(rows) :]
    return x, duals


def _scs(program, objective, reach) -> tuple[np.ndarray | None, list[np.ndarray]]:
    x = cp.Variable(len(objective))
    cones = []
    for first, slopes in zip(*program, strict=True):
        k = len(first)
        cones.append(cp.reshape(slopes.reshape(len(objective), k * k).T @ x, (k, k), order="C") + first >> 0)
    box = cp.multiply(1 / reach, x)
    problem = cp.Problem(cp.Maximize(objective @ x), [*cones, box <= 1, box >= -1])
    with warnings.catch_warnings():  # "may be inaccurate": recomputed by the caller, whatever the solver says
        warnings.simplefilter("ignore")
        try:
            problem.solve(solver=cp.SCS, eps=1e-8, max_iters=2_000)
        except (cp.SolverError, ValueError, ArithmeticError):
            return None, []
    if x.value is None or not np.all(np.isfinite(x.value)):
        return None, []
    return np.asarray(x.value), [positive_part(cone.dual_value) for cone in cones]


def _refined(program, objective, duals) -> list[np.ndarray]:
    """The duals moved the least that makes them stationary, objective_j + sum_i <Z_i, F_ij> = 0, and back to Z_i >= 0."""
    rows = np.concatenate([slopes.reshape(len(objective), -1) for slopes in program[1]], axis=1)
    ends, shapes = np.cumsum([z.size for z in duals])[:-1], [z.shape for z in duals]
    pseudo = np.linalg.pinv(rows)
    for _ in range(REFINEMENTS):
        flat = np.concatenate([z.reshape(-1) for z in duals])
        parts = np.split(flat - pseudo @ (objective + rows @ flat), ends)
        duals = [positive_part(part.reshape(shape)) for part, shape in zip(parts, shapes, strict=True)]
    return duals


def dual_bound(program, objective, reach, duals) -> float:
    """Weak duality over the box: objective'x <= sum_i <Z_i, F_i(0)> + sum_j reach_j |objective_j + sum_i <Z_i, F_ij>|."""
    constant, linear = program
    residual = objective + sum(np.einsum("jab,ab->j", slopes, z) for slopes, z in zip(linear, duals, strict=True))
    return float(sum(np.sum(first * z) for first, z in zip(constant, duals, strict=True)) + reach @ np.abs(residual))


def positive_part(z: np.ndarray) -> np.ndarray:
    """The nearest matrix >= 0 (n, n)."""
    values, vectors = np.linalg.eigh((z + z.T) / 2)
    return (vectors * np.maximum(values, 0)) @ vectors.T


def lowest(program, x: np.ndarray) -> float:
    """min_i lambda_min(F_i(x))."""
    found = (first + np.tensordot(x, slopes, 1) for first, slopes in zip(*program, strict=True))
    return min(float(scipy.linalg.eigvalsh(f)[0]) for f in found)


def _named(unknowns: Unknowns, x: np.ndarray) -> dict[str, np.ndarray]:
    values: dict[str, np.ndarray] = {}
    used = 0
    for name, unknown in unknowns.items():
        basis = unknown.basis
        values[name] = np.asarray(unknown.centre + np.tensordot(x[used : used + len(basis)], basis, 1))
        used += len(basis)
    return values
