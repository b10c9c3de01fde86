"""Determinants without pivots, whether a function has a zero on a box, and whether it is zero everywhere."""

import functools
import itertools
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs.intervals import Interval, UnknownPrimitiveError
from jaxobs.intervals import graph as graphs
from jaxobs.intervals.expressions import Polynomial
from jaxobs.intervals.expressions import _product as product
from jaxobs.intervals.formula_ranges import _is_smooth as is_smooth
from jaxobs.intervals.jacobian import assumptions
from jaxobs.intervals.ranges import enclosures

LONGEST = 4000  # terms of a polynomial, beyond which an identity is given up
DEEPEST = 20  # halvings along each coordinate
Rational = tuple[Polynomial, Polynomial]
ONE: Polynomial = {(): Fraction(1)}


def determinant(matrix: Float[Array, "n n"]) -> Float[Array, ""]:
    """By expansion along the rows with shared minors, 2^n n products: sums and products, which intervals can follow."""
    return _minor(matrix, tuple(range(matrix.shape[0])), tuple(range(matrix.shape[0])))


def adjugate(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """adj(M) = det(M) M^-1, of the minors of M."""
    n = matrix.shape[0]
    everything = tuple(range(n))

    def entry(i, j):  # the cofactor of (j, i)
        rows, columns = everything[:j] + everything[j + 1 :], everything[:i] + everything[i + 1 :]
        return _minor(matrix, rows, columns) * (1 if (i + j) % 2 == 0 else -1)

    return jnp.stack([jnp.stack([entry(i, j) for j in range(n)]) for i in range(n)])


def _minor(matrix: Any, rows: tuple[int, ...], columns: tuple[int, ...]) -> Any:
    @functools.cache
    def minor(depth: int, left: tuple[int, ...]) -> Any:
        if not left:
            return jnp.ones((), matrix.dtype)
        terms = []
        for k, j in enumerate(left):
            term = matrix[rows[depth], j] * minor(depth + 1, left[:k] + left[k + 1 :])
            terms.append(-term if k % 2 else term)
        return sum(terms[1:], terms[0])

    return minor(0, columns)


class Sign:
    """What `sign_on` found: +1 or -1 if g keeps that sign on the box, proved; 0 if g has a zero there, proved by its two signs
    at the points `places`; None if neither was found. boxes: how many were evaluated; least: a proved lower bound of |g|."""

    def __init__(self, value: int | None, boxes: int, least: float = 0.0, places: tuple[np.ndarray, ...] = ()):
        self.value, self.boxes, self.least, self.places = value, boxes, least, places


def sign_on(g: Callable[[Any], Any], z: Interval, seeds: np.ndarray, max_boxes: int) -> Sign:
    """The sign of g: z (N,) -> number over a box, by bisection of what natural and mean value enclosures leave open.

    seeds (k, N): points to look for two signs at. They prove a zero only if g is continuous on the segment between them, which
    has to be proved too: it may be a pole that lies there.
    """
    found = _sign(g, z, seeds, max_boxes)
    if found.value == 0:
        first, second = found.places
        if not continuous(lambda s: g(first + s[0] * (second - first))[None], Interval(np.zeros(1), np.ones(1))):
            return Sign(None, found.boxes)
    return found


def continuous(g: Callable[[Any], Any], z: Interval) -> bool:
    """Whether g: z (N,) -> (r,) is proved to be defined, without a jump, on the box."""
    try:
        found = graphs.trace(g, z.lower.size)
        if all(is_smooth(found.graph.atoms[i]) for i in found.graph.nodes(found.outputs.flat)):
            return True
    except UnknownPrimitiveError:
        pass
    try:
        return not assumptions(g, z)
    except UnknownPrimitiveError:
        return False


def _sign(g: Callable[[Any], Any], z: Interval, seeds: np.ndarray, max_boxes: int) -> Sign:
    """The same, where g is continuous between the two points."""
    enclose = enclosures(lambda z: g(z)[None], z.lower.size)
    low, high, *_ = enclose(seeds, seeds)
    used, positive, negative = len(seeds), low[:, 0] > 0, high[:, 0] < 0
    if positive.any() and negative.any():
        return Sign(0, used, 0.0, (seeds[np.argmax(positive)], seeds[np.argmax(negative)]))
    lower, upper = z.lower[None], z.upper[None]
    if not positive.any() and not negative.any():
        return Sign(None, used)
    sign, least, size = (1 if positive.any() else -1), np.inf, np.maximum(z.upper - z.lower, 0.0)
    for _ in range(DEEPEST * z.lower.size):
        if used + len(lower) > max_boxes:
            return Sign(None, used)
        low, high, slope_low, slope_high = enclose(lower, upper)
        used += len(lower)
        bottom = low[:, 0] if sign > 0 else -high[:, 0]
        middle = lower + (upper - lower) / 2
        at_low, at_high, *_ = enclose(middle, middle)
        centre = at_low[:, 0] if sign > 0 else -at_high[:, 0]
        steep = np.maximum(np.abs(slope_low[:, 0]), np.abs(slope_high[:, 0]))
        reach = np.nextafter(np.maximum(upper - middle, middle - lower), np.inf)
        with np.errstate(invalid="ignore"):
            parts = np.where(reach > 0, steep * reach, 0.0)
            fall = np.sum(parts, axis=1) * (1 + 1e-12)
            bottom = np.fmax(bottom, np.nextafter(centre - fall, -np.inf))
        other = at_high[:, 0] < 0 if sign > 0 else at_low[:, 0] > 0
        if other.any():
            first = seeds[np.argmax(positive | negative)]
            return Sign(0, used, 0.0, (first, middle[np.argmax(other)]))
        open_ = ~(bottom > 0)
        least = min([least, *bottom[~open_]])
        lower, upper, parts = lower[open_], upper[open_], parts[open_]
        if not len(lower):
            return Sign(sign, used, float(least))
        weight = np.where(np.isfinite(parts), parts, np.inf) if np.isfinite(parts).all() else (upper - lower) / (size + 1e-300)
        axis = np.argmax(weight, axis=1)
        rows, half = np.arange(len(lower)), lower + (upper - lower) / 2
        left, right = upper.copy(), lower.copy()
        left[rows, axis] = right[rows, axis] = half[rows, axis]
        lower, upper = np.concatenate([lower, right]), np.concatenate([left, upper])
    return Sign(None, used)


def vanishes(g: Callable[[Any, Any], Any], n: int, m: int) -> bool:
    """Whether every component of g(x, u) is proved to be zero for all x and u where it is defined: its exact formula is a
    quotient of polynomials in the variables and in functions of them (which stand for themselves), and the numerator is 0."""
    try:
        found = graphs.trace(g if m else lambda x: g(x, x[:0]), n, m)
    except UnknownPrimitiveError:
        return False
    graph, entries = found.graph, list(found.outputs.flat)
    if graph.jumps(entries):
        return False
    symbols: dict[Any, int] = {}

    def symbol(*key: Any) -> Rational:
        number = symbols.setdefault(key, len(graph.variables) + len(symbols))
        return {((number, 1),): Fraction(1)}, ONE

    def function(name: str) -> Callable[..., Rational]:
        return lambda *args: symbol(name, *(_frozen(part) for arg in args for part in arg))

    rules = {
        "+": lambda constant, parts: functools.reduce(_add, [_scale(k, v) for k, v in parts], ({(): constant}, ONE)),
        "*": lambda a, b: (_times(a[0], b[0]), _times(a[1], b[1])),
        "^": _power,
        **{name: function(name) for name in ("sin", "cos", "tanh", "exp", "log", "sqrt", "atan", "erf", "min")},
    }
    variables: list[Rational] = [({((k, 1),): Fraction(1)}, ONE) for k in range(len(graph.variables))]
    try:
        return all(not any(value[0].values()) for value in graph.evaluate(entries, variables, rules))
    except _TooLong:
        return False


class _TooLong(Exception):
    pass


def _times(a: Polynomial, b: Polynomial) -> Polynomial:
    if a == ONE or b == ONE:
        return b if a == ONE else a
    if len(a) * len(b) > LONGEST:
        raise _TooLong
    return {monomial: x for monomial, x in product(a, b).items() if x}


def _scale(k: Fraction, a: Rational) -> Rational:
    return {monomial: k * x for monomial, x in a[0].items()}, a[1]


def _add(a: Rational, b: Rational) -> Rational:
    if not any(a[0].values()) or not any(b[0].values()):
        return b if not any(a[0].values()) else a
    if a[1] == b[1]:
        left, right, below = a[0], b[0], a[1]
    else:
        left, right, below = _times(a[0], b[1]), _times(b[0], a[1]), _times(a[1], b[1])
    total = dict(left)
    for monomial, x in right.items():
        total[monomial] = total.get(monomial, Fraction(0)) + x
    return {monomial: x for monomial, x in total.items() if x}, below


def _power(a: Rational, n: int) -> Rational:
    above, below = a if n > 0 else (a[1], a[0])
    if not any(below.values()):
        raise _TooLong
    return tuple(functools.reduce(_times, itertools.repeat(part, abs(n)), ONE) for part in (above, below))  # pyright: ignore[reportReturnType]


def _frozen(p: Polynomial) -> Any:
    return tuple(sorted(p.items()))


def enclosed_inverse(matrix: Interval) -> Interval:
    """Enclosures of the entries of M^-1 for every regular M within these entries; unbounded where the determinant may be 0."""
    everything = tuple(range(matrix.shape[0]))

    def minor(rows: tuple[int, ...], columns: tuple[int, ...]) -> Interval:
        total = Interval(0.0, 0.0) if rows else Interval(1.0, 1.0)
        for k, j in enumerate(columns):
            total = total + matrix[rows[0], j] * minor(rows[1:], columns[:k] + columns[k + 1 :]) * (-1.0) ** k
        return total

    whole = minor(everything, everything)

    def entry(i: int, j: int) -> Interval:
        return minor(everything[:j] + everything[j + 1 :], everything[:i] + everything[i + 1 :]) * (-1.0) ** (i + j) / whole

    entries = [[entry(i, j) for j in everything] for i in everything]
    return Interval(*(np.array([[getattr(e, side) for e in row] for row in entries], float) for side in ("lower", "upper")))
