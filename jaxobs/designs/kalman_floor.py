"""What no observer of a plant with uncertain constant parameters can beat: its steady Kalman filter at the worst of them.

The covariance of the filter solves a Riccati equation; a little below it the equation is a strict inequality, which floats can
satisfy and rational arithmetic can check.
"""

from typing import Any

import numpy as np
import scipy.linalg
import scipy.optimize

from jaxobs._module import refuse
from jaxobs.certificates import KalmanFloor
from jaxobs.designs._frame import Frame, frame
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.polytope import Polytope, as_tuples

SHRINKS = (1e-10, 1e-8, 1e-6, 1e-4, 1e-3)  # of what enters, until the inequality is strict in exact arithmetic
VERTICES = 1024  # looked at, at most
EVALUATIONS = 200  # of the search inside the box


def kalman_floor(
    model: Polytope, weight: Any, process: Any, noise: Any, *, points: Any = None, search: bool = True
) -> KalmanFloor:
    """max_rho tr(E S E'),    A(rho) S + S A(rho)' + W W' - S C'(V V')^-1 C S = 0:

    for e' = A(rho) e + W w of a plant with y = C x + V v, w and v white of unit intensity, no causal observer has a smaller
    E |E e|^2 in the mean over time at that constant rho, so none has for all parameters in the box. The certificate is a lower
    bound a little below this number; its `level` is the floor, its `rho` the parameters.

    weight E (s, n), process W (n, m), noise V (p, k) with V V' > 0. points (N, r): constant parameters in the box to look at,
    all corners if not given; with `search` also those that a local search from the worst of them meets. ValueError for shapes
    that do not fit and V V' not > 0. Infeasible where the filter does not exist (an undetectable point, so no floor is finite),
    or nothing above zero can be proved (nothing excites the error). Source: Kalman and Bucy, J. Basic Engineering 83 (1961).
    """
    e, w, v = _shaped(model, weight, process, noise)
    rhos = model.parameters() if points is None else np.asarray(points, float).reshape(-1, model.r)
    outside = np.any((rhos < model.lower) | (rhos > model.upper), axis=1)
    if np.any(outside):
        raise refuse("kalman_floor", "points", rhos[outside][0].tolist(), "parameters within the box", "Clip them.")
    if len(rhos) > VERTICES:
        rhos = rhos[np.sort(np.random.default_rng(0).choice(len(rhos), VERTICES, replace=False))]

    place = frame(model)

    def level(rho: np.ndarray) -> float:
        s = _filtered(place, rho, w, v)
        return -np.inf if s is None else float(np.trace(e @ s @ e.T))

    levels = np.array([level(rho) for rho in rhos])
    order = list(np.argsort(-levels))
    found = [(float(levels[k]), rhos[k]) for k in order[:3]]
    if search and model.r and np.isfinite(found[0][0]):
        found.insert(0, _search(model, level, found[0][1]))
    for value, rho in sorted(found, key=lambda pair: -pair[0]):
        if np.isfinite(value) and (certificate := _certified(model, place, rho, e, w, v)) is not None:
            return certificate
    change = "Give a process noise that reaches all states, or other points; designs.undetectable finds those without filter."
    raise Infeasible("no positive floor could be proved at any of the points", 0.0, change)


def _shaped(model: Polytope, weight: Any, process: Any, noise: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    e, w, v = (np.array(one, float) for one in (weight, process, noise))
    for name, value, axis, size in (("weight", e, 1, model.n), ("process", w, 0, model.n), ("noise", v, 0, model.p)):
        if value.ndim != 2 or value.shape[axis] != size or not np.all(np.isfinite(value)):
            given = f"shape {value.shape}" if value.ndim != 2 or value.shape[axis] != size else value.tolist()
            fix = "The noises are W w and V v with w, v of unit intensity: one row of W a state, one row of V an output."
            raise refuse("kalman_floor", name, given, f"a finite matrix, axis {axis} of length {size}", fix)
    if np.linalg.matrix_rank(v) < model.p:
        fix = "An output without noise gives its derivatives exactly."
        raise refuse("kalman_floor", "noise", v.tolist(), "V with V V' > 0", fix)
    return e, w, v


def _covariance(a: np.ndarray, c: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray | None:
    """The stabilising solution, None where there is none."""
    try:
        s = scipy.linalg.solve_continuous_are(a.T, c.T, q, r)
    except (np.linalg.LinAlgError, ValueError):
        return None
    closed = a - s @ c.T @ np.linalg.solve(r, c)
    return (s + s.T) / 2 if np.all(np.isfinite(s)) and np.max(np.linalg.eigvals(closed).real) < 0 else None


def _filtered(place: Frame, rho: np.ndarray, w: np.ndarray, v: np.ndarray) -> np.ndarray | None:
    """The covariance of the filter, computed in the coordinates and the time in which the model is balanced."""
    w = np.linalg.solve(place.t, w)
    s = _covariance(place.model.at(rho), place.model.output, w @ w.T / place.speed, v @ v.T * place.speed)
    return None if s is None else place.t @ s @ place.t.T


def _search(model: Polytope, level: Any, start: np.ndarray) -> tuple[float, np.ndarray]:
    """A local maximum over the box, from its worst vertex."""
    first = [model.tied.index(k) for k in model.tied]
    own = sorted(set(first))
    width = np.where(model.upper > model.lower, model.upper - model.lower, 1.0)

    def at(shares: np.ndarray) -> np.ndarray:
        rho = model.lower + np.array([shares[own.index(k)] for k in first]) * (model.upper - model.lower)
        return np.clip(rho, model.lower, model.upper)

    def cost(shares: np.ndarray) -> float:
        value = level(at(shares))
        return -np.log(value) if value > 0 else 1e3

    shares = ((start - model.lower) / width)[own]
    options = {"maxfev": EVALUATIONS, "xtol": 1e-4, "ftol": 1e-6}
    found = scipy.optimize.minimize(cost, shares, method="Powell", bounds=[(0, 1)] * len(own), options=options)
    rho = at(found.x) if found.fun < cost(shares) else start
    return level(rho), rho


def _certified(model, place, rho, e, w, v) -> KalmanFloor | None:
    """The filter's covariance a little below the solution, in the coordinates where that is the identity."""
    a, c, q, r = model.at(rho), model.output, w @ w.T, v @ v.T
    s = _filtered(place, rho, w, v)
    if s is None:
        return None
    size = np.diagonal(s) + 1e-12 * max(float(np.max(np.diagonal(s))), 1e-290)
    t = np.diag(np.sqrt(size))
    values, vectors = np.linalg.eigh(np.linalg.solve(t, np.linalg.solve(t, s).T))
    t = t @ vectors * np.sqrt(np.maximum(values, 1e-9))
    inverse = np.linalg.inv(t)
    a, c, q = inverse @ a @ t, c @ t, inverse @ q @ inverse.T
    speed = float(np.linalg.norm(a, 2))
    for shrink in SHRINKS:
        below = _covariance(a, c, q - shrink * speed * np.eye(model.n), r)
        if below is None:
            continue
        below = t @ below @ t.T
        below = (below + below.T) / 2
        level = float(np.trace(e @ below @ e.T)) * (1 - 1e-12)
        fields = model.fields() | {"rho": as_tuples(rho), "s": as_tuples(below), "level": level}
        certificate = KalmanFloor(**fields, weight=as_tuples(e), process=as_tuples(w), noise=as_tuples(v))
        if level > 0 and certificate.verify():
            return certificate
    return None
