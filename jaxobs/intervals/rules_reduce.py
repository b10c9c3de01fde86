"""Rules that combine the numbers along axes: sums, products, extremes, and products of arrays."""

import functools
from collections.abc import Callable

import numpy as np

from jaxobs.intervals.interval import Interval, interval, point, total
from jaxobs.intervals.rules_structure import axes_of, moved
from jaxobs.intervals.table import RULES, Call, reduced_extreme, rule, within


@rule("reduce_sum")
def _reduce_sum(call: Call, x: Interval) -> Interval:
    axes = sorted(axes_of(call.params["axes"]), reverse=True)
    found = within(call, functools.reduce(total, axes, x))
    if _marks_an_extreme(call, axes):  # one of them is the extreme
        return interval(np.maximum(found.lower, 1.0), found.upper)
    return found


def _marks_an_extreme(call: Call, axes: list[int]) -> bool:
    """Whether the summands tell where x = max x (or min) along just these axes, as in the derivative of reduce_max."""
    marks = call.definition(0)
    if marks is not None and marks.primitive.name == "convert_element_type":
        marks = call.defined_by.get(marks.invars[0])
    if marks is None or marks.primitive.name != "eq":
        return False
    return sorted(reduced_extreme(call.defined_by, *marks.invars)[1], reverse=True) == axes


@rule("reduce_prod")
def _reduce_prod(call: Call, x: Interval) -> Interval:
    for axis in sorted(axes_of(call.params["axes"]), reverse=True):
        parts = [x[(slice(None),) * axis + (i,)] for i in range(x.shape[axis])]
        one = point(np.ones([n for i, n in enumerate(x.shape) if i != axis]))
        x = functools.reduce(lambda a, b: a * b, parts, one)
    return within(call, x)


@rule("reduce_max")
def _reduce_max(call: Call, x: Interval) -> Interval:
    return moved(lambda z: np.max(z, axis=axes_of(call.params["axes"])), x)


@rule("reduce_min")
def _reduce_min(call: Call, x: Interval) -> Interval:
    return moved(lambda z: np.min(z, axis=axes_of(call.params["axes"])), x)


@rule("argmax", "argmin")
def _argmax(call: Call, x: Interval) -> Interval:
    """From the first to the last place that may hold the extreme."""
    (axis,) = axes_of(call.params["axes"])
    x = x if call.name == "argmax" else -x
    n = x.shape[axis]
    places = np.arange(n).reshape([-1 if i == axis else 1 for i in range(x.ndim)])
    # a place counts when no other is certainly greater, nor an earlier one certainly as great: ties take the first
    greatest = np.max(x.lower, axis=axis, keepdims=True)
    certain = np.min(np.where(x.lower == greatest, places, n), axis=axis, keepdims=True)
    may = np.where(places <= certain, x.upper >= greatest, x.upper > greatest)
    first, last = np.min(np.where(may, places, n), axis=axis), np.max(np.where(may, places, -1), axis=axis)
    if np.any(first != last):
        call.jump("the place of an extreme")
    return interval(first.astype(np.float64), last.astype(np.float64))


def _cumulative(name: str, combine: Callable[[Interval, Interval], Interval]) -> None:
    def apply(call: Call, x: Interval) -> Interval:
        axis, back = int(call.params["axis"]), call.params["reverse"]
        parts = [moved(lambda z, i=i: np.take(z, i, axis=axis), x) for i in range(x.shape[axis])]
        found: list[Interval] = []
        for part in parts[::-1] if back else parts:
            found.append(combine(found[-1], part) if found else part)
        found = found[::-1] if back else found
        if not found:
            return x
        ends = [np.stack([getattr(y, end) for y in found], axis=axis) for end in ("lower", "upper")]
        return within(call, interval(*ends))

    RULES[name] = apply


_cumulative("cumsum", lambda x, y: x + y)
_cumulative("cumprod", lambda x, y: x * y)
_cumulative("cummax", lambda x, y: interval(np.maximum(x.lower, y.lower), np.maximum(x.upper, y.upper)))
_cumulative("cummin", lambda x, y: interval(np.minimum(x.lower, y.lower), np.minimum(x.upper, y.upper)))


@rule("dot_general")
def _dot_general(call: Call, x: Interval, y: Interval) -> Interval:
    """sum over the contracted axes of x y; the result has the batch axes, then those left of x, then those left of y."""
    (contract_x, contract_y), (batch_x, batch_y) = (tuple(map(axes_of, pair)) for pair in call.params["dimension_numbers"])
    free_x = [i for i in range(x.ndim) if i not in (*contract_x, *batch_x)]
    free_y = [i for i in range(y.ndim) if i not in (*contract_y, *batch_y)]
    batch, inner = [x.shape[i] for i in batch_x], [x.shape[i] for i in contract_x]
    outer_x, outer_y = [x.shape[i] for i in free_x], [y.shape[i] for i in free_y]
    left = moved(lambda z: np.transpose(z, (*batch_x, *free_x, *contract_x)), x)
    right = moved(lambda z: np.transpose(z, (*batch_y, *free_y, *contract_y)), y)
    k = int(np.prod(inner, dtype=np.int64))
    left = moved(lambda z: np.reshape(z, (*batch, *outer_x, *[1] * len(outer_y), k)), left)
    right = moved(lambda z: np.reshape(z, (*batch, *[1] * len(outer_x), *outer_y, k)), right)
    return within(call, total(left * right, -1))
