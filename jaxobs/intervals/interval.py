"""Arrays of closed intervals with outward-rounded float64 endpoints, and their arithmetic.

An enclosure contains every value that the operation takes on the real numbers of its arguments, wherever it is defined;
an infinite endpoint means that nothing bounds the values on that side. Exact results stay exact: 0 times anything is [0, 0].
"""

import dataclasses
from typing import Any, TypeAlias

import numpy as np

from jaxobs._module import refuse
from jaxobs.intervals.rounding import Numbers, Truths, down, quotient, root, two_product, two_sum, up

Like: TypeAlias = "Interval | np.ndarray | np.number | float | int"


@dataclasses.dataclass(frozen=True, eq=False, init=False)
class Interval:
    """{z : lower <= z <= upper}, entry by entry.

    lower, upper: NumPy float64 arrays of one shape, or what makes such arrays. Integers and truth values are intervals too:
        False is [0, 0], True is [1, 1] and [0, 1] is undecided. `+ - * / abs ** n` and `x[index]` work as on arrays.

    Raises ValueError where the shapes differ, an endpoint is NaN or lower > upper.
    """

    lower: np.ndarray
    upper: np.ndarray

    def __init__(self, lower: Any, upper: Any):
        for name, given in (("lower", lower), ("upper", upper)):
            try:
                object.__setattr__(self, name, np.asarray(given, dtype=np.float64))
            except (TypeError, ValueError) as error:
                raise refuse(self, name, repr(given), "an array of real numbers", "Give floats.") from error
        if self.lower.shape != self.upper.shape:
            shapes = f"shapes {self.lower.shape} and {self.upper.shape}"
            raise refuse(self, "lower, upper", shapes, "one shape", "Broadcast the endpoints with np.broadcast_arrays.")
        if not np.all(self.lower <= self.upper):  # False for a NaN too
            given = f"{self.lower} and {self.upper}"
            raise refuse(self, "lower, upper", given, "lower <= upper, not NaN", "Exchange or repair the endpoints.")

    @property
    def shape(self) -> tuple[int, ...]:
        return self.lower.shape

    @property
    def ndim(self) -> int:
        return self.lower.ndim

    @property
    def is_point(self) -> bool:
        """Whether every entry is a single number."""
        return self.lower is self.upper or bool(np.array_equal(self.lower, self.upper))

    @property
    def width(self) -> Numbers:
        """upper - lower, rounded up."""
        return (self - self).upper

    @property
    def magnitude(self) -> Numbers:
        """max |z|."""
        return np.maximum(np.abs(self.lower), np.abs(self.upper))

    @property
    def mignitude(self) -> Numbers:
        """min |z|."""
        apart = np.minimum(np.abs(self.lower), np.abs(self.upper))
        return np.where((self.lower <= 0) & (self.upper >= 0), 0.0, apart)

    def contains(self, value: Any) -> Truths:
        return (self.lower <= value) & (value <= self.upper)

    def __getitem__(self, index: Any) -> "Interval":
        return interval(self.lower[index], self.upper[index])

    def __neg__(self) -> "Interval":
        return interval(-self.upper, -self.lower)

    def __abs__(self) -> "Interval":
        return interval(self.mignitude, self.magnitude)

    def __add__(self, other: Like) -> "Interval":
        return add(self, as_interval(other))

    def __radd__(self, other: Like) -> "Interval":
        return add(as_interval(other), self)

    def __sub__(self, other: Like) -> "Interval":
        return add(self, -as_interval(other))

    def __rsub__(self, other: Like) -> "Interval":
        return add(as_interval(other), -self)

    def __mul__(self, other: Like) -> "Interval":
        return multiply(self, as_interval(other))

    def __rmul__(self, other: Like) -> "Interval":
        return multiply(as_interval(other), self)

    def __truediv__(self, other: Like) -> "Interval":
        return divide(self, as_interval(other))

    def __rtruediv__(self, other: Like) -> "Interval":
        return divide(as_interval(other), self)

    def __pow__(self, n: int) -> "Interval":
        return power(self, n)


def interval(lower: Numbers, upper: Numbers) -> Interval:
    """An Interval of endpoints known to be in order: no checks, no copies."""
    made = object.__new__(Interval)
    object.__setattr__(made, "lower", np.asarray(lower))
    object.__setattr__(made, "upper", made.lower if upper is lower else np.asarray(upper))
    return made


def point(value: Any) -> Interval:
    """[z, z] of exact numbers: floats, truth values, integers (those that float64 cannot hold are enclosed)."""
    given = np.asarray(value)
    exact = given.astype(np.float64)
    if given.dtype.kind in "iu" and given.size and np.any(np.abs(exact) >= 2.0**53):
        return interval(np.nextafter(exact, -np.inf), np.nextafter(exact, np.inf))
    if np.any(np.isnan(exact)):  # a NaN is nowhere defined, so everything encloses it
        return interval(np.where(np.isnan(exact), -np.inf, exact), np.where(np.isnan(exact), np.inf, exact))
    return interval(exact, exact)


def as_interval(value: Like) -> Interval:
    """The interval itself, or the point of a number or array."""
    return value if isinstance(value, Interval) else point(value)


def whole(shape: tuple[int, ...]) -> Interval:
    """(-inf, inf)."""
    return interval(np.full(shape, -np.inf), np.full(shape, np.inf))


def hull(a: Interval, b: Interval) -> Interval:
    """The smallest interval that contains both."""
    return interval(np.minimum(a.lower, b.lower), np.maximum(a.upper, b.upper))


def where(condition: Truths, a: Interval, b: Interval) -> Interval:
    """As numpy.where, for a condition that is decided."""
    return interval(np.where(condition, a.lower, b.lower), np.where(condition, a.upper, b.upper))


def add(a: Interval, b: Interval) -> Interval:
    """a + b, with inf - inf on neither side of what is known."""
    with np.errstate(all="ignore"):
        lower = np.fmax(down(*two_sum(a.lower, b.lower)), -np.inf)
        if a.is_point and b.is_point:
            return interval(lower, np.fmin(up(*two_sum(a.lower, b.lower)), np.inf))
        return interval(lower, np.fmin(up(*two_sum(a.upper, b.upper)), np.inf))


def multiply(a: Interval, b: Interval) -> Interval:
    """a b: the least and the greatest of the products of endpoints."""
    lefts = [a.lower] if a.is_point else [a.lower, a.upper]
    rights = [b.lower] if b.is_point else [b.lower, b.upper]
    with np.errstate(all="ignore"):
        products = [two_product(x, y) for x in lefts for y in rights]
        lower, upper = down(*products[0]), up(*products[0])
        for each in products[1:]:
            lower, upper = np.minimum(lower, down(*each)), np.maximum(upper, up(*each))
    return interval(lower, upper)


def divide(a: Interval, b: Interval) -> Interval:
    """a / b where b != 0: unbounded where b reaches 0, and 0 / b = [0, 0]."""
    # The sign of a zero at the end of [0, u] or [l, 0] is that of the numbers next to it.
    ends = (np.where(b.lower == 0, 0.0, b.lower), np.where(b.upper == 0, -0.0, b.upper))
    with np.errstate(all="ignore"):
        quotients = [quotient(x, y) for x in (a.lower, a.upper) for y in ends]
        lower = np.minimum.reduce([down(*each) for each in quotients])
        upper = np.maximum.reduce([up(*each) for each in quotients])
    across = ((b.lower < 0) & (b.upper > 0)) | ((b.lower == 0) & (b.upper == 0))
    across = across & ~((a.lower == 0) & (a.upper == 0))
    return interval(np.where(across, -np.inf, lower), np.where(across, np.inf, upper))


def power(x: Interval, n: int) -> Interval:
    """x^n of an integer n: increasing for odd n > 0, a function of |x| for even n, 1 / x^-n for n < 0."""
    if n < 0:
        return divide(point(np.ones(x.shape)), power(x, -n))
    if n % 2 == 0 and n > 0:
        x = abs(x)
    if n == 1 or x.is_point:
        return _power(x, n)
    return interval(_power(interval(x.lower, x.lower), n).lower, _power(interval(x.upper, x.upper), n).upper)


def _power(x: Interval, n: int) -> Interval:
    """x^n by repeated squaring, for a single number or x >= 0."""
    result, square = None, x
    while n:
        if n % 2:
            result = square if result is None else multiply(result, square)
        n //= 2
        square = multiply(square, square) if n else square
    return point(np.ones(x.shape)) if result is None else result


def sqrt(x: Interval) -> Interval:
    """sqrt(x) where x >= 0."""
    lower, upper = np.maximum(x.lower, 0.0), np.maximum(x.upper, 0.0)
    with np.errstate(all="ignore"):
        return interval(np.maximum(down(*root(lower)), 0.0), up(*root(upper)))


def total(x: Interval, axis: int) -> Interval:
    """sum along an axis, by halves."""
    while x.shape[axis] > 1:
        first, middle = x.shape[axis] // 2, x.shape[axis] % 2
        a, b = _part(x, axis, 0, first), _part(x, axis, first, 2 * first)
        rest = _part(x, axis, 2 * first, 2 * first + middle)
        both = a + b
        x = both if not middle else interval(
            np.concatenate([both.lower, rest.lower], axis), np.concatenate([both.upper, rest.upper], axis)
        )  # fmt: skip
    if x.shape[axis] == 0:
        return point(np.zeros([size for i, size in enumerate(x.shape) if i != axis % x.ndim]))
    return interval(np.squeeze(x.lower, axis), np.squeeze(x.upper, axis))


def _part(x: Interval, axis: int, start: int, stop: int) -> Interval:
    return x[(slice(None),) * (axis % x.ndim) + (slice(start, stop),)]
