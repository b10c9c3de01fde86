"""Scalar replacement: a function of one lane's small arrays becomes one of many lanes' numbers.

JAX batches an array (n,) over lanes as (lanes, n), and shifts, stacks and small products then move memory. Here every entry is
an array (lanes,) of its own, as a program written by hand in C has it: shifts and transposes cost nothing, small products are
written out, structural zeros are dropped, and XLA fuses a whole time step into one loop over lanes. What has no rule runs
through `jax.vmap`, so every function works.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from jaxobs.studies import scalar_linalg
from jaxobs.studies.scalar_rules import CALLS, Entries, Rule, rule_of

WHOLE = 64  # arrays with more entries stay arrays
ACROSS = ("unvmap_all", "unvmap_any", "unvmap_max")  # equinox's answers for all lanes together, on which its errors depend


class Whole(NamedTuple):
    """A value that is kept as an array: (lanes, *shape) if batched, else the same for all lanes."""

    array: Any
    batched: bool


class Equation(NamedTuple):
    """primitive(inputs) -> outputs with the calls of the jaxpr inlined; inputs are variables or literal arrays."""

    primitive: Any
    inputs: tuple[Any, ...]
    outputs: tuple[Any, ...]
    params: dict[str, Any]


class Program(NamedTuple):
    """A flat function: variables of the inputs and outputs, constants, and equations in order."""

    inputs: tuple[Any, ...]
    outputs: tuple[Any, ...]
    constants: dict[Any, Any]
    equations: tuple[Equation, ...]


def trace(function: Callable[..., Any], *arguments: Any) -> tuple[Program, Any]:
    """The function of arrays as a flat program, traced for arguments of these shapes, and the shapes of its result."""
    closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
    return flatten(closed), shape


def flatten(closed: Any) -> Program:
    """Calls are inlined: every variable is then known in one scope, however deeply it was nested."""
    constants: dict[Any, Any] = {}
    equations: list[Equation] = []

    def resolve(atom: Any, scope: dict[Any, Any]) -> Any:
        if not isinstance(atom, core.Literal):
            return scope[atom]
        return np.asarray(atom.val, getattr(atom.aval, "dtype"))  # noqa: B009 (an abstract value need not have one)

    def inline(jaxpr: Any, consts: Sequence[Any], inputs: Sequence[Any]) -> list[Any]:
        scope = dict(zip(jaxpr.invars, inputs, strict=True))
        for variable, value in zip(jaxpr.constvars, consts, strict=True):
            fresh = Variable(variable.aval)
            constants[fresh], scope[variable] = value, fresh
        for equation in jaxpr.eqns:
            given = [resolve(atom, scope) for atom in equation.invars]
            inner = CALLS.get(equation.primitive.name)
            if inner is not None and (body := equation.params.get(inner)) is not None:
                consts = getattr(body, "consts", ())
                results = inline(getattr(body, "jaxpr", body), consts, given)
            else:
                results = [Variable(variable.aval) for variable in equation.outvars]
                equations.append(Equation(equation.primitive, tuple(given), tuple(results), equation.params))
            scope.update(zip(equation.outvars, results, strict=True))
        return [resolve(atom, scope) for atom in jaxpr.outvars]

    inputs = [Variable(variable.aval) for variable in closed.jaxpr.invars]
    outputs = inline(closed.jaxpr, closed.consts, inputs)
    return Program(tuple(inputs), tuple(outputs), constants, tuple(equations))


class Variable:
    """A name with a shape and a dtype; equal to itself only."""

    __slots__ = ("aval",)

    def __init__(self, aval: Any):
        self.aval = aval


def split(program: Program, known: set[Any]) -> tuple[list[Equation], list[Equation]]:
    """The equations that the known variables and the constants determine, and those of the rest that the outputs need."""
    first, rest = [], []
    known = known | set(program.constants)
    for equation in program.equations:
        if all(isinstance(one, np.ndarray) or one in known for one in equation.inputs):
            known |= set(equation.outputs)
            first.append(equation)
        else:
            rest.append(equation)
    needed = {one for one in program.outputs if isinstance(one, Variable)}
    kept = []
    for equation in reversed(rest):
        if needed & set(equation.outputs):
            needed |= {one for one in equation.inputs if isinstance(one, Variable)}
            kept.append(equation)
    return first, kept[::-1]


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


def apply(equation: Equation, given: list[Value], lanes: int) -> list[Value]:
    """By its rule where all inputs and outputs are small, through vmap otherwise."""
    name = equation.primitive.name
    if name == "scan" and (ended := loop(equation, [small(one) for one in given], lanes)) is not None:
        return ended
    rule: Rule | None = rule_of(name) or scalar_linalg.RULES.get(name)
    if rule is not None and all(var.aval.size <= WHOLE for var in equation.outputs):
        entries = [one for one in map(small, given) if isinstance(one, Entries)]
        with np.errstate(all="ignore"):  # constants that overflow are data
            result = rule(equation, entries, lanes) if len(entries) == len(given) else None
        if result is not None:
            return list(result)
    return [small(one) for one in through_vmap(equation, given, lanes)]


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
