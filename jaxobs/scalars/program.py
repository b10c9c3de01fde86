"""Scalar replacement: a function of one lane's small arrays becomes one of many lanes' numbers.

JAX batches an array (n,) over lanes as (lanes, n), and shifts, stacks and small products then move memory. Here every entry is
an array (lanes,) of its own, as a program written by hand in C has it: shifts and transposes cost nothing, small products are
written out, structural zeros are dropped, and XLA fuses a whole time step into one loop over lanes. What has no rule runs
through `jax.vmap`, so every function works. With lanes = 0 it is one run: its entries are numbers, and no axis is added.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from jaxobs.scalars import linalg
from jaxobs.scalars.flat import Equation, Program, Variable, flatten
from jaxobs.scalars.rules import Entries, Rule, is_constant, rule_of

WHOLE = 64  # arrays with more entries stay arrays
ACROSS = ("unvmap_all", "unvmap_any", "unvmap_max")  # equinox's answers for all lanes together, on which its errors depend


class Whole(NamedTuple):
    """A value that is kept as an array: (lanes, *shape) if batched, else the same for all lanes."""

    array: Any
    batched: bool


Value = Entries | Whole


def evaluate(program: Program, equations: Sequence[Equation], env: dict[Any, Value], lanes: int, rules: bool = True) -> None:
    """Runs the equations over `lanes`, adding what they define to `env`; without rules all through `jax.vmap`."""
    for equation in equations:
        given = [value_of(one, program, env) for one in equation.inputs]
        results = apply(equation, given, lanes) if rules else through_vmap(equation, given, lanes)
        env.update(zip(equation.outputs, results, strict=True))


def value_of(atom: Any, program: Program, env: dict[Any, Value]) -> Value:
    """A literal, a constant of the program, or what `env` has."""
    if isinstance(atom, np.ndarray):
        return literal(atom)
    if atom not in env:
        value = program.constants[atom]
        known = not (isinstance(value, jax.core.Tracer) or _is_key(value.dtype))
        env[atom] = literal(np.asarray(value)) if known else Whole(value, False)
    return env[atom]


def loop(equation: Equation, given: list[Value], lanes: int) -> list[Value] | None:
    """A scan that only carries: its body by entries; loops within a step stay in the kernel, their products are written out."""
    params = equation.params
    consts, carried = params["num_consts"], params["num_carry"]
    if len(given) != consts + carried or len(equation.outputs) != carried or params["reverse"]:
        return None
    body = flatten(params["jaxpr"])
    fixed = dict(zip(body.inputs, given, strict=False))
    states = body.inputs[consts:]
    ahead = dict(zip(states, body.outputs, strict=True))
    lane = lane_variables(body.equations, {var for var, one in fixed.items() if differs(one)}, ahead)
    pack = Pack(states, lane, lanes)

    def step(_: Any, packed: tuple[Any, ...]) -> tuple[Any, ...]:
        env = fixed | pack.unpack(packed)
        evaluate(body, body.equations, env, lanes)
        return pack.pack({old: value_of(new, body, env) for old, new in ahead.items()})

    start = pack.pack({var: fixed[var] for var in states})
    end = pack.unpack(jax.lax.fori_loop(0, params["length"], step, start))
    return [end[var] for var in states]


INDEXED = frozenset(("dynamic_slice", "dynamic_update_slice", "gather", "scatter", "scatter_add", "scatter-add"))


def of_one_run(equation: Equation, given: list[Value]) -> list[Value] | None:
    """What a vmap would turn into something else: choices, loops over arrays, and what depends on nothing."""
    name = equation.primitive.name
    if not given:
        with jax.ensure_compile_time_eval():
            return [literal(np.asarray(equation.primitive.bind(**equation.params)))]
    if name == "cond":
        return branch(small(given[0]), [flatten(closed) for closed in equation.params["branches"]], given[1:])
    if name == "scan":
        body = flatten(equation.params["jaxpr"])
        whole = len(given) == equation.params["num_consts"] + equation.params["num_carry"] and not equation.params["reverse"]
        if not whole or any(one.primitive.name in INDEXED for one in body.equations):
            return turns(equation, body, [small(one) for one in given])
    return None


def turns(equation: Equation, body: Program, given: list[Value]) -> list[Value] | None:
    """A scan over arrays, or one that indexes by its count, turn by turn."""
    params, entries = equation.params, [one for one in given if isinstance(one, Entries)]
    first = params["num_consts"] + params["num_carry"]
    if len(entries) != len(given) or params["length"] == 0:
        return None
    state, rows = list(given[params["num_consts"] : first]), []
    order = range(params["length"])
    for i in reversed(order) if params["reverse"] else order:
        across: list[Value] = [Entries(_at(one.cells, i), one.dtype) for one in entries[first:]]
        env = dict(zip(body.inputs, [*given[: params["num_consts"]], *state, *across], strict=True))
        evaluate(body, body.equations, env, 0)
        ends = [small(value_of(one, body, env)) for one in body.outputs]
        state, row = ends[: params["num_carry"]], ends[params["num_carry"] :]
        rows.append([one for one in row if isinstance(one, Entries)])
        if len(rows[-1]) != len(row):
            return None
    rows = rows[::-1] if params["reverse"] else rows
    paths: list[Value] = [Entries(np.stack([one.cells for one in path]), path[0].dtype) for path in zip(*rows, strict=True)]
    return [*state, *paths]


def _at(cells: np.ndarray, i: int) -> np.ndarray:
    return cells.reshape(len(cells), -1)[i].reshape(cells.shape[1:])  # a row of objects, never one object


def branch(which: Value, branches: list[Program], rest: list[Value]) -> list[Value] | None:
    """The results of the branch that is taken, all of them computed unless that is known."""
    if not isinstance(which, Entries):
        return None
    index, last = which.cells[()], len(branches) - 1
    if is_constant(index):
        branches = [branches[int(np.clip(index, 0, last))]]
    ends = []
    for body in branches:
        env = dict(zip(body.inputs, rest, strict=True))
        evaluate(body, body.equations, env, 0)
        ends.append([small(value_of(one, body, env)) for one in body.outputs])
    if is_constant(index):
        return ends[0]
    if not all(isinstance(one, Entries) for end in ends for one in end):
        return None
    index = index if index.dtype == bool else jnp.clip(index, 0, last)
    chosen = []
    for values in zip(*ends, strict=True):
        cells = np.empty(values[0].cells.shape, object)
        for at in np.ndindex(*cells.shape):
            cells[at] = _chosen(index, [jnp.asarray(one.cells[at], one.dtype) for one in values])
        chosen.append(Entries(cells, values[0].dtype))
    return chosen


def _chosen(index: Any, cases: list[Any]) -> Any:
    """cases[index]: two at a time."""
    if index.dtype == bool:
        return jax.lax.select_n(index, *cases)
    value = cases[-1]
    for i in range(len(cases) - 2, -1, -1):
        value = jax.lax.select_n(index == i, value, cases[i])
    return value


def apply(equation: Equation, given: list[Value], lanes: int) -> list[Value]:
    """By its rule where it has one, through vmap otherwise."""
    result = by_rule(equation, given, lanes)
    return [small(one) for one in through_vmap(equation, given, lanes)] if result is None else result


def by_rule(equation: Equation, given: list[Value], lanes: int) -> list[Value] | None:
    """None where an input or output is large, or the primitive has no rule."""
    name = equation.primitive.name
    if not lanes and (ended := of_one_run(equation, given)) is not None:
        return ended
    if name == "scan" and (ended := loop(equation, [small(one) for one in given], lanes)) is not None:
        return ended
    rule: Rule | None = rule_of(name) or linalg.RULES.get(name)
    if rule is not None and all(var.aval.size <= WHOLE for var in equation.outputs):
        entries = [one for one in map(small, given) if isinstance(one, Entries)]
        with np.errstate(all="ignore"):  # constants that overflow are data
            result = rule(equation, entries, lanes) if len(entries) == len(given) else None
        return None if result is None else list(result)
    return None


def through_vmap(equation: Equation, given: list[Value], lanes: int) -> list[Whole]:
    """The primitive itself on whole arrays."""
    wholes = [as_whole(one, lanes) for one in given]
    batched = any(one.batched for one in wholes)
    if equation.primitive.name in ACROSS:
        return [Whole(equation.primitive.bind(*(one.array for one in wholes), **equation.params), False)]

    def bind(*arrays: Any) -> list[Any]:
        out = equation.primitive.bind(*arrays, **equation.primitive.get_bind_params(equation.params))
        return list(out) if equation.primitive.multiple_results else [out]

    run = jax.vmap(bind, in_axes=tuple(0 if one.batched else None for one in wholes), axis_size=lanes) if batched else bind
    return [Whole(array, batched) for array in run(*(one.array for one in wholes))]


def literal(array: np.ndarray) -> Value:
    """A constant: its entries are NumPy scalars, which rules may fold."""
    if array.size > WHOLE:
        return Whole(jnp.asarray(array), False)
    cells = np.empty(array.shape, object)
    for index in np.ndindex(*array.shape):
        cells[index] = array[index]
    return Entries(cells, array.dtype)


def small(value: Value) -> Value:
    """(lanes, *shape) or (*shape) cut into its entries, where they are few."""
    if isinstance(value, Entries) or np.prod(value.array.shape[value.batched :], dtype=int) > WHOLE:
        return value
    if _is_key(value.array.dtype):
        return value
    shape = value.array.shape[1:] if value.batched else value.array.shape
    cells = np.empty(shape, object)
    for index in np.ndindex(*shape):
        cells[index] = value.array[(slice(None), *index)] if value.batched else value.array[index]
    return Entries(cells, value.array.dtype)


def as_whole(value: Value, lanes: int) -> Whole:
    """The entries stacked into one array; batched if any of them differs from lane to lane."""
    if isinstance(value, Whole):
        return value
    cells = list(value.cells.reshape(-1))
    if any(np.ndim(one) == 1 for one in cells):
        spread = [jnp.broadcast_to(jnp.asarray(one, value.dtype), (lanes,)) for one in cells]
        return Whole(jnp.stack(spread, axis=1).reshape((lanes, *value.cells.shape)), True)
    shared = [jnp.asarray(one, value.dtype) for one in cells]
    flat = jnp.stack(shared) if shared else jnp.zeros((0,), value.dtype)
    return Whole(flat.reshape(value.cells.shape), False)


def spread(value: Whole, lanes: int) -> Any:
    """(lanes, *shape), also of what is the same for all lanes."""
    return value.array if value.batched else jnp.broadcast_to(value.array, (lanes, *value.array.shape))


def _is_key(dtype: Any) -> bool:
    """Keys are no numbers: they stay as they are."""
    return jnp.issubdtype(dtype, jax.dtypes.extended)


def lane_variables(equations: Sequence[Equation], lane: set[Any], ahead: dict[Any, Any]) -> set[Any]:
    """All variables that differ from lane to lane if those in `lane` do, and if ahead[v] is v's value at the next step."""
    count = -1
    while count != len(lane):
        count = len(lane)
        for equation in equations:
            if any(one in lane for one in equation.inputs if isinstance(one, Variable)):
                lane |= set(equation.outputs)
        lane |= {var for var, after in ahead.items() if isinstance(after, Variable) and after in lane}
    return lane


def differs(value: Value) -> bool:
    """Whether it differs from lane to lane."""
    if isinstance(value, Whole):
        return value.batched
    return any(np.ndim(one) == 1 for one in value.cells.reshape(-1))


class Pack:
    """The moving state as a flat tuple: (lanes,) for each entry that differs from lane to lane, () for one that does not."""

    def __init__(self, variables: tuple[Variable, ...], lane: set[Any], lanes: int):
        self.variables, self.lane, self.lanes = variables, lane, lanes

    def pack(self, values: dict[Any, Value]) -> tuple[Any, ...]:
        packed = []
        for var in self.variables:
            value, shape = small(values[var]), (self.lanes,) if var in self.lane else ()
            if isinstance(value, Whole):
                packed.append(spread(value, self.lanes) if var in self.lane else value.array)
            else:
                packed += [jnp.broadcast_to(jnp.asarray(one, value.dtype), shape) for one in value.cells.reshape(-1)]
        return tuple(packed)

    def unpack(self, packed: tuple[Any, ...]) -> dict[Any, Value]:
        values: dict[Any, Value] = {}
        rest = list(packed)
        for var in self.variables:
            if var.aval.size > WHOLE or _is_key(var.aval.dtype):
                values[var] = Whole(rest.pop(0), var in self.lane)
                continue
            cells = np.empty(var.aval.size, object)
            for i in range(var.aval.size):
                cells[i] = rest.pop(0)
            values[var] = Entries(cells.reshape(var.aval.shape), var.aval.dtype)
        return values
