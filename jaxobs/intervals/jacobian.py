"""Bounds on the entries of a Jacobian over a box, from both sides: what a design by the mean value theorem stands on."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse
from jaxobs.intervals import graph
from jaxobs.intervals.declared import require_derivatives
from jaxobs.intervals.formula_ranges import formula_ranges
from jaxobs.intervals.interval import Interval, whole
from jaxobs.intervals.jaxpr import trace
from jaxobs.intervals.ranges import Ranges, ranges
from jaxobs.intervals.search import middle_of
from jaxobs.intervals.table import UnknownPrimitiveError

PIECES = 512  # boxes in which it is asked whether f is defined


@dataclasses.dataclass(frozen=True)
class JacobianBounds:
    """lower_ij <= df_i/dx_j <= upper_ij on the box, all (q, n), where df_i/dx_j takes values <= inner_lower and >= inner_upper.

    Outer and inner bounds are proved: an inner bound is the safe side of an enclosure of a value at a point of the box. The gap
    between the two is all that further bisection could gain. zeros (q, n): entries that vanish for every x and u, by an
    enclosure [0, 0]. assumptions: where f may jump or be undefined. boxes: how many were evaluated.
    """

    lower: np.ndarray
    upper: np.ndarray
    inner_lower: np.ndarray
    inner_upper: np.ndarray
    zeros: np.ndarray
    assumptions: tuple[str, ...]
    boxes: int

    @property
    def gap(self) -> np.ndarray:
        """The larger of inner_lower - lower and upper - inner_upper, relative to the largest |value| that is attained."""
        size = np.maximum(np.abs(self.inner_lower), np.abs(self.inner_upper))
        gap = np.zeros(self.lower.shape)
        for outer, inner in ((self.lower, self.inner_lower), (self.upper, self.inner_upper)):
            apart = outer != inner
            gap[apart] = np.maximum(gap[apart], np.abs(inner[apart] - outer[apart]))
        return np.divide(
            gap, size, out=np.where(gap == 0, 0.0, np.inf), where=(size > 0) & np.isfinite(size) & np.isfinite(gap)
        )


def jacobian_bounds(f: Callable[..., Any], box: Any, rtol: float = 1e-6, max_boxes: int = 20_000) -> JacobianBounds:
    """Bounds on every entry of df/dx over a box, by best-first bisection (`search`) to rtol or to max_boxes in all.

    f: x (n,) -> (q,), or (x, u, ...) -> (q,), differentiated with respect to x. box: (lower, upper) or an Interval for x, or
    one Interval an argument of f; infinite ends are allowed. Entries that are constant, or that one enclosure settles, need no
    bisection; each of the others has its own (proportional ones share it), of its exact formula where there is one, over one
    period of sines and cosines, with second derivatives for the faces and the mean value form

        J_ij(Z) in J_ij(m) + sum_k dJ_ij/dz_k(Z) (Z_k - m_k),      z = (x, u, ...).

    Entries that nothing bounds come back infinite. UnknownPrimitiveError names what intervals cannot follow; ValueError for
    boxes that do not fit and for derivatives that are declared (`require_derivatives`). Source: Moore, Kearfott and Cloud,
    Introduction to Interval Analysis, 2009, chapters 6 and 11; Hansen and Walster, Global Optimization Using Interval Analysis,
    2004, chapter 12.
    """
    parts = _parts(box)
    flat = _flattened(f, [part.shape for part in parts])
    z = Interval(*(np.concatenate([getattr(part, side).ravel() for part in parts]) for side in ("lower", "upper")))
    require_derivatives("jacobian_bounds", flat, z.lower.size)
    n, program = parts[0].lower.size, trace(jax.jacfwd(flat), z)
    matrix, everywhere = (program(at).value[:, :n] for at in (z, whole(z.shape)))
    once = program(_centre(z))
    middle = whole(matrix.shape) if once.undefined else once.value[:, :n]
    bounds = [matrix.lower.copy(), matrix.upper.copy(), middle.upper.copy(), middle.lower.copy()]
    zeros = (everywhere.lower == 0) & (everywhere.upper == 0)
    places = np.nonzero(~(bounds[1] - bounds[0] <= rtol * middle.mignitude))
    used = 1
    if places[0].size:
        found = _searched(flat, z, places, rtol=rtol, max_boxes=max_boxes - 1)
        used += found.boxes
        for bound, value, tighter in zip(bounds, found[:4], (np.fmax, np.fmin, np.fmin, np.fmax), strict=True):
            bound[places] = tighter(bound[places], value)
    lower, upper, inner_lower, inner_upper = bounds
    return JacobianBounds(lower, upper, inner_lower, inner_upper, zeros, assumptions(flat, z), used)


def _searched(
    flat: Callable[[Any], Any], z: Interval, places: tuple[np.ndarray, ...], *, rtol: float, max_boxes: int
) -> Ranges:
    """The ranges of some entries: of their exact formulas, or where f has none, of the program as it is."""
    try:
        slopes = graph.jacobian(flat, z.lower.size)
    except UnknownPrimitiveError:
        at = tuple(index.astype(np.int32) for index in places)
        return ranges(lambda x: jax.jacfwd(flat)(x)[at], z, rtol=rtol, max_boxes=max_boxes)
    return formula_ranges(slopes.graph, list(slopes.outputs[places]), z, rtol=rtol, max_boxes=max_boxes)


def assumptions(f: Callable[[Any], Any], z: Interval) -> tuple[str, ...]:
    """What bounds on df/dz over the box take for granted: f continuous where its switches are undecided, and defined."""
    own, slopes = trace(f, z), trace(jax.jacfwd(f), z)
    jumps, holes = own(z).jumps, (*own(z).undefined, *slopes(z).undefined)
    if not holes:
        return jumps
    queue, count = [z], 0
    while queue and count < PIECES:
        piece = queue.pop()
        count += 1
        if own(piece).undefined or slopes(piece).undefined:
            k = int(np.argmax(piece.upper - piece.lower))
            middle = _centre(piece).lower[k]
            if not piece.lower[k] < middle < piece.upper[k]:
                break
            queue += [_with(piece, k, piece.lower[k], middle), _with(piece, k, middle, piece.upper[k])]
    else:
        if not queue:
            return jumps
    return jumps + tuple(dict.fromkeys(f"defined on the box: {hole}" for hole in holes))


def _with(z: Interval, k: int, low: float, high: float) -> Interval:
    lower, upper = z.lower.copy(), z.upper.copy()
    lower[k], upper[k] = low, high
    return Interval(lower, upper)


def _flattened(f: Callable[..., Any], shapes: Sequence[tuple[int, ...]]) -> Callable[[Any], Any]:
    """f of one vector z, (q,)."""
    edges = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])

    def flat(z):
        args = [z[a:b].reshape(shape) for a, b, shape in zip(edges[:-1], edges[1:], shapes, strict=True)]
        return jnp.ravel(f(*args))

    return flat


def _parts(box: Any) -> list[Interval]:
    """One Interval for each argument of f, the first one for x (n,)."""
    if isinstance(box, Interval):
        parts = [box]
    elif isinstance(box, (tuple, list)) and box and all(isinstance(part, Interval) for part in box):
        parts = list(box)
    elif isinstance(box, (tuple, list)) and len(box) == 2:
        parts = [Interval(np.asarray(box[0], float), np.asarray(box[1], float))]
    else:
        fix = "Several arguments take one jaxobs.intervals.Interval each: (Interval(xl, xu), Interval(ul, uu))."
        raise refuse("jacobian_bounds", "box", repr(box), "(lower, upper), an Interval, or one Interval an argument", fix)
    if parts[0].ndim != 1 or parts[0].lower.size == 0:
        raise refuse("jacobian_bounds", "box", f"shape {parts[0].shape} for x", "shape (n,), n >= 1", "x is a vector.")
    return parts


def _centre(z: Interval) -> Interval:
    """A finite point of the box."""
    at = middle_of(z.lower, z.upper)
    return Interval(at, at)
