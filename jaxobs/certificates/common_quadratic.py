"""Whether 2x2 matrices share a quadratic Lyapunov function: decided exactly, both ways."""

import itertools
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from jaxobs.certificates import exact
from jaxobs.certificates.polynomial import (
    Polynomial,
    between_real_roots,
    multiply,
    plus,
    primitive,
    sign_at,
)
from jaxobs.certificates.routh import frozen


class Decision(NamedTuple):
    """exists: whether one P > 0 decreases along all matrices. p: such a P, rational, where it exists. blocking: otherwise the
    places of at most three matrices that have none in common, so that nothing larger has one either.
    """

    exists: bool
    p: exact.Matrix | None
    blocking: tuple[int, ...]


class Conic(NamedTuple):
    """d(x, y) = a y^2 + b(x) y + c(x), polynomials in x with rational coefficients, d > 0 in a convex set."""

    a: Fraction
    b: tuple[Fraction, Fraction]
    c: tuple[Fraction, Fraction, Fraction]

    def on(self, x: Fraction) -> Polynomial:
        """d(x, .)."""
        return primitive([self.a, self.b[0] * x + self.b[1], (self.c[0] * x + self.c[1]) * x + self.c[2]])


def common_quadratic(matrices: Sequence[exact.Matrix], *, step: bool = False) -> Decision:
    """Whether one P > 0 has A'P + P A < 0 (with `step`: A'P A - P < 0) for all the 2x2 matrices A; rational arithmetic only.

    With P = [[1, x], [x, y]] and A stable, d_A(x, y) = det(A'P + P A) > 0 describes exactly the P that suit A: the inside of an
    ellipse (or parabola). By Helly's theorem convex sets in the plane have a common point if every three have. For three, the
    curves d_A = 0 cut the plane into cells; above each interval of x without roots of their discriminants and resultants the
    curves keep their order, so one rational point in each cell decides. If A is not stable alone, (its place,) is blocking.
    """
    for k, matrix in enumerate(matrices):
        if not frozen(matrix, step=step).is_stable:
            return Decision(False, None, (k,))
    conics = [_conic(matrix, step) for matrix in matrices]
    size = min(3, len(conics))
    for chosen in itertools.combinations(range(len(conics)), size):
        if _common_point([conics[k] for k in chosen]) is None:
            return Decision(False, None, _smallest(conics, chosen))
    point = _common_point(conics)
    assert point is not None  # Helly
    x, y = point
    return Decision(True, [[Fraction(1), x], [x, y]], ())


def decrease(a: exact.Matrix, p: exact.Matrix, *, step: bool = False) -> exact.Matrix:
    """-(A'P + P A), or P - A'P A."""
    if step:
        return exact.subtract(p, exact.product(exact.transpose(a), exact.product(p, a)))
    pa = exact.product(p, a)
    return exact.scale(Fraction(-1), exact.add(pa, exact.transpose(pa)))


def _conic(matrix: exact.Matrix, step: bool) -> Conic:
    """det of the decrease, which is affine in (1, x, y)."""
    zero, one = Fraction(0), Fraction(1)
    units = ([[one, zero], [zero, zero]], [[zero, one], [one, zero]], [[zero, zero], [zero, one]])
    u, v, w = (decrease(matrix, unit, step=step) for unit in units)

    def mixed(p: exact.Matrix, q: exact.Matrix) -> Fraction:  # det(p + q) - det p - det q
        return p[0][0] * q[1][1] + q[0][0] * p[1][1] - 2 * p[0][1] * q[0][1]

    return Conic(mixed(w, w) / 2, (mixed(v, w), mixed(u, w)), (mixed(v, v) / 2, mixed(u, v), mixed(u, u) / 2))


def _common_point(conics: Sequence[Conic]) -> tuple[Fraction, Fraction] | None:
    """A rational (x, y) with every d > 0, or None when the plane has none: an open set meets one of the open cells."""
    pairs = itertools.combinations(conics, 2)
    critical = [_discriminant(conic) for conic in conics] + [_resultant(one, other) for one, other in pairs]
    for x in between_real_roots(f for f in critical if f):  # a resultant is zero when both are one curve: nothing to cut
        sections = [conic.on(x) for conic in conics]
        for y in between_real_roots(sections):
            if all(sign_at(section, y) > 0 for section in sections):
                return x, y
    return None


def _discriminant(conic: Conic) -> Polynomial:
    """b^2 - 4 a c in x. With a = 0 the curve is a graph over x: no critical point."""
    b, c = list(conic.b), list(conic.c)
    if conic.a == 0:
        return [1]
    squared = [b[0] ** 2, 2 * b[0] * b[1], b[1] ** 2]
    return primitive([s - 4 * conic.a * t for s, t in zip(squared, c, strict=True)])


def _resultant(one: Conic, other: Conic) -> Polynomial:
    """(a c* - a* c)^2 - (a b* - a* b)(b c* - b* c) in x: where the two curves have a y in common."""
    a, b, c = _integers(one)
    s, t, w = _integers(other)
    ac = plus(multiply(a, w), multiply(s, c), -1)
    ab = plus(multiply(a, t), multiply(s, b), -1)
    bc = plus(multiply(b, w), multiply(t, c), -1)
    if a == [0] and s == [0]:
        return primitive(bc)
    return primitive(plus(multiply(ac, ac), multiply(ab, bc), -1))


def _integers(conic: Conic) -> tuple[Polynomial, Polynomial, Polynomial]:
    """The coefficients, padded to their degrees, times one positive number."""
    whole = _common([conic.a, *conic.b, *conic.c])
    return whole[:1], whole[1:3], whole[3:]


def _common(numbers: Sequence[Fraction]) -> list[int]:
    denominator = math.lcm(*(number.denominator for number in numbers))
    return [int(number * denominator) for number in numbers]


def _smallest(conics: Sequence[Conic], chosen: tuple[int, ...]) -> tuple[int, ...]:
    """A pair of the three that already has no common point, or the three."""
    pairs = itertools.combinations(chosen, 2)
    return next((pair for pair in pairs if _common_point([conics[k] for k in pair]) is None), chosen)
