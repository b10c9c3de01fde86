"""Where the bounds of a model hold on a box only: the initial errors from which the estimate never leaves it.

With the gain fixed everything is linear in Q = P^-1: at all corners F_c Q + Q F_c' + 2 rate Q < 0, for each face h_j'Q h_j <
w_j^2 (level 1), and a ball of radius r lies in {e'P e <= 1} where Q > r^2 I. The region is made large first, then proved.
"""

from typing import Any

import cvxpy as cp
import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import Corners, Regional
from jaxobs.designs import corner_lmi, sdp
from jaxobs.designs._injected import Injected
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.polytope import Polytope, as_tuples

MARGIN = 1e-7  # of the corner inequalities, in coordinates in which the P of the corners is the identity
DOWN = 1 - 1e-9  # room for the exact check


def regional(
    model: Polytope,
    gain: Any,
    *,
    inner: Any,
    outer: Any,
    rate: float = 0.0,
    faces: Any = None,
    aim: str = "ball",
    injection: Any = None,
    origin: str = "given",
) -> Regional:
    """The exact certificate that every e(0) with e(0)'P e(0) <= level decays at `rate` while xhat stays in B, for a model whose
    bounds hold for states and estimates in B only, and a plant whose state stays in S.

    inner: S, as (lower, upper) or as points (N, n), whose extremes are taken. outer: B, as (lower, upper); infinite where B has
    no end. Both count the entries of faces @ x, with faces (m, n) the identity if not given. rate [1/s] >= 0. aim: "ball", the
    largest r so that |e(0)| <= r will do, or "volume", the largest ellipsoid. injection (r, p): the innovation in the channels
    of the observer f(z + K (y - C z)), none if not given; the bounds of the model then have to hold wherever f is evaluated
    while x and xhat are in B. origin: where the bounds come from.

    Infeasible where the gain has no certificate at this rate even on all of the box, or none that passes the exact check.
    ValueError where S leaves B no room, where B has no end at all (then corner_lmi.prove says more), and for bad arguments.
    Source: Boyd, El Ghaoui, Feron and Balakrishnan, Linear Matrix Inequalities in System and Control Theory, 1994, section 5.2.
    """
    system = Injected.make("regional", "injection", model, gain, injection)
    if aim not in ("ball", "volume"):
        raise refuse("regional", "aim", repr(aim), "'ball' or 'volume'", "The ball is a radius for |e(0)|.")
    rows, small, large = _sides(model, inner, outer, faces)
    widths = _widths("regional", small, large)
    ends = np.isfinite(widths)
    rows, small, large, widths = rows[ends], small[:, ends], large[:, ends], widths[ends]
    if not len(rows):
        fix = "The bounds hold everywhere: jaxobs.designs.corner_lmi.prove(model, gain, rate=rate) is global."
        raise refuse("regional", "outer", "no finite side", "a box with an end", fix)
    if not np.all(np.isfinite(small)):
        raise refuse(
            "regional", "inner", small.tolist(), "finite sides where outer has an end", "Bound the state on both sides."
        )
    bounded = small + np.array([[-2.0], [2.0]]) * widths  # a smaller B, of which no more is asked
    large = np.where(np.isfinite(large), large, bounded)
    proof = corner_lmi.prove(system.seen, system.gain, rate=rate, origin=origin)
    assert isinstance(proof, Corners)
    t = np.linalg.inv(np.linalg.cholesky(np.asarray(proof.p))).T
    found = _largest(np.linalg.inv(t) @ system.closed @ t, rate, rows @ t / widths[:, None], t, aim)
    sides = {"faces": as_tuples(rows), "inner_lower": as_tuples(small[0]), "inner_upper": as_tuples(small[1])}
    sides |= {"outer_lower": as_tuples(large[0]), "outer_upper": as_tuples(large[1])}
    for p in (*found, np.asarray(proof.p)):
        own: dict[str, Any] = system.fields() | sides | _fitted(p, rows, widths)
        certificate = Regional(**own, rate=float(rate), origin=origin)
        if certificate.verify():
            return certificate
    reason = f"no region was found whose decay at {rate:.6g} /s passes the exact check"
    raise Infeasible(reason, 0.0, "Ask for a lower rate.", tried=(f"the largest {aim}",))


def half_widths(inner: Any, outer: Any) -> np.ndarray:
    """w_j = min(outer_upper_j - inner_upper_j, inner_lower_j - outer_lower_j) > 0, (m,): how far an error may reach along each
    side before x - e leaves B, for x in S. inner: (lower, upper) or points (N, m); outer: (lower, upper). Infinite where B is.
    ValueError, naming the side, where S touches the border of B or sticks out."""
    small, large = _extremes("half_widths", inner), _pair("half_widths", "outer", outer)
    if small.shape != large.shape:
        raise refuse("half_widths", "inner", f"{small.shape[1]} sides", f"those of outer, {large.shape[1]}", "One pair a side.")
    return _widths("half_widths", small, large)


def _widths(owner: str, small: np.ndarray, large: np.ndarray) -> np.ndarray:
    above, below = (np.where(np.isinf(end), np.inf, 0.0) for end in (large[1], large[0]))
    with np.errstate(invalid="ignore"):
        above, below = np.where(above, above, large[1] - small[1]), np.where(below, below, small[0] - large[0])
    widths = np.minimum(above, below)
    if (none := np.flatnonzero(~(widths > 0))).size:
        j = int(none[0])
        given = f"[{small[0, j]:.6g}, {small[1, j]:.6g}] against [{large[0, j]:.6g}, {large[1, j]:.6g}] along side {j}"
        raise refuse(owner, "inner", given, "a set inside of outer", "Widen outer, with the bounds that hold there.")
    return widths


def _sides(model: Polytope, inner: Any, outer: Any, faces: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows = np.eye(model.n) if faces is None else np.asarray(faces, float)
    if rows.ndim != 2 or rows.shape[1] != model.n or not np.all(np.isfinite(rows)):
        raise refuse(
            "regional", "faces", f"shape {rows.shape}", f"finite rows of length {model.n}", "One row a side of the box."
        )
    small, large = _extremes("regional", inner), _pair("regional", "outer", outer)
    for name, value in (("inner", small), ("outer", large)):
        if value.shape[1] != len(rows):
            fix = "A pair for each row of faces, for each state if there are none; infinite where B has no end."
            raise refuse("regional", name, f"{value.shape[1]} sides", f"{len(rows)}", fix)
    return rows, small, large


def _extremes(owner: str, inner: Any) -> np.ndarray:
    """(lower, upper), (2, m), of a pair or of points."""
    if isinstance(inner, (tuple, list)) and len(inner) == 2:
        return _pair(owner, "inner", inner)
    points = np.asarray(inner, float)
    if points.ndim != 2 or not len(points) or not np.all(np.isfinite(points)):
        fix = "Or points, one a row, as an array."
        raise refuse(owner, "inner", f"shape {points.shape}", "(lower, upper), or finite points (N, m)", fix)
    return np.stack([points.min(0), points.max(0)])


def _pair(owner: str, name: str, given: Any) -> np.ndarray:
    sides = [np.asarray(side, float).reshape(-1) for side in given] if isinstance(given, (tuple, list, np.ndarray)) else []
    if len(sides) != 2 or sides[0].shape != sides[1].shape or not np.all(sides[0] <= sides[1]):
        raise refuse(owner, name, f"{given}", "(lower, upper) with lower <= upper", "Two vectors of one length.")
    return np.stack(sides)


def _largest(closed: np.ndarray, rate: float, faces: np.ndarray, t: np.ndarray, aim: str) -> list[np.ndarray]:
    """P of the largest region, in the user's coordinates: at most one. faces: h_j / w_j, in those of t, as is Q."""
    n = len(t)
    size = 1 / np.max(np.sum(faces**2, axis=1))  # Q = size * I touches the nearest face
    inverse = np.linalg.inv(t)
    unit = size * np.linalg.norm(t @ t.T, 2)  # of the squared radius

    def lmis(q, r):
        yield q
        yield from (-(f @ q + q @ f.T) - 2 * rate * q - MARGIN * np.trace(q) / n * np.eye(n) for f in closed)
        yield from (np.reshape(1 - size * h @ q @ h, (1, 1)) for h in faces)
        yield size / unit * t @ q @ t.T - r * np.eye(n)

    if aim == "ball":
        unknowns = {"q": sdp.symmetric(n), "r": sdp.scalar()}
        found = sdp.optimise(unknowns, lambda q, r: list(lmis(q, r)), maximise=lambda q, r: r, margin=0.0)
        q = found.values.get("q")
    else:
        q = _most_voluminous(closed, rate, np.sqrt(size) * faces)
    if q is None or np.linalg.eigvalsh(q)[0] <= 0:
        return []
    return [inverse.T @ np.linalg.inv(q) @ inverse / size]


def _most_voluminous(closed: np.ndarray, rate: float, faces: np.ndarray) -> np.ndarray | None:
    """max log det Q under the same inequalities."""
    n = closed.shape[1]
    q = cp.Variable((n, n), symmetric=True)
    steady = [f @ q + q @ f.T + 2 * rate * q << -MARGIN * cp.trace(q) / n * np.eye(n) for f in closed]
    problem = cp.Problem(cp.Maximize(cp.log_det(q)), steady + [h @ q @ h <= 1 for h in faces])
    try:
        problem.solve(solver=cp.CLARABEL)
    except (cp.SolverError, ValueError, ArithmeticError):
        return None
    return q.value


def _fitted(p: np.ndarray, rows: np.ndarray, widths: np.ndarray) -> dict[str, Any]:
    """P of size one, the level at which its ellipsoid touches the nearest face, and the ball inside."""
    p = (p + p.T) / 2
    p = p / 2.0 ** np.round(np.log2(np.max(np.abs(p))))
    reach = np.einsum("ji,ji->j", rows, np.linalg.solve(p, rows.T).T)
    level = float(np.min(widths**2 / reach)) * DOWN
    return {"p": as_tuples(p), "level": level, "radius": float(np.sqrt(level / np.linalg.eigvalsh(p)[-1])) * DOWN}
