"""Elementary functions at interval endpoints, by the balls of python-flint's arb.

f([l, u]) = [f(l), f(u)] for increasing f; each endpoint value is a ball of 80 bits that contains f(l), whose own ends are
converted to float64 and stepped outward, unless the ball is one float exactly.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import flint
import numpy as np
from flint import arb

from jaxobs.intervals.interval import Interval, interval
from jaxobs.intervals.rounding import Numbers, Truths

PRECISION = 80  # bits
INF = arb("inf")
with flint.ctx.workprec(PRECISION):
    PI = arb.pi()
    HALF_PI = PI / 2
    MINUS_HALF_PI = -HALF_PI


@dataclasses.dataclass(frozen=True)
class Monotone:
    """f on its domain (an interval of the line), with the limits of f at the two ends of the domain."""

    at: Callable[[arb], arb]
    domain: tuple[float, float] = (-math.inf, math.inf)
    limits: tuple[Any, Any] = (-INF, INF)

    def __call__(self, name: str, x: Interval) -> Interval:
        a, b = self.domain
        lower, upper = values(name, np.clip(x.lower, a, b)), values(name, np.clip(x.upper, a, b))
        if self.limits[0] > self.limits[1]:
            lower, upper = upper, lower
        least, greatest = self.range
        nowhere = (x.upper < a) | (x.lower > b)
        low, high = np.maximum(lower[0], least), np.minimum(upper[1], greatest)
        return interval(np.where(nowhere, -np.inf, low), np.where(nowhere, np.inf, high))

    @functools.cached_property
    def range(self) -> tuple[float, float]:
        """The floats around all values."""
        with flint.ctx.workprec(PRECISION):
            ends = [outward(limit) for limit in self.limits]
        return min(lower for lower, _ in ends), max(upper for _, upper in ends)

    def defined(self, x: Interval) -> bool:
        return bool(np.all((x.lower >= self.domain[0]) & (x.upper <= self.domain[1])))


def _cbrt(x: arb) -> arb:
    return -((-x).root(3)) if x < 0 else x.root(3)


def _logistic(x: arb) -> arb:
    return 1 / (1 + (-x).exp()) if x > 0 else x.exp() / (1 + x.exp())


MONOTONE = {
    "exp": Monotone(arb.exp, limits=(arb(0), INF)),
    "exp2": Monotone(lambda x: arb(2) ** x, limits=(arb(0), INF)),
    "expm1": Monotone(arb.expm1, limits=(arb(-1), INF)),
    "log": Monotone(arb.log, (0.0, math.inf)),
    "log1p": Monotone(arb.log1p, (-1.0, math.inf)),
    "tanh": Monotone(arb.tanh, limits=(arb(-1), arb(1))),
    "sinh": Monotone(arb.sinh),
    "asinh": Monotone(arb.asinh),
    "acosh": Monotone(arb.acosh, (1.0, math.inf), (arb(0), INF)),
    "atanh": Monotone(arb.atanh, (-1.0, 1.0)),
    "asin": Monotone(arb.asin, (-1.0, 1.0), (MINUS_HALF_PI, HALF_PI)),
    "acos": Monotone(arb.acos, (-1.0, 1.0), (PI, arb(0))),
    "atan": Monotone(arb.atan, limits=(MINUS_HALF_PI, HALF_PI)),
    "erf": Monotone(arb.erf, limits=(arb(-1), arb(1))),
    "erfc": Monotone(arb.erfc, limits=(arb(2), arb(0))),
    "erf_inv": Monotone(arb.erfinv, (-1.0, 1.0)),
    "logistic": Monotone(_logistic, limits=(arb(0), arb(1))),
    "cbrt": Monotone(_cbrt),
}
ANYWHERE = {"sin": arb.sin, "cos": arb.cos, "tan": arb.tan, "cosh": arb.cosh}


def outward(ball: arb) -> tuple[float, float]:
    """The floats around a ball: its ends, rounded outward; [z, z] for a ball that is the float z."""
    if ball.is_exact() and arb(z := float(ball)) == ball:
        return z, z
    lower, upper = float(ball.lower()), float(ball.upper())
    if math.isnan(lower) or math.isnan(upper):
        return -math.inf, math.inf
    return math.nextafter(lower, -math.inf), math.nextafter(upper, math.inf)


@functools.lru_cache(maxsize=1 << 18)
def _value(name: str, x: float) -> tuple[float, float]:
    """f(x), or its limit where x is an end of the domain at which f itself is not finite."""
    form = MONOTONE.get(name)
    if form is None or x not in form.domain:
        return _at(ANYWHERE[name] if form is None else form.at, x)
    ball = form.at(arb(x)) if math.isfinite(x) else arb("nan")
    return outward(ball if ball.is_finite() else form.limits[form.domain.index(x)])


def _at(f: Callable[[arb], arb], x: float) -> tuple[float, float]:
    """f(x); with more bits next to a zero of f, where those of its argument cancel."""
    ball = f(arb(x))
    if ball.rel_accuracy_bits() < 60:
        with flint.ctx.workprec(20 * PRECISION):
            ball = f(arb(x))
    return outward(ball)


def values(name: str, x: Numbers) -> tuple[Numbers, Numbers]:
    """Lower and upper floats of f at each number, each distinct number once."""
    return _each(functools.partial(_value, name), x)


def _each(f: Callable[..., tuple[float, float]], *args: Numbers) -> tuple[Numbers, Numbers]:
    arrays = np.broadcast_arrays(*args)
    places = list(zip(*[np.ravel(a).tolist() for a in arrays], strict=True))
    with flint.ctx.workprec(PRECISION):
        known = {place: f(*place) for place in set(places)}
    found = np.array([known[place] for place in places], dtype=np.float64).reshape(-1, 2)
    return found[:, 0].reshape(arrays[0].shape), found[:, 1].reshape(arrays[0].shape)


def _passes(x: Interval, phase: float, period: float) -> Truths:
    """Whether an interval may contain phase + k period: certainly where it does, and within a few roundings of it."""
    with np.errstate(all="ignore"):
        first, last = (x.lower - phase) / period, (x.upper - phase) / period
        slack = 1e-15 * (4.0 + np.abs(first) + np.abs(last))
        inside = np.floor(last + slack) >= np.ceil(first - slack)
    return inside | ~np.isfinite(first) | ~np.isfinite(last) | (slack > 0.1)


def wave(name: str, x: Interval) -> Interval:
    """sin and cos: the values at the ends, and 1 or -1 where a crest or a trough lies between."""
    finite = np.isfinite(x.lower) & np.isfinite(x.upper)
    left, right = values(name, np.where(finite, x.lower, 0.0)), values(name, np.where(finite, x.upper, 0.0))
    crest = math.pi / 2 if name == "sin" else 0.0
    high = np.where(_passes(x, crest, 2 * math.pi), 1.0, np.maximum(left[1], right[1]))
    low = np.where(_passes(x, crest + math.pi, 2 * math.pi), -1.0, np.minimum(left[0], right[0]))
    return interval(np.maximum(low, -1.0), np.minimum(high, 1.0))


def tan(x: Interval) -> Interval:
    """tan, increasing between its poles; the whole line where the interval contains one."""
    pole = _passes(x, math.pi / 2, math.pi)
    lower, upper = values("tan", np.where(pole, 0.0, x.lower))[0], values("tan", np.where(pole, 0.0, x.upper))[1]
    return interval(np.where(pole, -np.inf, lower), np.where(pole, np.inf, upper))


def cosh(x: Interval) -> Interval:
    """Even, and growing with |x|."""
    near, far = x.mignitude, x.magnitude
    upper = np.where(np.isinf(far), np.inf, values("cosh", np.where(np.isinf(far), 0.0, far))[1])
    return interval(np.maximum(values("cosh", np.where(np.isinf(near), 0.0, near))[0], 1.0), upper)


def atan2(y: Interval, x: Interval) -> tuple[Interval, Truths]:
    """The angle of (x, y), and where it may jump: across the negative x axis, and at the origin.

    On a convex set away from both, the angle is least and greatest at corners.
    """
    angles = [_each(_angle, a, b) for a in (y.lower, y.upper) for b in (x.lower, x.upper)]
    found = interval(np.minimum.reduce([a[0] for a in angles]), np.maximum.reduce([a[1] for a in angles]))
    cut = (x.lower < 0) & (y.lower < 0) & (y.upper >= 0)
    origin = x.contains(0.0) & y.contains(0.0)
    half, full = MONOTONE["atan"].range[1], MONOTONE["acos"].range[1]
    # every angle of the half planes that the rectangle touches
    low = np.where(y.lower < 0, np.where(x.lower < 0, -full, -half), 0.0)
    high = np.where(y.upper > 0, np.where(x.lower < 0, full, half), np.where(x.lower < 0, full, 0.0))
    jumps = cut | origin
    return interval(np.where(jumps, low, found.lower), np.where(jumps, high, found.upper)), jumps


def _angle(y: float, x: float) -> tuple[float, float]:
    """The angle of a corner, of its limit direction where it lies at infinity."""
    if math.isinf(y) or math.isinf(x):
        left_below = x == -math.inf and -math.inf < y < 0  # approaches -pi, not the value pi on the axis
        y, x = (math.copysign(1, z) if math.isinf(z) else 0.0 for z in (y, x))
        if left_below:
            return outward(-PI)
    return (0.0, 0.0) if x == y == 0 else outward(arb.atan2(arb(y), arb(x)))


def real_power(x: Interval, y: Interval) -> Interval:
    """x^y = exp(y log x) where x >= 0: monotone in each, so that corners suffice."""
    x = interval(np.maximum(x.lower, 0.0), np.maximum(x.upper, 0.0))
    corners = [_each(_pow, a, b) for a in (x.lower, x.upper) for b in (y.lower, y.upper)]
    lower = np.minimum.reduce([c[0] for c in corners])
    upper = np.maximum.reduce([c[1] for c in corners])
    # between exponents of both signs the power passes 1, and so it does between bases on both sides of 1
    one = (y.contains(0.0)) | (x.contains(1.0))
    return interval(np.where(one, np.minimum(lower, 1.0), lower), np.where(one, np.maximum(upper, 1.0), upper))


def _pow(x: float, y: float) -> tuple[float, float]:
    """x^y of 0 <= x <= inf, with its limits."""
    if y == 0 or x == 1:
        return 1.0, 1.0
    if x == 0 or math.isinf(x) or math.isinf(y):
        to_infinity = (x > 1) == (y > 0)
        return (math.inf, math.inf) if to_infinity else (0.0, 0.0)
    lower, upper = outward(arb(x) ** arb(y))
    return max(lower, 0.0), upper
