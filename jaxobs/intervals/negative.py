"""Whether a function is negative on a box, or on a surface in it: the step from enclosures to invariant sets.

Where coordinates have no end, the function has to be a concave quadratic of them up to what an enclosure of its second
derivatives allows; where they are bounded, the box is halved.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs.intervals.interval import Interval
from jaxobs.intervals.jaxpr import trace
from jaxobs.intervals.ranges import enclosures
from jaxobs.intervals.search import mean_value, middle_of

AT_ONCE = 64


@dataclasses.dataclass(frozen=True)
class Negative:
    """holds: whether it is proved. boxes: how many were evaluated. where: a box (lower, upper) on which it was not, if any."""

    holds: bool
    boxes: int
    where: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    def __bool__(self) -> bool:
        return self.holds


def is_negative(
    g: Callable[[Any], Any],
    box: Interval,
    *,
    on: Callable[[Any], Any] | None = None,
    centre: Any = None,
    max_boxes: int = 20_000,
) -> Negative:
    """Whether g(z) < 0 for all z (N,) in the box, or for those with on(z) = 0: by halving bounded coordinates until on each
    piece g < 0 by its natural extension or mean value form, or on != 0, or, Z = (X, W) with X unbounded and H enclosing the
    second derivatives along x,

        [ 2 g(c, W)    g_x(c, W)' ]
        [ g_x(c, W)    H(X, W)    ]  < 0,      which says 2 g(z) = 2 g(c, w) + 2 g_x'(x - c) + (x - c)'H(x - c) < 0,

    decided by interval elimination (all pivots). centre: c for unbounded coordinates, (N,), 0 if not given. False is no proof
    of the contrary. Source: Moore, Kearfott and Cloud, 2009, chapters 6 and 7.
    """
    n = box.lower.size
    enclose = enclosures(lambda z: jnp.stack([one(z) for one in (g, on) if one is not None]), n)
    box = _without_idle(enclose, box)
    far = np.flatnonzero(np.isinf(box.lower) | np.isinf(box.upper))
    concave = _concave(g, far, np.zeros(n) if centre is None else np.asarray(centre, float)) if far.size else None
    lower, upper, used = box.lower[None], box.upper[None], 0
    while len(lower):
        low, high, lower, upper = lower[-AT_ONCE:], upper[-AT_ONCE:], lower[:-AT_ONCE], upper[:-AT_ONCE]
        used += len(low)
        undecided, refuted = _undecided(enclose, low, high)
        open_ = np.flatnonzero(undecided)
        if concave is not None:
            open_ = np.array([k for k in open_ if not concave(low[k], high[k])], int)
        if not open_.size:
            continue
        low, high, refuted = low[open_], high[open_], refuted[open_]
        middle = middle_of(low, high)
        if concave is not None:  # what fails at a point of the bounded coordinates fails on every piece around it
            at_low, at_high = middle.copy(), middle.copy()
            at_low[:, far], at_high[:, far] = low[:, far], high[:, far]
            refuted = np.array([not concave(a, b) for a, b in zip(at_low, at_high, strict=True)], bool)
        width = np.where((low < middle) & (middle < high), high - low, -1.0)
        width[:, far] = -1.0
        if np.any(stuck := refuted | (width.max(axis=1) < 0)) or used >= max_boxes:
            k = int(np.argmax(stuck))
            return Negative(False, used, (tuple(low[k].tolist()), tuple(high[k].tolist())))
        rows, axis = np.arange(len(low)), np.argmax(width, axis=1)
        left, right = high.copy(), low.copy()
        left[rows, axis] = right[rows, axis] = middle[rows, axis]
        lower, upper = np.concatenate([lower, low, right]), np.concatenate([upper, left, high])
    return Negative(True, used)


def _without_idle(enclose, box: Interval) -> Interval:
    """The box, with a point for each coordinate along which all slopes are exactly 0."""
    _, _, slope_low, slope_high = enclose(box.lower[None], box.upper[None])
    idle = np.all((slope_low[0] == 0) & (slope_high[0] == 0), axis=0)
    middle = middle_of(box.lower, box.upper)
    return Interval(np.where(idle, middle, box.lower), np.where(idle, middle, box.upper))


def _undecided(enclose, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The boxes on which neither g < 0 nor on != 0 is seen, and those where g >= 0 is, at the middle."""
    middle, count = middle_of(lower, upper), len(lower)
    low, high, slope_low, slope_high = enclose(np.concatenate([lower, middle]), np.concatenate([upper, middle]))

    def above(k: int, sign: int) -> np.ndarray:
        """An upper bound of sign times the k-th function."""
        values, slopes = (high, (slope_low, slope_high)) if sign > 0 else (-low, (-slope_high, -slope_low))
        mean = mean_value(values[count:, k], middle, lower, upper, *(one[:count, k] for one in slopes))
        return np.minimum(values[:count, k], mean)

    done = above(0, 1) < 0
    if low.shape[1] == 1:
        return ~done, low[count:, 0] >= 0
    return ~(done | (above(1, 1) < 0) | (above(1, -1) < 0)), np.zeros(count, bool)


def _concave(g: Callable[[Any], Any], far: np.ndarray, centre: np.ndarray) -> Callable[[np.ndarray, np.ndarray], bool]:
    """Whether g < 0 on a box by its second derivatives along the unbounded coordinates `far`."""
    units = np.eye(len(centre))[far]

    def along(z):
        return jnp.stack([jax.jvp(g, (z,), (jnp.asarray(unit, z.dtype),))[1] for unit in units])

    first = trace(lambda z: (g(z), along(z)), jax.ShapeDtypeStruct(centre.shape, np.float64))
    second = trace(lambda z: jax.jacfwd(along)(z), jax.ShapeDtypeStruct(centre.shape, np.float64))

    def concave(lower: np.ndarray, upper: np.ndarray) -> bool:
        low, high = lower.copy(), upper.copy()
        low[far] = high[far] = centre[far]
        start, bent = first(Interval(low, high)), second(Interval(lower, upper))
        if start.assumptions or bent.assumptions:
            return False
        (value, slope), hessian = start.value, bent.value[:, far]
        enters = np.flatnonzero(np.any(hessian.magnitude > 0, axis=1) | (slope.magnitude > 0))
        size = 1 + len(enters)
        ends = np.zeros((2, size, size))
        for end, side in zip(ends, ("lower", "upper"), strict=True):
            end[0, 0] = 2 * getattr(value, side)
            end[0, 1:] = end[1:, 0] = getattr(slope, side)[enters]
            end[1:, 1:] = getattr(hessian, side)[np.ix_(enters, enters)]
        return bool(np.all(np.isfinite(ends))) and is_positive_definite(Interval(-ends[1], -ends[0]))

    return concave


def is_positive_definite(matrix: Interval) -> bool:
    """Whether every symmetric matrix (n, n) in an interval matrix is positive definite: all pivots of the elimination are."""
    while matrix.shape[0]:
        pivot, row, column = matrix[:1, :1], matrix[:1, 1:], matrix[1:, :1]
        if not pivot.lower[0, 0] > 0:
            return False
        matrix = matrix[1:, 1:] - column * (row / pivot)
    return True
