"""How primitives act on entries: elementwise ones cell by cell, moves of data by position, small products written out."""

import operator
from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._vector_math import VECTOR

PRODUCTS = 512  # a matrix product with more multiplications stays one


class Entries(NamedTuple):
    """An array cell by cell: NumPy scalars (constants), JAX scalars (the same for all lanes) or arrays (lanes,)."""

    cells: np.ndarray  # of objects
    dtype: Any

    @classmethod
    def of(cls, number: Any) -> "Entries":
        """A single number."""
        cells = np.empty((), object)
        cells[()] = number
        return cls(cells, number.dtype)


Rule = Callable[[Any, list[Entries], int], list[Entries] | None]  # None: there is no rule for this case

CALLS = {  # primitives that only call a function: where they keep it
    "jit": "jaxpr", "pjit": "jaxpr", "closed_call": "call_jaxpr", "core_call": "call_jaxpr", "remat2": "jaxpr",
    "checkpoint": "jaxpr", "custom_jvp_call": "call_jaxpr", "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}  # fmt: skip

_ELEMENTWISE = """
    abs acos acosh add add_any and asin asinh atan atan2 atanh bitcast_convert_type cbrt ceil clamp convert_element_type copy
    copy_p cos cosh digamma div eq erf erf_inv erfc exp exp2 expm1 floor ge gt igamma igammac integer_pow is_finite le lgamma
    log log1p logistic lt max min mul name ne neg nextafter not or pow rem round rsqrt select_n shift_left
    shift_right_arithmetic shift_right_logical sign sin sinh sqrt square stop_gradient sub tan tanh xor
"""
_MOVES = """
    broadcast_in_dim concatenate dynamic_slice dynamic_update_slice expand_dims gather pad reshape rev scatter slice squeeze
    split stack transpose
"""
ELEMENTWISE = frozenset(_ELEMENTWISE.split())
MOVES = frozenset(_MOVES.split())  # their outputs are entries of their data; the other inputs are positions
DATA = {"gather": 1, "dynamic_slice": 1, "dynamic_update_slice": 2}  # so many of the inputs are data; elsewhere all of them
REDUCTIONS = {
    "reduce_sum": "add", "reduce_prod": "mul", "reduce_max": "max", "reduce_min": "min", "reduce_and": "and", "reduce_or": "or",
}  # fmt: skip
COMBINE: dict[str, Callable[[Any, Any], Any]] = {
    "add": jnp.add, "mul": jnp.multiply, "max": jnp.maximum, "min": jnp.minimum, "and": operator.and_, "or": operator.or_,
}  # fmt: skip


def rule_of(name: str) -> Rule | None:
    """The rule of a primitive, None if it has none."""
    if name in ELEMENTWISE:
        return elementwise
    if name in MOVES:
        return move
    if name in REDUCTIONS:
        return reduction
    return {"dot_general": product, "iota": iota, "scatter-add": scatter_add, "scatter_add": scatter_add}.get(name)


def elementwise(equation: Any, given: list[Entries], lanes: int) -> list[Entries] | None:
    """The primitive on each cell; scalars and axes of size 1 meet every cell."""
    variable = equation.outputs[0]
    if variable.aval.ndim != max(one.cells.ndim for one in given):  # bits that become numbers of another size
        return None
    cells = np.empty(variable.aval.shape, object)
    operands = [np.broadcast_to(one.cells, cells.shape) for one in given]
    for index in np.ndindex(*cells.shape):
        cells[index] = _bind(equation, [one[index] for one in operands], lanes)
    return [Entries(cells, variable.aval.dtype)]


def _bind(equation: Any, cells: list[Any], lanes: int) -> Any:
    name = equation.primitive.name
    if all(is_constant(one) for one in cells):
        return _now(equation, cells)
    if name in ("add", "add_any", "sub", "mul"):
        return combine(name, *cells)
    if name == "select_n" and is_constant(cells[0]):
        return cells[1 + int(cells[0])]
    if lanes and name in VECTOR:
        return VECTOR[name](*cells)
    if any(np.ndim(one) for one in cells):
        cells = [one if np.ndim(one) else jnp.broadcast_to(one, (lanes,)) for one in cells]
    return equation.primitive.bind(*(jnp.asarray(one) for one in cells), **equation.params)


def combine(name: str, a: Any, b: Any) -> Any:
    """a + b, a - b, a b: what is zero or one by structure costs nothing."""
    if name == "mul":
        if _is(a, 0) or _is(b, 0):
            return a if _is(a, 0) else b
        if _is(a, 1) or _is(b, 1):
            return b if _is(a, 1) else a
        return a * b
    if _is(b, 0):
        return a
    if _is(a, 0):
        return -b if name == "sub" else b
    return a - b if name == "sub" else a + b


def is_constant(cell: Any) -> bool:
    return isinstance(cell, (np.generic, np.ndarray))


def _is(cell: Any, value: int) -> bool:
    return is_constant(cell) and bool(cell == value)


def _now(equation: Any, cells: list[Any]) -> Any:
    """Constants are computed while tracing."""
    with jax.ensure_compile_time_eval():
        result = np.asarray(equation.primitive.bind(*(jnp.asarray(one) for one in cells), **equation.params))
    return result[()]


def move(equation: Any, given: list[Entries], lanes: int) -> list[Entries] | None:
    """The primitive acts on positions instead of data, while tracing: each output cell is then one of the input's."""
    name = equation.primitive.name
    if name == "scatter":
        if equation.params["update_jaxpr"] is not None:  # x.at[i].apply(f) is a scatter too, with f in this place
            return None
        operand, indices, updates = given
        data, others, order = [operand, updates], [indices], [0, 2, 1]
    else:
        count = DATA.get(name, len(given))
        data, others, order = given[:count], given[count:], list(range(len(given)))
    if not all(is_constant(cell) for one in others for cell in one.cells.reshape(-1)):
        return None
    flat = np.concatenate([one.cells.reshape(-1) for one in data])
    starts = np.cumsum([0, *(one.cells.size for one in data)])
    positions = [np.arange(a, a + one.cells.size).reshape(one.cells.shape) for a, one in zip(starts, data, strict=False)]
    where = [np.array(one.cells.tolist(), one.dtype).reshape(one.cells.shape) for one in others]
    arranged: list[Any] = [None] * len(order)
    for place, array in zip(order, [*positions, *where], strict=True):
        arranged[place] = array
    params = dict(equation.params)
    if name == "gather":
        params["fill_value"] = -1
    with jax.ensure_compile_time_eval():
        numbers = [jnp.asarray(a, jnp.int32 if i in order[: len(data)] else a.dtype) for i, a in enumerate(arranged)]
        out = equation.primitive.bind(*numbers, **params)
    results = out if equation.primitive.multiple_results else [out]
    found = [np.asarray(one).astype(int) for one in results]
    if any(np.any((one < 0) | (one >= len(flat))) for one in found):  # beyond the data: a fill value
        return None
    return [Entries(_take(flat, one), var.aval.dtype) for one, var in zip(found, equation.outputs, strict=True)]


def _take(flat: np.ndarray, positions: np.ndarray) -> np.ndarray:
    cells = np.empty(positions.shape, object)
    for index in np.ndindex(*positions.shape):
        cells[index] = flat[positions[index]]
    return cells


def scatter_add(equation: Any, given: list[Entries], lanes: int) -> list[Entries] | None:
    """operand + updates at constant positions, each hit once."""
    operand, indices, updates = given
    if not all(is_constant(cell) for cell in indices.cells.reshape(-1)):
        return None
    size = updates.cells.size
    if not jnp.issubdtype(operand.dtype, jnp.number) or jnp.issubdtype(operand.dtype, jnp.complexfloating):
        return None
    hit = np.arange(1, size + 1).astype(operand.dtype).reshape(updates.cells.shape)
    index = np.array(indices.cells.tolist(), indices.dtype).reshape(indices.cells.shape)
    with jax.ensure_compile_time_eval():
        zeros = jnp.zeros(operand.cells.shape, operand.dtype)
        into = np.asarray(equation.primitive.bind(zeros, jnp.asarray(index), jnp.asarray(hit), **equation.params)).astype(int)
    if sorted(into[into > 0].tolist()) != list(range(1, size + 1)):
        return None
    flat = updates.cells.reshape(-1)
    cells = operand.cells.copy()
    for at in np.ndindex(*into.shape):
        if into[at]:
            cells[at] = combine("add", operand.cells[at], flat[into[at] - 1])
    return [Entries(cells, operand.dtype)]


def reduction(equation: Any, given: list[Entries], lanes: int) -> list[Entries] | None:
    """Along the axes, in order."""
    (entries,), axes = given, equation.params["axes"]
    name = REDUCTIONS[equation.primitive.name]
    kept = [axis for axis in range(entries.cells.ndim) if axis not in axes]
    moved = entries.cells.transpose(*kept, *axes)
    if entries.cells.size == 0:
        return None
    rows = moved.reshape((*moved.shape[: len(kept)], -1))
    step = (lambda a, b: combine(name, a, b)) if name in ("add", "mul") else COMBINE[name]
    cells = np.empty(rows.shape[:-1], object)
    for index in np.ndindex(*cells.shape):
        cells[index] = reduce(step, list(rows[index]))
    return [Entries(cells, entries.dtype)]


def product(equation: Any, given: list[Entries], lanes: int) -> list[Entries] | None:
    """sum_k a_ik b_kj written out, batch axes first, where it is small."""
    (contract_a, contract_b), (batch_a, batch_b) = equation.params["dimension_numbers"]
    a, b = given[0].cells, given[1].cells
    free_a = [axis for axis in range(a.ndim) if axis not in (*contract_a, *batch_a)]
    free_b = [axis for axis in range(b.ndim) if axis not in (*contract_b, *batch_b)]
    batch = [a.shape[axis] for axis in batch_a]
    depth = int(np.prod([a.shape[axis] for axis in contract_a], dtype=int))
    variable = equation.outputs[0]
    if depth * variable.aval.size == 0 or variable.aval.size * depth > PRODUCTS or variable.aval.dtype != given[0].dtype:
        return None
    count = int(np.prod(batch, dtype=int))
    left = a.transpose(*batch_a, *free_a, *contract_a).reshape(count, -1, depth)
    right = b.transpose(*batch_b, *free_b, *contract_b).reshape(count, -1, depth)
    cells = np.empty((count, left.shape[1], right.shape[1]), object)
    for s, i, j in np.ndindex(*cells.shape):
        terms = [combine("mul", x, y) for x, y in zip(left[s, i], right[s, j], strict=True)]
        cells[s, i, j] = reduce(lambda x, y: combine("add", x, y), terms)
    return [Entries(cells.reshape(variable.aval.shape), variable.aval.dtype)]


def iota(equation: Any, given: list[Entries], lanes: int) -> list[Entries]:
    """0, 1, 2, ... along one axis: constants."""
    variable = equation.outputs[0]
    axis, shape = equation.params["dimension"], variable.aval.shape
    numbers = np.broadcast_to(np.arange(shape[axis]).reshape([-1 if i == axis else 1 for i in range(len(shape))]), shape)
    cells = np.empty(shape, object)
    for index in np.ndindex(*shape):
        cells[index] = numbers[index].astype(variable.aval.dtype)
    return [Entries(cells, variable.aval.dtype)]
