"""What does the care in corner_lmi buy, and what does it cost, against writing the inequalities down in cvxpy?

Chains x_i' = x_{i+1}, x_n' = phi with slopes in [-k, k], decay rate 0.5: one gain for all 2^n corners. The rival is what a user
writes: P > 0, the inequalities in the plant's own coordinates, Clarabel, then L = P^-1 Y'. Each answer is put to the same exact
check; for the rival also with P searched anew for its gain. Run: .venv/bin/python benchmarks/corner_lmi.py [largest n]
"""

import itertools
import sys
import time
import warnings

import cvxpy as cp
import numpy as np

from jaxobs.designs import Infeasible, corner_lmi
from jaxobs.designs.polytope import Polytope

LARGEST = int(sys.argv[1]) if len(sys.argv) > 1 else 6
SLOPES, RATE = (0.2, 2.0, 20.0, 2000.0), 0.5


def chain(n: int, slope: float) -> Polytope:
    column, bound = np.eye(n)[:, -1:], np.full(n, slope)
    return Polytope(np.eye(n, k=1), np.tile(column, (1, n)), np.eye(n), -bound, bound, np.eye(1, n))


def by_hand(model: Polytope) -> tuple[str, np.ndarray | None]:
    """The solver's status, and the gain if it gave one."""
    p, y = cp.Variable((model.n, model.n), symmetric=True), cp.Variable((model.p, model.n))
    eye = np.eye(model.n)
    cones = [p >> 1e-6 * eye]
    for corner in model.corners():
        decrease = corner.T @ p + p @ corner - y.T @ model.output - model.output.T @ y + 2 * RATE * p
        cones.append(decrease << -1e-6 * eye)
    problem = cp.Problem(cp.Minimize(cp.trace(p) + cp.norm(y)), cones)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            problem.solve(solver=cp.CLARABEL)
        except cp.SolverError:
            return "solver error", None
    return problem.status, None if p.value is None else np.linalg.solve(p.value, y.value.T)


def proved(model: Polytope, gain: np.ndarray | None) -> bool:
    if gain is None or not np.all(np.isfinite(gain)):
        return False
    try:
        return bool(corner_lmi.prove(model, gain, rate=RATE).verify())
    except Infeasible:
        return False


def main() -> None:
    print(f"{'n':>2} {'slope':>7}  {'by hand':>20} {'proved':>7} {'s':>7}   {'corner_lmi':>10} {'s':>7}  {'time':>6}")
    score = {"by hand": 0, "corner_lmi": 0}
    cases = list(itertools.product(range(2, LARGEST + 1), SLOPES))
    by_hand(chain(2, 1.0))  # imports and first calls are not what is compared
    for n, slope in cases:
        model = chain(n, slope)
        begin = time.perf_counter()
        status, gain = by_hand(model)
        middle = time.perf_counter()
        try:
            ours = bool(corner_lmi.synthesise(model, rate=RATE)[1].verify())
        except Infeasible:
            ours = False
        end = time.perf_counter()
        theirs = proved(model, gain)
        score["by hand"] += theirs
        score["corner_lmi"] += ours
        hand, own = middle - begin, end - middle
        print(f"{n:2d} {slope:7g}  {status:>20} {theirs!s:>7} {hand:7.2f}   {ours!s:>10} {own:7.2f}  {own / hand:5.1f}x")
    print(", ".join(f"{name}: {found} of {len(cases)} proved" for name, found in score.items()))


if __name__ == "__main__":
    main()
