"""Exact linear algebra for designs, papers and tests: every float is a dyadic rational, so nothing is rounded from here on."""

import math
from collections.abc import Sequence
from fractions import Fraction

Matrix = list[list[Fraction]]
Entries = Sequence[Sequence[Fraction | int]]


def cleared(matrix: Entries) -> list[list[int]]:
    """The matrix times a positive integer, in integers."""
    common = math.lcm(*(entry.denominator for row in matrix for entry in row))
    return [[int(entry * common) for entry in row] for row in matrix]


def leading_minors(matrix: Entries) -> list[int]:
    """The signs-preserving integer leading minors of a symmetric matrix, by fraction-free (Bareiss) elimination after clearing
    denominators.

    The k-th value is the k-th leading minor times a positive number. Elimination stops after the first that is not positive.
    """
    a = cleared(matrix)
    n, previous, minors = len(a), 1, []
    for k in range(n):
        minors.append(a[k][k])
        if a[k][k] <= 0:
            break
        for i in range(k + 1, n):
            for j in range(i, n):  # the upper half; a_ik = a_ki
                a[i][j] = (a[i][j] * a[k][k] - a[k][i] * a[k][j]) // previous
        previous = a[k][k]
    return minors


def is_positive_definite(matrix: Entries) -> bool:
    """Sylvester's criterion: symmetric with all leading minors positive."""
    n = len(matrix)
    if not all(matrix[i][j] == matrix[j][i] for i in range(n) for j in range(i)):
        return False
    minors = leading_minors(matrix)
    return len(minors) == n and minors[-1] > 0


def inverse_corner(matrix: Matrix) -> Fraction:
    """(M^-1)_nn of a positive definite M: the ratio of its last two leading minors."""
    common = math.lcm(*(entry.denominator for row in matrix for entry in row))
    minors = [1, *leading_minors(matrix)]
    return Fraction(minors[-2], minors[-1]) * common


def combine(a: Fraction, x: Matrix, b: Fraction, y: Matrix) -> Matrix:
    """a X + b Y."""
    return [[a * p + b * q for p, q in zip(row, other, strict=True)] for row, other in zip(x, y, strict=True)]


def diagonal(entries: Sequence[Fraction]) -> Matrix:
    n = len(entries)
    return [[entries[i] if i == j else Fraction(0) for j in range(n)] for i in range(n)]


def chain_weights(alphas: Sequence[Fraction]) -> list[Fraction]:
    """q_i = alpha_i^2 + 2 sum_j (-1)^j alpha_{i-j} alpha_{i+j} (paper 000, the corrected (8))."""
    a, n = [Fraction(1), *alphas], len(alphas)
    return [a[i] ** 2 + 2 * sum((-1) ** j * a[i - j] * a[i + j] for j in range(1, min(i, n - i) + 1)) for i in range(1, n + 1)]


def chain_riccati(alphas: Sequence[Fraction]) -> Matrix:
    """P~_ij = sum_{m < min(i,j)} (-1)^m alpha_{max+m} alpha_{min-1-m} (paper 000, (18)-(21) in closed form)."""
    a, n = [Fraction(1), *alphas], len(alphas)

    def entry(i: int, j: int) -> Fraction:
        high, low = max(i, j), min(i, j)
        return sum(((-1) ** m * a[high + m] * a[low - 1 - m] for m in range(low) if high + m <= n), Fraction(0))

    return [[entry(i, j) for j in range(1, n + 1)] for i in range(1, n + 1)]


def riccati_residual_is_zero(p: Matrix, q: Sequence[Fraction]) -> bool:
    """Whether A P + P A' - P C'C P + diag(q) = 0 for the chain: A the shift, C = e_1'."""
    n = len(p)

    def shifted(i: int, j: int) -> Fraction:  # (A P)_ij
        return p[i + 1][j] if i + 1 < n else Fraction(0)

    return all(
        shifted(i, j) + shifted(j, i) - p[i][0] * p[j][0] + (q[i] if i == j else 0) == 0 for i in range(n) for j in range(n)
    )


def matrix(rows: Sequence[Sequence[float]]) -> Matrix:
    """The floats as they are."""
    return [[Fraction(x) for x in row] for row in rows]


def transpose(x: Matrix) -> Matrix:
    return [list(column) for column in zip(*x, strict=True)]


def product(x: Matrix, y: Matrix) -> Matrix:
    columns = transpose(y)
    return [[sum((a * b for a, b in zip(row, column, strict=True)), Fraction(0)) for column in columns] for row in x]


def add(x: Matrix, y: Matrix) -> Matrix:
    return combine(Fraction(1), x, Fraction(1), y)


def subtract(x: Matrix, y: Matrix) -> Matrix:
    return combine(Fraction(1), x, Fraction(-1), y)


def scale(a: Fraction, x: Matrix) -> Matrix:
    return [[a * entry for entry in row] for row in x]


def identity(n: int) -> Matrix:
    return diagonal([Fraction(1)] * n)


def zeros(rows: int, columns: int) -> Matrix:
    return [[Fraction(0)] * columns for _ in range(rows)]


def block(rows: Sequence[Sequence[Matrix]]) -> Matrix:
    """The matrix made of blocks, as numpy.block."""
    return [[entry for part in parts for entry in part] for blocks in rows for parts in zip(*blocks, strict=True)]


def reduced(rows: Matrix, columns: Sequence[int]) -> tuple[Matrix, list[int]]:
    """(the rows with units in the pivot columns, those of zeros last; these columns), by Gauss and Jordan.

    columns: where pivots are looked for, in this order.
    """
    table, pivots = [list(row) for row in rows], []
    for j in columns:
        top = len(pivots)
        place = next((i for i in range(top, len(table)) if table[i][j]), None)
        if place is None:
            continue
        table[top], table[place] = table[place], table[top]
        lead = table[top] = [x / table[top][j] for x in table[top]]
        for i, row in enumerate(table):
            if i != top and row[j]:
                table[i] = [x - row[j] * y for x, y in zip(row, lead, strict=True)]
        pivots.append(j)
    return table, pivots


def kernel(rows: Matrix, n: int) -> Matrix:
    """A basis of {v (n,): rows v = 0}, one vector a row, each with a 1 where the others have 0."""
    table, pivots = reduced(rows, range(n))
    basis = []
    for free in (j for j in range(n) if j not in pivots):
        vector = [Fraction(int(j == free)) for j in range(n)]
        for row, column in zip(table, pivots, strict=False):
            vector[column] = -row[free]
        basis.append(vector)
    return basis


def inverse(rows: Matrix) -> Matrix | None:
    """None for a singular matrix."""
    n = len(rows)
    table, pivots = reduced([[*row, *unit] for row, unit in zip(rows, identity(n), strict=True)], range(n))
    return [row[n:] for row in table] if len(pivots) == n else None
