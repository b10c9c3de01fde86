"""A box that the Euler map of the Lorenz system, example 3, never leaves: an exact proof.

The set {x1^2/10 + x2^2 + (x3 - 29)^2 <= E} with {x2^2 + (x3 - 28)^2 <= 900} and |x1| <= 30 is mapped into itself. For a form
V = a x1^2 + x2^2 + (x3 - c)^2 with c = 28 + 10 a the cross terms of V' cancel, and one step gives

    V+ = V + 2 T (-10 a x1^2 - x2^2 - b x3 (x3 - c)) + T^2 |f|_V^2,

    |f|_V^2 <= 100 a (x2 - x1)^2 + 900 x1^2 + x2^2 + b^2 x3^2 + 2 s k x1 x2  for s = 1 or s = -1,

since (x3 - 28)^2 + x2^2 <= 900 and |x3 - 28 - b x3| <= k there. With multipliers l >= 0 of the two constraints a quadratic form
in (1, x1, x2, x3) remains, whose positivity is decided in rational arithmetic. |x1+| <= 0.99 |x1| + 0.01 |x2| <= 30.
"""

import functools
from fractions import Fraction

import numpy as np

from jaxobs.certificates import exact
from jaxobs.designs import sdp

RADIUS, CENTRE = 30, 28
ENERGY, SHARE = Fraction(930), Fraction(1, 10)
T, B = Fraction(1, 1000), Fraction(8, 3)
BOX = ((-30.0, -30.0, -2.0), (30.0, 30.0, 58.0))


Number = Fraction | int


def form(
    one: Number = 0, x3: Number = 0, x1x1: Number = 0, x2x2: Number = 0, x3x3: Number = 0, x1x2: Number = 0
) -> exact.Matrix:
    """one + x3 x_3 + ... as a symmetric matrix over (1, x1, x2, x3)."""
    half = Fraction(1, 2)
    q = exact.zeros(4, 4)
    for i, value in enumerate((one, x1x1, x2x2, x3x3)):
        q[i][i] = Fraction(value)
    q[0][3] = q[3][0] = Fraction(x3) * half
    q[1][2] = q[2][1] = Fraction(x1x2) * half
    return q


def energy(a: Fraction) -> exact.Matrix:
    c = CENTRE + 10 * a
    return form(one=c * c, x3=-2 * c, x1x1=a, x2x2=1, x3x3=1)


def after_step(a: Fraction, sign: int) -> exact.Matrix:
    """A form above V+ on the set."""
    c = CENTRE + 10 * a
    k = max(abs(x - CENTRE - B * x) for x in (CENTRE - RADIUS, CENTRE + RADIUS))
    drift = form(x3=B * c, x1x1=-10 * a, x2x2=-1, x3x3=-B)
    square = form(x1x1=100 * a + RADIUS**2, x2x2=100 * a + 1, x3x3=B * B, x1x2=-200 * a + 2 * sign * k)
    return exact.add(energy(a), exact.add(exact.scale(2 * T, drift), exact.scale(T * T, square)))


def remainder(a: Fraction, level: Fraction, sign: int, multipliers) -> exact.Matrix:
    """level - V+ - l_1 (E - V_1) - l_2 (900 - V_2)."""
    rest = exact.subtract(form(one=level), after_step(a, sign))
    for l, share, bound in zip(multipliers, (SHARE, Fraction(0)), (ENERGY, Fraction(RADIUS**2)), strict=True):
        rest = exact.subtract(rest, exact.scale(l, exact.subtract(form(one=bound), energy(share))))
    return rest


def _witness(a: Fraction, level: Fraction, sign: int) -> tuple[Fraction, ...]:
    """Multipliers proposed by a solver, at least 0, as rationals."""
    scales = np.diag([1 / 30, 1.0, 1.0, 1.0])
    start = np.array(remainder(a, level, sign, (Fraction(0), Fraction(0))), float)
    units = [
        np.array(remainder(a, level, sign, pair), float) - start
        for pair in ((Fraction(1), Fraction(0)), (Fraction(0), Fraction(1)))
    ]

    def lmis(first, second):
        f = start + float(first) * units[0] + float(second) * units[1]
        return [scales @ f @ scales, np.array([[float(first)]]), np.array([[float(second)]])]

    found = sdp.feasible({"first": sdp.scalar(), "second": sdp.scalar()}, lmis)
    return tuple(max(Fraction(0), Fraction(float(found.values[name])).limit_denominator(10**9)) for name in ("first", "second"))


@functools.cache
def is_invariant() -> bool:
    """Whether both inequalities have witnesses that pass, for both signs, in exact arithmetic."""
    return all(
        exact.is_positive_definite(remainder(a, level, sign, _witness(a, level, sign)))
        for a, level in ((SHARE, ENERGY), (Fraction(0), Fraction(RADIUS**2)))
        for sign in (1, -1)
    )
