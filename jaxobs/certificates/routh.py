"""How many roots lie where: Routh's count for the half plane and, by the bilinear map, for the disc, exactly.

No rounding and no special cases: a row of zeros in Routh's scheme is a common factor of the even and the odd part, whose roots
lie symmetrically about the origin; they are counted by Sturm's theorem instead of the customary perturbations.
"""

import math
import operator
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from jaxobs.certificates import exact
from jaxobs.certificates.polynomial import Polynomial, cauchy_index, euclid, multiply, plus, primitive, real_roots


class Count(NamedTuple):
    """Roots with multiplicity: Re s < 0, = 0, > 0; or |z| < 1, = 1, > 1."""

    inside: int
    border: int
    outside: int

    @property
    def is_stable(self) -> bool:
        return self.border == self.outside == 0


def characteristic_polynomial(matrix: exact.Matrix) -> list[Fraction]:
    """[1, c_1, ..., c_n] of det(s I - M), by Faddeev and LeVerrier: M_1 = M, c_k = -tr(M_k) / k, M_{k+1} = M (M_k + c_k I).

    In integers: for the common denominator d, the coefficients of d M are d^k c_k.
    """
    n = len(matrix)
    common = math.lcm(*(entry.denominator for row in matrix for entry in row))
    whole = [[int(entry * common) for entry in row] for row in matrix]
    coefficients, power = [Fraction(1)], whole
    for k in range(1, n + 1):
        c = -sum(power[i][i] for i in range(n)) // k  # exact: the coefficients of an integer matrix are integers
        coefficients.append(Fraction(c, common**k))
        shifted = [[power[i][j] + (c if i == j else 0) for j in range(n)] for i in range(n)]
        columns = list(zip(*shifted, strict=True))
        power = [[sum(map(operator.mul, row, column)) for column in columns] for row in whole]
    return coefficients


def half_planes(poly: Sequence[Fraction | int]) -> Count:
    """The roots of a_0 s^n + a_1 s^{n-1} + ... + a_n, a_0 not 0, left of, on and right of the imaginary axis.

    With f = a_0 w^n - a_2 w^{n-2} + ..., g = a_1 w^{n-1} - a_3 w^{n-3} + ... and d = gcd(f, g): the deg d roots that lie
    symmetrically about 0 include those on the axis, which are the real roots of d; of the others, the Cauchy index of g/f is
    (number on the left) - (number on the right). Source: Gantmacher, The Theory of Matrices II, chapter XV.
    """
    whole = primitive(poly)
    degree = len(whole) - 1
    f = [a * (-1) ** (i // 2) if i % 2 == 0 else 0 for i, a in enumerate(whole)]
    g = primitive([a * (-1) ** (i // 2) if i % 2 == 1 else 0 for i, a in enumerate(whole)])
    chain = euclid(primitive(f), g)
    symmetric = len(chain[-1]) - 1
    border = real_roots(chain[-1])
    outside = (symmetric - border) // 2 + (degree - symmetric - cauchy_index(chain)) // 2
    return Count(degree - border - outside, border, outside)


def disc(poly: Sequence[Fraction | int]) -> Count:
    """The roots inside, on and outside the unit circle: z = (1 + s) / (1 - s) maps Re s < 0 to |z| < 1, infinity to z = -1."""
    whole = primitive(poly)
    degree = len(whole) - 1
    power: Polynomial = [1]
    image: Polynomial = [whole[0]]
    for a in whole[1:]:  # Horner's rule: (1 - s)^n p((1 + s) / (1 - s))
        power = multiply(power, [-1, 1])
        image = plus(multiply(image, [1, 1]), power, a)
    mapped = primitive(image)
    inside, border, outside = half_planes(mapped)
    return Count(inside, border + degree - (len(mapped) - 1), outside)


def frozen(matrix: exact.Matrix, *, step: bool = False) -> Count:
    """Where the eigenvalues of a rational matrix lie: about the imaginary axis, or with `step` about the unit circle."""
    common = characteristic_polynomial(matrix)
    return disc(common) if step else half_planes(common)
