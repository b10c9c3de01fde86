"""Rules that move numbers without changing them: both endpoints are moved alike."""

from collections.abc import Callable
from typing import Any

import numpy as np

from jaxobs.intervals.interval import Interval, interval, point
from jaxobs.intervals.table import Call, rule


def moved(move: Callable[[np.ndarray], np.ndarray], x: Interval) -> Interval:
    """Both ends moved alike."""
    lower = move(x.lower)
    return interval(lower, lower if x.upper is x.lower else move(x.upper))


def joined(join: Callable[..., np.ndarray], *args: Interval) -> Interval:
    """The lower ends joined, and the upper ones."""
    return interval(join(*[x.lower for x in args]), join(*[x.upper for x in args]))


def axes_of(value: Any) -> tuple[int, ...]:
    """As Python integers."""
    return tuple(int(a) for a in value)


@rule("reshape", "squeeze")
def _reshape(call: Call, x: Interval) -> Interval:
    """In row-major order; of the axes in another order where a reshape names one, as those that batching leaves do."""
    order = call.params.get("dimensions") if call.name == "reshape" else None
    return moved(lambda z: np.reshape(z if order is None else np.transpose(z, axes_of(order)), call.shape), x)


@rule("transpose")
def _transpose(call: Call, x: Interval) -> Interval:
    return moved(lambda z: np.transpose(z, axes_of(call.params["permutation"])), x)


@rule("broadcast_in_dim")
def _broadcast_in_dim(call: Call, x: Interval, *_: Interval) -> Interval:
    shape = [1] * len(call.shape)
    for size, axis in zip(x.shape, call.params["broadcast_dimensions"], strict=True):
        shape[int(axis)] = size
    return moved(lambda z: np.broadcast_to(np.reshape(z, shape), call.shape), x)


@rule("slice")
def _slice(call: Call, x: Interval) -> Interval:
    starts, stops = call.params["start_indices"], call.params["limit_indices"]
    strides = call.params["strides"] or (1,) * x.ndim
    index = tuple(slice(int(a), int(b), int(c)) for a, b, c in zip(starts, stops, strides, strict=True))
    return moved(lambda z: z[index], x)


@rule("split")
def _split(call: Call, x: Interval) -> list[Interval]:
    ends = np.cumsum([int(size) for size in call.params["sizes"]])
    axis = int(call.params["axis"])
    before = (slice(None),) * axis
    return [x[(*before, slice(end - int(n), end))] for end, n in zip(ends, call.params["sizes"], strict=True)]


@rule("concatenate")
def _concatenate(call: Call, *args: Interval) -> Interval:
    return joined(lambda *z: np.concatenate(z, axis=int(call.params["dimension"])), *args)


@rule("stack")
def _stack(call: Call, *args: Interval) -> Interval:
    return joined(lambda *z: np.stack(z, axis=int(call.params["axis"])), *args)


@rule("unstack")
def _unstack(call: Call, x: Interval) -> list[Interval]:
    axis = int(call.params["axis"])
    return [moved(lambda z, i=i: np.take(z, i, axis=axis), x) for i in range(x.shape[axis])]


@rule("tile")
def _tile(call: Call, x: Interval) -> Interval:
    return moved(lambda z: np.tile(z, axes_of(call.params["reps"])), x)


@rule("rev")
def _rev(call: Call, x: Interval) -> Interval:
    return moved(lambda z: np.flip(z, axes_of(call.params["dimensions"])), x)


@rule("iota")
def _iota(call: Call, *_: Interval) -> Interval:
    axis = int(call.params["dimension"])
    along = np.arange(call.shape[axis], dtype=np.float64)
    return point(np.broadcast_to(along.reshape([-1 if i == axis else 1 for i in range(len(call.shape))]), call.shape))


@rule("pad")
def _pad(call: Call, x: Interval, padding: Interval) -> Interval:
    """Edges may be negative (cut) and the interior spread."""

    def pad(z: np.ndarray, value: np.ndarray) -> np.ndarray:
        config = [tuple(int(n) for n in edge) for edge in call.params["padding_config"]]
        spread = [max(0, size + max(0, size - 1) * gap) for size, (_, _, gap) in zip(z.shape, config, strict=True)]
        full = np.full([max(low, 0) + n + max(high, 0) for n, (low, high, _) in zip(spread, config, strict=True)], value)
        full[tuple(slice(max(low, 0), max(low, 0) + n, gap + 1) for n, (low, _, gap) in zip(spread, config, strict=True))] = z
        return full[tuple(slice(max(-low, 0), n + min(high, 0)) for n, (low, high, _) in zip(full.shape, config, strict=True))]

    return joined(pad, x, padding)


@rule("sort")
def _sort(call: Call, *args: Interval) -> list[Interval]:
    """The k-th least number does not decrease when any number grows; what is sorted along with the numbers goes with them
    where their order is certain, and may be any of its kind elsewhere."""
    if call.params["num_keys"] > 1:
        raise call.refuse("sorts by several keys", "Sort by one.")
    axis, (key, *others) = int(call.params["dimension"]), args
    order = np.argsort(key.lower, axis=axis, kind="stable")
    at = moved(lambda z: np.moveaxis(np.take_along_axis(z, order, axis), axis, 0), key)
    apart = (at.upper[:-1] < at.lower[1:]) | ((at.upper[:-1] == at.lower[1:]) & (at.lower[:-1] == at.upper[1:]))
    certain = np.expand_dims(np.all(apart, axis=0), axis)
    found = [moved(lambda z: np.sort(z, axis=axis), key)]
    for other in others:
        along = moved(lambda z: np.take_along_axis(z, order, axis), other)
        lower, upper = np.min(other.lower, axis, keepdims=True), np.max(other.upper, axis, keepdims=True)
        found.append(interval(np.where(certain, along.lower, lower), np.where(certain, along.upper, upper)))
        if not np.all(certain):
            call.jump("an order")
    return found
