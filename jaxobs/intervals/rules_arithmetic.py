"""Rules of arithmetic and of elementary functions, entry by entry."""

import numpy as np

from jaxobs.intervals import elementary
from jaxobs.intervals.interval import Interval, divide, interval, point, power, sqrt, where, whole
from jaxobs.intervals.rounding import Numbers
from jaxobs.intervals.rules_structure import moved
from jaxobs.intervals.table import RULES, Call, exactly, rule, truth, within


@rule("add", "add_any")
def _add(call: Call, x: Interval, y: Interval) -> Interval:
    if call.same(0, 1):
        return within(call, x * point(2.0))
    return within(call, x + y)


@rule("sub")
def _sub(call: Call, x: Interval, y: Interval) -> Interval:
    if call.same(0, 1):  # z - z, not a difference of two numbers
        return point(np.zeros(call.shape))
    return within(call, x - y)


@rule("mul")
def _mul(call: Call, x: Interval, y: Interval) -> Interval:
    if call.same(0, 1):
        return within(call, x**2)
    return within(call, x * y)


@rule("div")
def _div(call: Call, x: Interval, y: Interval) -> Interval:
    if bool(np.any(y.contains(0.0))):
        call.undefined("a denominator is not 0")
    quotient = x / y
    if call.dtype.kind in "iu":  # towards zero
        return within(call, interval(np.trunc(quotient.lower), np.trunc(quotient.upper)))
    return point(np.ones(call.shape)) if call.same(0, 1) else quotient


@rule("rem")
def _rem(call: Call, x: Interval, y: Interval) -> Interval:
    """x - y trunc(x / y), of the sign of x and smaller than |y|."""
    if x.is_point and y.is_point and call.dtype.kind in "iu":
        with np.errstate(all="ignore"):
            return exactly(np.fmod, x, y)
    if bool(np.any(y.contains(0.0))):
        call.undefined("a denominator is not 0")
    turns = x / y
    turns = interval(np.trunc(turns.lower), np.trunc(turns.upper))
    single = (turns.lower == turns.upper) & np.isfinite(turns.lower)
    if not np.all(single) and call.dtype.kind == "f":
        call.jump("the remainder wraps")
    size = y.magnitude
    low, high = np.where(x.lower >= 0, 0.0, np.maximum(-size, x.lower)), np.where(x.upper <= 0, 0.0, np.minimum(size, x.upper))
    shape = np.broadcast_shapes(low.shape, high.shape)
    wraps = interval(np.broadcast_to(low, shape), np.broadcast_to(high, shape))
    safe = interval(np.where(single, turns.lower, 0.0), np.where(single, turns.upper, 0.0))
    inside = x - y * safe
    found = where(single, inside, wraps)
    return interval(np.maximum(found.lower, low), np.minimum(found.upper, high))


@rule("neg")
def _neg(call: Call, x: Interval) -> Interval:
    return within(call, -x)


@rule("abs")
def _abs(call: Call, x: Interval) -> Interval:
    return within(call, abs(x))


@rule("square")
def _square(call: Call, x: Interval) -> Interval:
    return within(call, x**2)


@rule("integer_pow")
def _integer_pow(call: Call, x: Interval) -> Interval:
    n = int(call.params["y"])
    if n < 0 and bool(np.any(x.contains(0.0))):
        call.undefined("a denominator is not 0")
    return within(call, power(x, n))


@rule("pow")
def _pow(call: Call, x: Interval, y: Interval) -> Interval:
    """x^y: by products for an integer exponent; by arb for a real one, where x >= 0."""
    x, y = (moved(lambda z: np.broadcast_to(z, call.shape), z) for z in (x, y))
    if bool(np.any(x.contains(0.0) & (y.lower < 0))):
        call.undefined("a denominator is not 0")
    integer = (y.lower == y.upper) & (y.lower == np.rint(y.lower)) & np.isfinite(y.lower)
    found = whole(call.shape)
    if not np.all(integer):
        if bool(np.any((x.lower < 0) & ~integer)):
            call.undefined("the base of a real power is >= 0")
        # an uncertain exponent may be an integer, which a negative base allows
        found = where((x.lower < 0) & (y.lower != y.upper), found, elementary.real_power(x, y))
    for n in np.unique(y.lower[integer]):
        found = where(integer & (y.lower == n), power(x, int(n)), found)
    return within(call, found)


@rule("sqrt")
def _sqrt(call: Call, x: Interval) -> Interval:
    if bool(np.any(x.lower < 0)):
        call.undefined("the argument of sqrt is >= 0")
    return sqrt(x)


@rule("rsqrt")
def _rsqrt(call: Call, x: Interval) -> Interval:
    if bool(np.any(x.lower <= 0)):
        call.undefined("the argument of rsqrt is > 0")
    return divide(point(np.ones(x.shape)), sqrt(x))


@rule(*elementary.MONOTONE)
def _monotone(call: Call, x: Interval) -> Interval:
    form = elementary.MONOTONE[call.name]
    if not form.defined(x):
        call.undefined(f"the argument of {call.name} lies in {list(form.domain)}")
    return form(call.name, x)


@rule("sin", "cos")
def _wave(call: Call, x: Interval) -> Interval:
    return elementary.wave(call.name, x)


@rule("tan")
def _tan(call: Call, x: Interval) -> Interval:
    found = elementary.tan(x)
    if bool(np.any(np.isinf(found.lower))):
        call.undefined("the argument of tan is not a pole")
    return found


@rule("cosh")
def _cosh(_: Call, x: Interval) -> Interval:
    return elementary.cosh(x)


@rule("atan2")
def _atan2(call: Call, y: Interval, x: Interval) -> Interval:
    found, jumps = elementary.atan2(y, x)
    if bool(np.any(jumps)):
        call.jump("the angle of atan2 wraps")
    return found


@rule("max")
def _max(_: Call, x: Interval, y: Interval) -> Interval:
    return interval(np.maximum(x.lower, y.lower), np.maximum(x.upper, y.upper))


@rule("min")
def _min(_: Call, x: Interval, y: Interval) -> Interval:
    return interval(np.minimum(x.lower, y.lower), np.minimum(x.upper, y.upper))


@rule("clamp")
def _clamp(_: Call, low: Interval, x: Interval, high: Interval) -> Interval:
    lower = np.minimum(np.maximum(x.lower, low.lower), high.lower)
    return interval(lower, np.minimum(np.maximum(x.upper, low.upper), high.upper))


def _steps(name: str, function: np.ufunc, what: str) -> None:
    """A step function: monotone, constant between its jumps."""

    def apply(call: Call, x: Interval) -> Interval:
        found = interval(function(x.lower), function(x.upper))
        if not found.is_point and call.dtype.kind == "f":
            call.jump(what)
        return found

    RULES[name] = apply


_steps("sign", np.sign, "the sign of a number")
_steps("floor", np.floor, "floor")
_steps("ceil", np.ceil, "ceil")


@rule("round")
def _round(call: Call, x: Interval) -> Interval:
    """To the nearest integer, halves to the even one or away from zero."""
    function = np.rint if int(call.params["rounding_method"]) == 1 else _half_away
    found = interval(function(x.lower), function(x.upper))
    if not found.is_point:
        call.jump("rounding")
    return found


def _half_away(x: Numbers) -> Numbers:
    size = np.abs(x)
    with np.errstate(invalid="ignore"):  # inf - inf
        return np.copysign(np.floor(size) + (size - np.floor(size) >= 0.5), x)


@rule("is_finite")
def _is_finite(_: Call, x: Interval) -> Interval:
    bounded = np.isfinite(x.lower) & np.isfinite(x.upper)
    return truth(bounded, np.isinf(x.lower) & (x.lower == x.upper))


@rule("stop_gradient", "copy", "name", "optimization_barrier", "reduce_precision", "device_put")
def _same(_: Call, *args: Interval) -> tuple[Interval, ...]:
    """The same numbers; what a lower precision would round away is no part of the function of real numbers."""
    return args
