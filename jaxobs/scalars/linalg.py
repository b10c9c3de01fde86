"""Small factorisations and triangular solves on entries, written out as on paper; larger ones go through vmap."""

from functools import reduce
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxobs.scalars.rules import Entries, combine, is_constant

LARGEST = 6  # the number of operations grows with the cube of the size


def cholesky(equation: Any, given: list[Entries], lanes: int) -> list[Entries] | None:
    """L with L L' = A: l_jj = sqrt(a_jj - sum_k l_jk^2), l_ij = (a_ij - sum_k l_ik l_jk) / l_jj; all NaN unless A > 0."""
    (entries,) = given
    a, n = entries.cells, entries.cells.shape[-1]
    if a.ndim != 2 or n > LARGEST or jnp.issubdtype(entries.dtype, jnp.complexfloating):
        return None
    if equation.params.get("symmetrize_input", False):
        half = np.asarray(0.5, entries.dtype)[()]
        a = np.array([[combine("mul", half, combine("add", a[i, j], a[j, i])) for j in range(n)] for i in range(n)], object)
    factor = np.full((n, n), np.zeros((), entries.dtype)[()], object)
    for j in range(n):
        factor[j, j] = jnp.sqrt(_less(a[j, j], factor[j, :j], factor[j, :j]))
        for i in range(j + 1, n):
            factor[i, j] = _less(a[i, j], factor[i, :j], factor[j, :j]) / factor[j, j]
    positive = reduce(lambda whole, pivot: whole & (pivot > 0), factor.diagonal(), jnp.asarray(True))
    for index in zip(*np.tril_indices(n), strict=True):
        if not is_constant(factor[index]):
            factor[index] = jnp.where(positive, factor[index], jnp.asarray(jnp.nan, entries.dtype))
    return [Entries(factor, entries.dtype)]


def triangular_solve(equation: Any, given: list[Entries], lanes: int) -> list[Entries] | None:
    """X with op(A) X = B, or X op(A) = B, by substitution; op is the transpose or nothing."""
    params = equation.params
    a, b = given[0].cells, given[1].cells
    n = a.shape[-1]
    if a.ndim != 2 or n > LARGEST or jnp.issubdtype(given[1].dtype, jnp.complexfloating):
        return None
    if not params["left_side"]:  # X op(A) = B is op(A)' X' = B'
        b = b.T
    if bool(params["transpose_a"]) != (not params["left_side"]):
        a = a.T
    lower = bool(params["lower"]) != (bool(params["transpose_a"]) != (not params["left_side"]))
    x = np.empty(b.shape, object)
    for column in range(b.shape[1]):
        for row in range(n) if lower else range(n - 1, -1, -1):
            known = slice(0, row) if lower else slice(row + 1, n)
            value = _less(b[row, column], a[row, known], x[known, column])
            x[row, column] = value if params["unit_diagonal"] else value / a[row, row]
    return [Entries(x if params["left_side"] else x.T, given[1].dtype)]


def qr(equation: Any, given: list[Entries], lanes: int) -> list[Entries] | None:
    """Q and R of a tall A by reflections, of one run (lanes keep LAPACK's): for each column x below the diagonal, alpha = x_1,

    beta = -sign(alpha) |x|,    v = x - beta e_1,    every column c becomes c - v (v'c) / (beta (beta - alpha)).
    """
    (entries,) = given
    params, (rows, columns) = equation.params, entries.cells.shape[-2:]
    if lanes or entries.cells.ndim != 2 or columns > LARGEST or rows < columns:
        return None
    if params.get("full_matrices") or params.get("pivoting") or jnp.issubdtype(entries.dtype, jnp.complexfloating):
        return None
    zero, one = np.zeros((), entries.dtype)[()], np.ones((), entries.dtype)[()]
    r, turns = entries.cells.copy(), []
    for j in range(columns):
        alpha, below = r[j, j], [r[i, j] for i in range(j + 1, rows)]
        if all(is_constant(x) and x == 0 for x in below):
            continue
        size = jnp.sqrt(reduce(lambda a, b: combine("add", a, b), [combine("mul", x, x) for x in (alpha, *below)]))
        beta = jnp.where(alpha > 0, -size, size)
        scale = beta * (beta - alpha)
        turn = (j, [alpha - beta, *below], jnp.where(scale > 0, 1 / jnp.where(scale > 0, scale, one), zero))
        turns.append(turn)
        for column in range(j + 1, columns):
            _reflect(r[:, column], turn)
        r[j, j], r[j + 1 :, j] = beta, zero
    q = np.full((rows, columns), zero, object)
    for j in range(columns):
        q[j, j] = one
    for turn in reversed(turns):
        for column in range(columns):
            _reflect(q[:, column], turn)
    return [Entries(q, entries.dtype), Entries(r[:columns], entries.dtype)]


def _reflect(column: np.ndarray, turn: tuple[int, list[Any], Any]) -> None:
    """column - v (v' column) factor, in place, from entry j on."""
    j, v, factor = turn
    along = reduce(lambda a, b: combine("add", a, b), [combine("mul", x, y) for x, y in zip(v, column[j:], strict=True)])
    along = combine("mul", along, factor)
    for i, x in enumerate(v):
        column[j + i] = combine("sub", column[j + i], combine("mul", along, x))


def _less(value: Any, left: np.ndarray, right: np.ndarray) -> Any:
    """value - sum_k left_k right_k."""
    products = [combine("mul", x, y) for x, y in zip(left, right, strict=True)]
    return reduce(lambda total, term: combine("sub", total, term), products, value)


RULES = {"cholesky": cholesky, "qr": qr, "triangular_solve": triangular_solve}
