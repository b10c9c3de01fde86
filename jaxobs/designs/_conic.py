"""Small semidefinite programs: affine matrices as arrays, handed to the solver without a modelling language.

An affine function of the unknowns x_1 .. x_m is an array whose FIRST axis counts 1, x_1, .., x_m: the constant, then the
slopes. Sums, products with known matrices, blocks and stacks of such matrices are then those of NumPy:

    p, y = variables(symmetric(2), full(2, 1))
    x = minimise(trace(p)[...], [-sym(p @ a - y @ c)])          # each matrix of a stack >= 0

What comes out is a proposal: whoever uses it checks it.
"""

from collections.abc import Sequence
from typing import Any

import clarabel as _clarabel
import numpy as np
import scipy.sparse

clarabel: Any = _clarabel  # a compiled module, without types
Affine = np.ndarray  # (1 + m, ..., k, l)

# Structure that the solver would look for is not there, and looking takes longer than solving; scaling is done before.
SETTINGS = {"verbose": False, "presolve_enable": False, "chordal_decomposition_enable": False, "max_iter": 100,
            "equilibrate_min_scaling": 0.1, "equilibrate_max_scaling": 10.0}  # fmt: skip


def symmetric(n: int) -> np.ndarray:
    """The basis of the symmetric (n, n) matrices."""
    rows, columns = np.triu_indices(n)
    units, k = np.zeros((len(rows), n, n)), np.arange(len(rows))
    units[k, rows, columns] = units[k, columns, rows] = 1
    return units


def diagonal(n: int) -> np.ndarray:
    """The basis of the diagonal (n, n) matrices."""
    return np.eye(n)[:, :, None] * np.eye(n)[:, None, :]


def full(rows: int, columns: int) -> np.ndarray:
    """The basis of the (rows, columns) matrices."""
    return np.eye(rows * columns).reshape(rows * columns, rows, columns)


def variables(*bases: np.ndarray) -> list[Affine]:
    """One unknown matrix for each basis, all as functions of the same x."""
    unknowns, first, size = [], 1, 1 + sum(map(len, bases))
    for basis in bases:
        unknown = np.zeros((size, *basis.shape[1:]))
        unknown[first : first + len(basis)] = basis
        first += len(basis)
        unknowns.append(unknown)
    return unknowns


def constant(value: np.ndarray, like: Affine) -> Affine:
    """A known matrix as a function of the same x."""
    found = np.zeros((len(like), *np.shape(value)))
    found[0] = value
    return found


def transpose(a: Affine) -> Affine:
    """a'."""
    return np.swapaxes(a, -1, -2)


def sym(a: Affine) -> Affine:
    """a + a'."""
    return a + np.swapaxes(a, -1, -2)


def trace(a: Affine) -> Affine:
    """The sum of the diagonal, for each matrix of a stack."""
    return np.trace(a, axis1=-2, axis2=-1)


def block(rows: Sequence[Sequence[Affine]]) -> Affine:
    """As numpy.block, over leading axes that broadcast."""
    shape = np.broadcast_shapes(*(part.shape[:-2] for row in rows for part in row))
    wide = [[np.broadcast_to(part, shape + part.shape[-2:]) for part in row] for row in rows]
    return np.concatenate([np.concatenate(row, -1) for row in wide], -2)


def triangle(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(rows, columns, weights) of the entries of a symmetric matrix that the solver wants: the upper triangle by columns, those
    off the diagonal times sqrt(2), so that lengths are kept."""
    columns, rows = np.tril_indices(size)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


def value(a: Affine, x: np.ndarray) -> np.ndarray:
    """The matrix at x (m,)."""
    return np.asarray(a[0] + np.tensordot(x, a[1:], 1))


def minimise(
    cost: Affine, matrices: Sequence[Affine], *, cones: Sequence[Affine] = (), quadratic: np.ndarray | None = None
) -> np.ndarray | None:
    """min cost(x) + x'quadratic x / 2:   every matrix of `matrices` >= 0,   cone[0] >= |cone[1:]| for each of `cones`.

    cost (1 + m,); matrices (1 + m, ..., k, k), symmetric; cones (1 + m, k). The solver's last x, whatever it says of it; None
    if that is not finite. Solver: Clarabel (Goulart and Chen, 2024), an interior-point method.
    """
    m, slopes, offsets, kinds = len(cost) - 1, [], [], []
    for cone in cones:
        slopes.append(-cone[1:].T)
        offsets.append(cone[0])
        kinds.append(clarabel.SecondOrderConeT(cone.shape[1]))
    for matrix in matrices:
        size = matrix.shape[-1]
        rows, columns, weights = triangle(size)
        entries = (matrix[..., rows, columns] * weights).reshape(m + 1, -1)
        slopes.append(-entries[1:].T)
        offsets.append(entries[0])
        kinds += [clarabel.PSDTriangleConeT(size)] * (entries.shape[1] // len(rows))
    settings = clarabel.DefaultSettings()
    for name, choice in SETTINGS.items():
        setattr(settings, name, choice)
    square = scipy.sparse.csc_matrix((m, m)) if quadratic is None else scipy.sparse.csc_matrix(np.triu(quadratic))
    rows = scipy.sparse.csc_matrix(np.concatenate(slopes))
    solver = clarabel.DefaultSolver(square, np.array(cost[1:], float), rows, np.concatenate(offsets), kinds, settings)
    x = np.array(solver.solve().x)
    return x if np.all(np.isfinite(x)) else None
