"""Rules of comparisons, switches, truth values, integers' bits and conversions: True, False, or undecided."""

from collections.abc import Callable
from typing import Any

import numpy as np

from jaxobs.intervals.interval import Interval, interval
from jaxobs.intervals.table import RULES, Call, exactly, reduced_extreme, rule, same, truth, undecided, within


def _less(x: Interval, y: Interval) -> Interval:
    return truth(x.upper < y.lower, x.lower >= y.upper)


def _less_equal(x: Interval, y: Interval) -> Interval:
    return truth(x.upper <= y.lower, x.lower > y.upper)


def _equal(x: Interval, y: Interval) -> Interval:
    one = (x.lower == x.upper) & (y.lower == y.upper) & (x.lower == y.lower)
    return truth(one, (x.upper < y.lower) | (x.lower > y.upper))


def _not(x: Interval) -> Interval:
    return interval(1.0 - x.upper, 1.0 - x.lower)


_COMPARE: dict[str, tuple[Callable[[Interval, Interval], Interval], float]] = {  # with the answer for z against itself
    "lt": (_less, 0.0),
    "le": (_less_equal, 1.0),
    "lt_to": (_less, 0.0),  # the total order of floats, in which only zeros of two signs and NaN differ
    "le_to": (_less_equal, 1.0),
    "gt": (lambda x, y: _less(y, x), 0.0),
    "ge": (lambda x, y: _less_equal(y, x), 1.0),
}


@rule(*_COMPARE)
def _compare(call: Call, x: Interval, y: Interval) -> Interval:
    decide, itself = _COMPARE[call.name]
    if call.same(0, 1):
        return Interval(np.full(call.shape, itself), np.full(call.shape, itself))
    return decide(x, y)


@rule("eq", "ne")
def _eq(call: Call, x: Interval, y: Interval) -> Interval:
    """x = y; an operand against its own maximum or minimum compares the operands, as in the derivative of max."""
    if call.same(0, 1):
        found = Interval(np.ones(call.shape), np.ones(call.shape))
    else:
        found = _extreme(call, 0, 1, x) or _extreme(call, 1, 0, y) or _equal(x, y)
    return found if call.name == "eq" else _not(found)


def _extreme(call: Call, i: int, j: int, x: Interval) -> Interval | None:
    """x = max(x, y) <=> y <= x, and the same for min, where argument j is that maximum; None elsewhere."""
    name, axes = reduced_extreme(call.defined_by, call.eqn.invars[i], call.eqn.invars[j])
    if axes:
        return _is_extreme(x if name == "reduce_max" else -x, axes)
    eqn = call.definition(j)
    if eqn is None or eqn.primitive.name not in ("max", "min"):
        return None
    own = [same(call.eqn.invars[i], v) for v in eqn.invars]
    if not any(own):
        return None
    other = call.value(eqn.invars[own.index(False)]) if False in own else x
    return _less_equal(other, x) if eqn.primitive.name == "max" else _less_equal(x, other)


def _is_extreme(x: Interval, axes: tuple[int, ...]) -> Interval:
    """x_i = max x: certain where x_i is at least every other, excluded where some other is greater."""
    sides = tuple(n if i in axes else 1 for i, n in enumerate(x.shape))
    others = np.full(x.shape, -np.inf)
    for place in np.ndindex(*sides):
        here = np.zeros(sides, dtype=bool)
        here[place] = True
        rest = np.max(np.where(here, -np.inf, x.upper), axis=axes, keepdims=True)
        others = np.where(here, rest, others)
    return truth(x.lower >= others, x.upper < np.max(x.lower, axis=axes, keepdims=True))


@rule("select_n")
def _select_n(call: Call, which: Interval, *cases: Interval) -> Interval:
    """The case chosen; the hull of those that may be, where that is undecided."""
    lower, upper = np.full(call.shape, np.inf), np.full(call.shape, -np.inf)
    for i, case in enumerate(cases):
        possible = (which.lower <= i) & (i <= which.upper)
        lower = np.where(possible, np.minimum(lower, case.lower), lower)
        upper = np.where(possible, np.maximum(upper, case.upper), upper)
    if bool(np.any((which.lower != which.upper) & (lower != upper))) and call.dtype.kind != "b":
        call.jump("a switch")
    return interval(lower, upper)


def _logic(name: str, certain: Callable[..., Any], bits: Callable[..., Any]) -> None:
    """A logical operation, monotone in each truth value up to `not`; on integers, an operation on exact bits."""

    def apply(call: Call, *args: Interval) -> Interval:
        if call.dtype.kind == "b":
            return certain(*args)
        if any(undecided(x) for x in args):
            info = np.iinfo(call.dtype)
            return Interval(np.full(call.shape, float(info.min)), np.full(call.shape, float(info.max)))
        return exactly(lambda *z: bits(*[a.astype(call.dtype) for a in z]).astype(call.dtype), *args)

    RULES[name] = apply


def _and(x: Interval, y: Interval) -> Interval:
    return interval(np.minimum(x.lower, y.lower), np.minimum(x.upper, y.upper))


def _or(x: Interval, y: Interval) -> Interval:
    return interval(np.maximum(x.lower, y.lower), np.maximum(x.upper, y.upper))


_logic("and", _and, np.bitwise_and)
_logic("or", _or, np.bitwise_or)
_logic("xor", lambda x, y: _or(_and(x, _not(y)), _and(_not(x), y)), np.bitwise_xor)
_logic("not", _not, np.bitwise_not)
_logic("shift_left", _and, np.left_shift)
_logic("shift_right_arithmetic", _and, np.right_shift)
_logic("shift_right_logical", _and, lambda x, n: np.right_shift(*[z.astype(f"u{z.dtype.itemsize}") for z in (x, n)]))


@rule("convert_element_type")
def _convert(call: Call, x: Interval) -> Interval:
    """The same number: floats of every precision stand for real numbers; floats lose their fraction as integers."""
    source, target = call.dtype_in(0).kind, call.dtype.kind
    if source == "b" and target != "b" and undecided(x):
        call.jump("a truth value used as a number")
    if target == "b" and source != "b":
        return truth((x.lower > 0) | (x.upper < 0), (x.lower == 0) & (x.upper == 0))
    if target in "iu" and source not in "iub":
        x = interval(np.trunc(x.lower), np.trunc(x.upper))
        if undecided(x):
            call.jump("an integer part")
    return within(call, x)


@rule("reduce_and")
def _reduce_and(call: Call, x: Interval) -> Interval:
    axes = tuple(int(a) for a in call.params["axes"])
    return interval(np.min(x.lower, axis=axes, initial=1.0), np.min(x.upper, axis=axes, initial=1.0))


@rule("reduce_or")
def _reduce_or(call: Call, x: Interval) -> Interval:
    axes = tuple(int(a) for a in call.params["axes"])
    return interval(np.max(x.lower, axis=axes, initial=0.0), np.max(x.upper, axis=axes, initial=0.0))
