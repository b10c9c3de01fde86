"""Rules of gather, scatter and dynamic slices: the place in the operand of every number that is read or written.

Places are computed in integers, once, and both endpoints move alike. An index that the box leaves undecided reads the hull of
everything that it may reach.
"""

import functools
import itertools
from collections.abc import Callable, Iterator, Sequence

import jax
import numpy as np

from jaxobs.intervals.interval import Interval, hull, interval, point, whole
from jaxobs.intervals.rules_structure import axes_of, joined, moved
from jaxobs.intervals.table import Call, rule, undecided, within

MAX_CANDIDATES = 256


def candidates(call: Call, index: Interval) -> Iterator[np.ndarray] | None:
    """Every integer index that the box allows, or None where they are too many to try."""
    if not undecided(index):
        return iter([index.lower.astype(np.int64)])
    call.jump("an index")
    axes = tuple(range(index.ndim - 1))  # the last axis holds the components of an index
    spread = np.max(index.upper - index.lower, axis=axes)
    if np.prod(spread + 1) > MAX_CANDIDATES:
        return None
    steps = itertools.product(*[np.arange(n + 1) for n in np.atleast_1d(spread)])
    return (np.minimum(index.lower + np.array(step), index.upper).astype(np.int64) for step in steps)


def places(
    shape: tuple[int, ...], index: np.ndarray, window: tuple[int, ...], window_axes: tuple[int, ...], dropped: tuple[int, ...],
    index_to_axis: tuple[int, ...], batch: tuple[int, ...], batch_of_index: tuple[int, ...], clip: bool,
) -> np.ndarray:  # fmt: skip
    """The flat place in an operand of this shape of every number that is gathered or scattered, -1 for those outside.

    index (*G, k) holds the start of each window in the axes `index_to_axis`; the result has the axes of G, and those of
    the window without `dropped` and `batch` at the positions `window_axes`. With `clip` a window is moved inside.
    """
    group = index.shape[:-1]
    kept = [axis for axis in range(len(shape)) if axis not in (*dropped, *batch)]
    rank = len(group) + len(kept)
    group_axes = [axis for axis in range(rank) if axis not in window_axes]
    full = [0] * rank
    for axis, size in zip(group_axes, group, strict=True):
        full[axis] = size
    for axis, source in zip(window_axes, kept, strict=True):
        full[axis] = window[source]

    def spread(values: np.ndarray | np.integer, axes: list[int] | tuple[int, ...]) -> np.ndarray:
        return np.reshape(values, [full[axis] if axis in axes else 1 for axis in range(rank)])

    flat, inside = np.zeros(full, dtype=np.int64), np.ones(full, dtype=bool)
    for axis, size in enumerate(shape):
        at = np.zeros([1] * rank, dtype=np.int64)
        if axis in index_to_axis:
            start = index[..., index_to_axis.index(axis)]
            if clip:
                start = np.clip(start, 0, size - window[axis])
            at = at + spread(start, group_axes)
        if axis in batch:
            along = batch_of_index[batch.index(axis)]
            at = at + spread(np.arange(group[along]), [group_axes[along]])
        if axis in kept:
            target = window_axes[kept.index(axis)]
            at = at + spread(np.arange(window[axis]), [target])
        flat, inside = flat * size + at, inside & (at >= 0) & (at < size)
    return np.where(inside, flat, -1)


def take(x: Interval, at: np.ndarray, outside: Interval | None = None) -> Interval:
    """The numbers at these places; `outside` (a scalar) where there is none."""
    outside = whole(()) if outside is None else outside
    found = moved(lambda z: np.append(np.ravel(z), 0.0)[at], x)
    if np.all(at >= 0):
        return found
    return interval(np.where(at >= 0, found.lower, outside.lower), np.where(at >= 0, found.upper, outside.upper))


def everything(x: Interval, shape: tuple[int, ...]) -> Interval:
    """The hull of all the numbers, in every entry."""
    return interval(np.full(shape, x.lower.min()), np.full(shape, x.upper.max()))


@rule("gather")
def _gather(call: Call, x: Interval, index: Interval) -> Interval:
    d, mode = call.params["dimension_numbers"], call.params["mode"]
    clip = mode == jax.lax.GatherScatterMode.CLIP
    outside = _fill(call) if mode == jax.lax.GatherScatterMode.FILL_OR_DROP else None
    tried = candidates(call, index)
    if tried is None:
        return everything(x, call.shape) if clip or outside is None else hull(everything(x, call.shape), outside)
    found = []
    for start in tried:
        at = places(
            x.shape, start, axes_of(call.params["slice_sizes"]), axes_of(d.offset_dims), axes_of(d.collapsed_slice_dims),
            axes_of(d.start_index_map), axes_of(d.operand_batching_dims), axes_of(d.start_indices_batching_dims), clip,
        )  # fmt: skip
        if np.any(at < 0) and (outside is None or not np.isfinite(outside.lower)):
            call.undefined("an index is within its array")
        found.append(take(x, at, outside))
    return functools.reduce(hull, found)


def _fill(call: Call) -> Interval:
    """What JAX puts where nothing is read: NaN among floats, True, the least or greatest integer."""
    kind, given = call.dtype.kind, call.params["fill_value"]
    if given is None:
        given = {"f": np.nan, "b": 1.0}.get(kind)
    if given is None:
        given = np.iinfo(call.dtype).min if kind == "i" else np.iinfo(call.dtype).max
    return point(given)


@rule("dynamic_slice")
def _dynamic_slice(call: Call, x: Interval, *starts: Interval) -> Interval:
    """The window that starts here, moved inside the array."""
    tried, sizes = candidates(call, _index(starts)), axes_of(call.params["slice_sizes"])
    if tried is None:
        return everything(x, call.shape)
    return functools.reduce(hull, [take(x, _window(x.shape, start, sizes)) for start in tried])


@rule("dynamic_update_slice")
def _dynamic_update_slice(call: Call, x: Interval, update: Interval, *starts: Interval) -> Interval:
    tried = candidates(call, _index(starts))
    if tried is None:
        return hull(x, everything(update, x.shape))
    return functools.reduce(hull, [_put(x, update, _window(x.shape, start, update.shape)) for start in tried])


def _index(starts: Sequence[Interval]) -> Interval:
    """(k,), one component an axis."""
    return joined(lambda *z: np.array(z, dtype=np.float64).reshape(len(z)), *starts) if starts else point(np.zeros(0))


def _window(shape: tuple[int, ...], start: np.ndarray, sizes: tuple[int, ...]) -> np.ndarray:
    axes = tuple(range(len(shape)))
    return places(shape, start, sizes, axes, (), axes, (), (), clip=True)


def _put(x: Interval, update: Interval, at: np.ndarray) -> Interval:
    """x with these numbers at their places, the last one where several meet; places outside are dropped."""

    def put(z: np.ndarray, values: np.ndarray) -> np.ndarray:
        new = np.ravel(z).copy()
        new[at[at >= 0]] = values[at >= 0]
        return new.reshape(z.shape)

    return joined(put, x, update)


def _accumulate(x: Interval, update: Interval, at: np.ndarray, combine: Callable[[Interval, Interval], Interval]) -> Interval:
    """x with these numbers combined into their places, one of those that meet in a place after the other."""
    kept = np.ravel(at) >= 0
    at, left = np.ravel(at)[kept], moved(lambda z: np.ravel(z)[kept], update)
    lower, upper = np.ravel(x.lower).copy(), np.ravel(x.upper).copy()
    while at.size:
        distinct, first = np.unique(at, return_index=True)
        new = combine(interval(lower[distinct], upper[distinct]), left[first])
        lower[distinct], upper[distinct] = new.lower, new.upper
        rest = np.setdiff1d(np.arange(at.size), first)
        at, left = at[rest], left[rest]
    return interval(lower.reshape(x.shape), upper.reshape(x.shape))


_COMBINE: dict[str, Callable[[Interval, Interval], Interval]] = {
    "scatter-add": lambda x, y: x + y,
    "scatter-sub": lambda x, y: x - y,
    "scatter-mul": lambda x, y: x * y,
    "scatter-min": lambda x, y: interval(np.minimum(x.lower, y.lower), np.minimum(x.upper, y.upper)),
    "scatter-max": lambda x, y: interval(np.maximum(x.lower, y.lower), np.maximum(x.upper, y.upper)),
}


@rule("scatter", *_COMBINE)
def _scatter(call: Call, x: Interval, index: Interval, update: Interval) -> Interval:
    """Numbers put, or combined, into their places; a window that sticks out is dropped whole, or moved inside."""
    d, mode = call.params["dimension_numbers"], call.params["mode"]
    if undecided(index):
        raise call.refuse(
            "the box does not decide an index that is written to",
            "Split the box, or write with jnp.where(jnp.arange(n) == i, value, x).",
        )
    if call.name == "scatter" and call.params["update_jaxpr"] is not None:
        raise call.refuse("applies a function to entries", "Compute the new entries first and set them.")
    inserted, batch, axes = axes_of(d.inserted_window_dims), axes_of(d.operand_batching_dims), axes_of(d.update_window_dims)
    window = [1] * x.ndim
    kept = [axis for axis in range(x.ndim) if axis not in (*inserted, *batch)]
    for axis, source in zip(kept, axes, strict=True):
        window[axis] = update.shape[source]
    at = places(
        x.shape, index.lower.astype(np.int64), tuple(window), axes, inserted, axes_of(d.scatter_dims_to_operand_dims),
        batch, axes_of(d.scatter_indices_batching_dims), clip=mode == jax.lax.GatherScatterMode.CLIP,
    )  # fmt: skip
    at = np.where(np.min(at, axis=axes, keepdims=True) < 0, -1, at) if axes else at
    if np.any(at < 0) and mode == jax.lax.GatherScatterMode.PROMISE_IN_BOUNDS:
        call.undefined("an index is within its array")
    if call.name == "scatter":
        return _put(x, update, at)
    return within(call, _accumulate(x, update, at, _COMBINE[call.name]))
