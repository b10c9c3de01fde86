"""The dual ray for every gain: multipliers that no gain touches, on the face where they must lie, exactly.

With sum_c X_c output' = 0 and X_c >= 0 each X_c = N'Z_c N for rows N that span the kernel of the output, and S >= 0 asks of it
that sum_c output A_c N'Z_c = 0. What these equations force to zero is taken out of N; the rest is solved, rounded, corrected.
Source: Borwein and Wolkowicz, J. Austral. Math. Soc. A 30 (1981) 369-380 (facial reduction).
"""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import scipy.linalg

from jaxobs.certificates import exact
from jaxobs.designs import sdp
from jaxobs.designs.polytope import Polytope

INTERIOR = 1e-6  # the least smallest eigenvalue of S that is worth rounding


def every_gain(model: Polytope, points: np.ndarray, *, rate: float, step: bool) -> np.ndarray | None:
    """X_c (points, n, n) with sum_c X_c output' = 0 and S >= 0 (see no_gain) but for rounding errors of the solver, which are
    gone after the exact correction; None if none was found, or none that fits into floats."""
    output = exact.matrix(model.output.tolist())
    moves = [_at(model, rho) for rho in points.tolist()]
    basis, images = exact.kernel(output, model.n), []
    while basis:
        basis = [_short(row) for row in basis]
        images = [exact.product(output, exact.product(a, exact.transpose(basis))) for a in moves]
        forced = [row for k in range(model.p) if (row := _common([image[k] for image in images])) is not None]
        if not forced:
            break
        inside = exact.kernel(forced, len(basis))
        basis = exact.product(inside, basis) if inside else []
    if not basis:
        return None  # some high gain does it
    z = _inside(moves, basis, images, rate, step)
    z = None if z is None else _corrected(z, images)
    return None if z is None else _floats([exact.product(exact.transpose(basis), exact.product(one, basis)) for one in z])


def _at(model: Polytope, rho: Sequence[float]) -> exact.Matrix:
    a, b, c = (exact.matrix(part.tolist()) for part in (model.a, model.b, model.c))
    for k, value in enumerate(rho):
        a = exact.add(a, [[Fraction(value) * row[k] * entry for entry in c[k]] for row in b])
    return a


def _short(row: Sequence[Fraction]) -> list[Fraction]:
    """A multiple of size one without a common divisor of the numerators."""
    whole = exact.cleared([list(row)])[0]
    divisor = math.gcd(*whole)
    size = max(abs(x // divisor) for x in whole).bit_length() - 1
    return [Fraction(x // divisor, 2**size) for x in whole]


def _common(rows: Sequence[Sequence[Fraction]]) -> list[Fraction] | None:
    """The row of which all are positive multiples: with sum_c alpha_c row Z_c = 0 it is in the kernel of every Z_c >= 0."""
    first = rows[0]
    lead = next((j for j, x in enumerate(first) if x), None)
    if lead is None:
        return None
    for row in rows:
        factor = row[lead] / first[lead]
        if factor <= 0 or any(x != factor * y for x, y in zip(row, first, strict=True)):
            return None
    return list(first)


def _inside(moves, basis, images, rate, step) -> list[exact.Matrix] | None:
    """Z_c with S as far inside as possible, rounded to short dyadic numbers: on the face, but for the rounding."""
    k, count = len(basis), len(moves)
    rows = np.array(basis, float)
    a, m = np.array(moves, float), np.array(images, float)
    size = max(float(np.max(np.linalg.norm(a, 2, axis=(1, 2)))), abs(rate), 1e-290)
    symmetric = sdp.symmetric(k).basis
    units = np.zeros((count * len(symmetric), count, k, k))
    for c in range(count):
        units[c * len(symmetric) : (c + 1) * len(symmetric), c] = symmetric
    equations = np.einsum("cpi,ecij->epj", m, units).reshape(len(units), -1).T
    free = np.einsum("ef,ecij->fcij", scipy.linalg.null_space(equations), units)
    if not len(free):
        return None
    onto = np.linalg.pinv(rows)  # S = N'T N

    def total(z):
        x = rows.T @ z @ rows
        ax = a @ x
        s = ax @ a.transpose(0, 2, 1) - rate**2 * x if step else ax + ax.transpose(0, 2, 1) + 2 * rate * x
        t = onto.T @ np.sum(s, axis=0) @ onto / (size**2 if step else size)
        return (t + t.T) / 2

    def lmis(y, s):
        z = np.tensordot(y[0], free, 1)
        return [np.eye(k) - np.sum(z, axis=0), total(z) - s * np.eye(k), *(one - s * np.eye(k) for one in z)]

    unknowns = {"y": sdp.full(1, len(free), reach=1e2), "s": sdp.scalar(reach=1e2)}
    solved = sdp.optimise(unknowns, lmis, maximise=lambda s, **_: s, margin=0.0)
    if not solved.values or solved.value < INTERIOR:
        return None
    z = np.tensordot(solved.values["y"][0], free, 1)
    unit = 2.0 ** np.floor(np.log2(solved.value / (16 * k * count)))
    return [exact.matrix((np.round(one / unit) * unit).tolist()) for one in (z + z.transpose(0, 2, 1)) / 2]


def _corrected(z: list[exact.Matrix], images: Sequence[exact.Matrix]) -> list[exact.Matrix] | None:
    """Z_c with a few entries changed so that sum_c output A_c N'Z_c = 0, exactly."""
    k, p = len(z[0]), len(images[0])
    entries = [(c, i, j) for c in range(len(z)) for i in range(k) for j in range(i, k)]
    size = [(row, column) for row in range(p) for column in range(k)]

    def column(c: int, i: int, j: int) -> list[Fraction]:
        m = images[c]
        return [m[row][i] * (at == j) + (m[row][j] * (at == i) if i != j else 0) for row, at in size]

    rest = [-sum((images[c][row][i] * z[c][i][at] for c in range(len(z)) for i in range(k)), Fraction(0)) for row, at in size]
    columns = zip(*(column(*e) for e in entries), strict=True)
    table = [[*row, r] for row, r in zip(columns, rest, strict=True)]
    shortest = sorted(range(len(entries)), key=lambda j: sum(abs(row[j].numerator).bit_length() for row in table))
    table, pivots = exact.reduced(table, shortest)
    if any(row[-1] for row in table[len(pivots) :]):
        return None
    for row, j in zip(table, pivots, strict=False):
        c, i, at = entries[j]
        z[c][i][at] += row[-1]
        if i != at:
            z[c][at][i] += row[-1]
    return z


def _floats(x: list[exact.Matrix]) -> np.ndarray | None:
    """A positive multiple of all of them in floats, without rounding."""
    whole = exact.cleared([row for one in x for row in one])
    divisor = math.gcd(*(entry for row in whole for entry in row)) or 1
    whole = [[entry // divisor for entry in row] for row in whole]
    longest = max(abs(entry).bit_length() for row in whole for entry in row)
    if longest > 900 or any(Fraction(float(entry)) != entry for row in whole for entry in row):
        return None
    return np.array([[float(entry) for entry in row] for row in whole]).reshape(len(x), len(x[0]), -1) / 2.0**longest
