"""What the certificates of chain observers share: the error dynamics in exact arithmetic, and the checks of stored shapes."""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction

from jaxobs.certificates import exact
from jaxobs.certificates.base import FloatMatrix

LARGEST = 12  # n + q, and the rows of F: a hostile file could otherwise keep the check busy


def shift(size: int) -> exact.Matrix:
    """A: ones above the diagonal."""
    return [[Fraction(int(j == i + 1)) for j in range(size)] for i in range(size)]


def injection(gain: Sequence[float]) -> exact.Matrix:
    """L C with C = e_1': the gain in the first column."""
    return [[Fraction(g) if j == 0 else Fraction(0) for j in range(len(gain))] for g in gain]


def augmented(left: FloatMatrix, right: FloatMatrix, q: int) -> tuple[exact.Matrix, exact.Matrix]:
    """(M, N) of the chain behind q integrators: zeros above M, zeros left of N."""
    m, n = exact.matrix(left), exact.matrix(right)
    return exact.zeros(q, len(m[0])) + m, [[Fraction(0)] * q + row for row in n]


def malformed(
    n: int, q: int, gain: Sequence[float], matrices: Mapping[str, tuple[FloatMatrix, int | None, int | None]]
) -> str | None:
    """What is wrong with the sizes: matrices maps a name to (value, rows, columns), None where any number from 1 will do."""
    if not (n >= 1 and q >= 0 and len(gain) == n + q <= LARGEST):
        return f"{len(gain)} gains for n = {n}, q = {q}, at most {LARGEST} in all"
    if not all(math.isfinite(x) for x in gain):
        return "a gain is not finite"
    for name, (value, rows, columns) in matrices.items():
        widths = {len(row) for row in value}
        if not (1 <= len(value) <= LARGEST and len(widths) == 1 and 1 <= min(widths) <= LARGEST):
            return f"{name} is not a matrix"
        if (rows or len(value), columns or len(value[0])) != (len(value), len(value[0])):
            return f"{name} is of shape {(len(value), len(value[0]))}"
        if not all(math.isfinite(x) for row in value for x in row):
            return f"{name} has an entry that is not finite"
    return None
