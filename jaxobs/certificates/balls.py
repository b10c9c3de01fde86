"""Products and exponentials of matrices with a bound on every rounding: integers over a power of two, and a radius."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from jaxobs.certificates import exact

BITS = 512  # the unit is 2^-BITS
LARGEST = 4096  # bits of a norm in units


class Ball(NamedTuple):
    """All real matrices M with |M - middle 2^-BITS| <= radius 2^-BITS in the norm of the largest absolute row sum."""

    middle: list[list[int]]
    radius: int

    @property
    def norm(self) -> int:
        """A bound on the norm of the middle, in units."""
        return max(sum(map(abs, row)) for row in self.middle)


def enclose(matrix: exact.Matrix) -> Ball:
    """Rounded down entry by entry: less than one unit each."""
    return Ball([[math.floor(entry * 2**BITS) for entry in row] for row in matrix], len(matrix))


def multiply(x: Ball, y: Ball) -> Ball:
    """X Y: |X Y - x y| <= |x| r_y + r_x |y| + r_x r_y, and less than one unit an entry for rounding down. OverflowError when it
    is too large to go on with."""
    columns = list(zip(*y.middle, strict=True))
    middle = [[sum(a * b for a, b in zip(row, column, strict=True)) >> BITS for column in columns] for row in x.middle]
    spread = x.norm * y.radius + x.radius * y.norm + x.radius * y.radius
    result = Ball(middle, (spread >> BITS) + 1 + len(middle))
    if max(result.norm, result.radius).bit_length() > LARGEST:
        raise OverflowError(f"a product or its rounding is beyond 2^{LARGEST - BITS}")
    return result


def power(x: Ball, exponent: int) -> Ball:
    result = x
    for bit in bin(exponent)[3:]:
        result = multiply(result, result)
        if bit == "1":
            result = multiply(result, x)
    return result


def exponential(matrix: exact.Matrix, time: Fraction) -> Ball:
    """e^{M t}: Taylor's series of e^{M t / 2^s} with |M t| / 2^s <= 1/2, its remainder in the radius, and s squarings."""
    scaled = exact.scale(time, matrix)
    size = max(sum(abs(entry) for entry in row) for row in scaled)
    squarings = max(0, math.ceil(size).bit_length() + 1)
    x = enclose(exact.scale(Fraction(1, 2**squarings), scaled))
    term = total = enclose(exact.identity(len(matrix)))
    order = 1
    while term.norm > len(matrix):  # until only rounding is left; terms halve at least, so the rest is below the last one
        raised = multiply(term, x)
        term = Ball([[entry // order for entry in row] for row in raised.middle], raised.radius // order + 1 + len(matrix))
        total = Ball(_plus(total.middle, term.middle), total.radius + term.radius)
        order += 1
    total = Ball(total.middle, total.radius + term.norm + term.radius)
    for _ in range(squarings):
        total = multiply(total, total)
    return total


def balanced(matrices: Sequence[exact.Matrix]) -> list[exact.Matrix]:
    """The matrices D^-1 M D, D diagonal of powers of two, with rows and columns of like size in the sum of the |M| (Osborne):
    the same eigenvalues and traces, and fewer digits lost. Exact, since only D is found in floats."""
    n = len(matrices[0])
    size = [[float(sum(abs(m[i][j]) for m in matrices)) for j in range(n)] for i in range(n)]
    d = [0] * n
    for i in list(range(n)) * 10:
        row = sum(size[i][j] * 2.0 ** (d[j] - d[i]) for j in range(n) if j != i)
        column = sum(size[j][i] * 2.0 ** (d[i] - d[j]) for j in range(n) if j != i)
        if 0 < row < math.inf and 0 < column < math.inf:
            d[i] += round((math.log2(row) - math.log2(column)) / 2)
    return [[[m[i][j] * Fraction(2) ** (d[j] - d[i]) for j in range(n)] for i in range(n)] for m in matrices]


def trace_exceeds(x: Ball, bound: int) -> bool:
    """Whether |trace| > bound for every matrix of the ball. |tr M| > n implies an eigenvalue outside the unit circle."""
    n = len(x.middle)
    return abs(sum(x.middle[i][i] for i in range(n))) - n * x.radius > bound << BITS


def chain(factors: Sequence[Ball]) -> Ball:
    """The product, the first factor acting first (rightmost)."""
    result = factors[0]
    for factor in factors[1:]:
        result = multiply(factor, result)
    return result


def _plus(x: list[list[int]], y: list[list[int]]) -> list[list[int]]:
    return [[a + b for a, b in zip(row, other, strict=True)] for row, other in zip(x, y, strict=True)]
