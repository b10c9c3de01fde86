"""A program of small arrays as one of numbers: what is known is computed now, named parameters become tables."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import scalars
from jaxobs.scalars import Entries, Equation, Program, Value, Variable, Whole


class Unsupported(ValueError):
    """An operation that cannot be written as straight-line code; `primitive` names it."""

    def __init__(self, primitive: str, why: str, fix: str):
        super().__init__(f"export: given an observer that uses {primitive!r}; expected {why}. {fix}")
        self.primitive = primitive


class Unrolled(NamedTuple):
    """A program of numbers; the entries that each input name stands for, in order; the tables; the results, cell by cell.

    A result is a variable of the program or a NumPy scalar.
    """

    program: Program
    cells: dict[str, tuple[Variable, ...]]
    tables: dict[str, np.ndarray]
    results: tuple[Any, ...]


def unrolled(program: Program, known: Mapping[Variable, np.ndarray], inputs: Mapping[str, Variable]) -> Unrolled:
    """`program` for the inputs known now and those to be given; equations `name` of known values make tables."""
    here: dict[Variable, Value] = {one: scalars.literal(np.asarray(value)) for one, value in known.items()}
    tables, kept = _tables(program, here)
    program = program._replace(equations=tuple(one for one in program.equations if one.outputs[0] not in kept))
    first, rest = scalars.split(program, set(here))
    env = _now(program, first, here)
    arrays = {name: (variable.aval, [variable]) for name, variable in inputs.items()}
    for variable, name in kept.items():
        arrays.setdefault(name, (variable.aval, []))[1].append(variable)
    places, numbers = {}, []
    for name, (aval, _) in arrays.items():
        places[name] = range(len(numbers), len(numbers) + aval.size)
        numbers += [jax.ShapeDtypeStruct((), aval.dtype)] * aval.size
    constants: dict[int, Any] = {}

    def run(*given: Any) -> list[Any]:
        there = dict(env)
        for name, (aval, variables) in arrays.items():
            cells = np.empty(aval.size, object)
            for i, place in enumerate(places[name]):
                cells[i] = given[place]
            there |= dict.fromkeys(variables, Entries(cells.reshape(aval.shape), aval.dtype))
        for equation in rest:
            there |= zip(equation.outputs, _by_rule(equation, program, there), strict=True)
        ends = [_entries(scalars.value_of(one, program, there)) for one in program.outputs]
        cells = [(one, end.dtype) for end in ends for one in end.cells.reshape(-1)]
        constants.update({i: np.asarray(one, dtype)[()] for i, (one, dtype) in enumerate(cells) if scalars.is_constant(one)})
        return [jnp.asarray(one, dtype) for one, dtype in cells]

    flat = scalars.flatten(jax.make_jaxpr(run)(*numbers))
    results = tuple(constants.get(i, one if isinstance(one, Variable) else one[()]) for i, one in enumerate(flat.outputs))
    return Unrolled(flat, {name: tuple(flat.inputs[i] for i in at) for name, at in places.items()}, tables, results)


def _tables(program: Program, here: dict[Variable, Value]) -> tuple[dict[str, np.ndarray], dict[Variable, str]]:
    """The values that `name` equations give to what is known, and the table that the output of each is."""
    first, _ = scalars.split(program, set(here))
    env = _now(program, first, here)
    tables: dict[str, np.ndarray] = {}
    kept = {}
    for equation in first:
        if equation.primitive.name != "name":
            continue
        whole = scalars.as_whole(env[equation.outputs[0]], 0)
        value, base = np.asarray(whole.array), str(equation.params["name"])
        names = [base, *(f"{base}{i}" for i in range(2, len(tables) + 3))]
        name = next(one for one in names if one not in tables or np.array_equal(tables[one], value))
        tables[name], kept[equation.outputs[0]] = value, name
    return tables, kept


def _now(program: Program, equations: list[Equation], here: Mapping[Variable, Value]) -> dict[Variable, Value]:
    """All that needs nothing but `here`."""
    env = dict(here)
    scalars.evaluate(program, equations, env, 0, rules=False)
    return {one: scalars.literal(np.asarray(scalars.as_whole(value, 0).array)) for one, value in env.items()}


def _by_rule(equation: Equation, program: Program, env: dict[Variable, Value]) -> list[Entries]:
    given = [scalars.value_of(one, program, env) for one in equation.inputs]
    found = scalars.by_rule(equation, given, 0)
    if found is None:
        raise refused(equation)
    return [_entries(one) for one in found]


def refused(equation: Equation) -> Unsupported:
    """What to say of an equation without a rule."""
    name = equation.primitive.name
    if any(one.aval.size > scalars.WHOLE for one in equation.outputs):
        fix = "Export StableHLO instead, which has no limit."
        return Unsupported(name, f"arrays of at most {scalars.WHOLE} numbers at {name}", fix)
    fix = "Write the model without it (an index that is not known, a solver, a loop that ends by itself), or export StableHLO."
    return Unsupported(name, "operations on numbers with a fixed order", fix)


def _entries(value: Value) -> Entries:
    found = scalars.small(value)
    if isinstance(found, Whole):
        fix = "Export StableHLO instead, which has no limit."
        raise Unsupported("array", f"arrays of at most {scalars.WHOLE} numbers", fix)
    return found
