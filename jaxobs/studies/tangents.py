"""Forward mode: derivatives in a few directions move with each lane, in the same loop."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxobs import scalars
from jaxobs.scalars import Equation, Pack, Program, Value, Variable, is_constant
from jaxobs.studies.sensitive import Sensitive, pick
from jaxobs.studies.tile import Tile

Of = Callable[[dict[str, Any]], Any]


class Tangents:
    """One step of a lane with its derivative in one direction, as a program.

        c+ = step(f, c),    dc+ = (D_c step) dc + (D_f step) df

    for what is fixed, f, and what is carried, c; only what the parameters reach has a derivative. The step is linearised once
    for all directions.
    """

    def __init__(self, sensitive: Sensitive):
        self.sensitive, traced = sensitive, sensitive.traced
        step = traced.step
        shapes = [jax.ShapeDtypeStruct(var.aval.shape, var.aval.dtype) for var in step.inputs]
        fixed, carry = traced.lane.fixed, traced.lane.carry
        k, t, dt = shapes[-6:-3]
        given = (fixed, carry, (k, t, dt), traced.at)
        self.program, _ = scalars.trace(self._step, given, sensitive.shapes("fixed"), sensitive.shapes("carry"))
        tangents = len(sensitive.fixed) + len(sensitive.carry)
        self.inputs, moving = self.program.inputs[:-tangents], self.program.inputs[-tangents:]
        self.fixed, self.carry = moving[: len(sensitive.fixed)], moving[len(sensitive.fixed) :]
        self.outputs = self.program.outputs[: -len(sensitive.carry)]
        self.ahead = dict(zip(self.carry, self.program.outputs[-len(sensitive.carry) :], strict=True))

    def _step(self, given: Any, fixed: list[Any], carry: list[Any]) -> tuple[Any, Any]:
        start = pick(given[0], self.sensitive.fixed), pick(given[1], self.sensitive.carry)
        _, push, (after, _) = jax.linearize(self.sensitive.step(*given), *start, has_aux=True)
        return after, push(fixed, carry)


def run_tangents(tangents: Tangents, indices: Any, of: Of) -> dict[str, Any]:
    """value (lanes,), gradient (lanes, P) and diverged_at (lanes,) of the lanes with these indices (axes, lanes)."""
    sensitive, lanes = tangents.sensitive, indices.shape[1]
    program = tangents.program
    tile = Tile(sensitive.traced, tangents.inputs, tangents.outputs, indices)
    some_fixed, some_carry = _start(sensitive, indices)
    first, rest = scalars.split(program, set(tile.base) | set(tangents.fixed))
    linear = scalars.lane_variables(program.equations, {*tangents.fixed, *tangents.carry}, {})
    primal_first, linear_first = _apart(first, linear)
    primal, linear_rest = _apart(rest, linear)
    scalars.evaluate(program, primal_first, tile.base, lanes)
    moved = _Pushed(program, tangents.fixed, linear_first, linear_rest, tile.base, some_fixed, lanes)
    pack = tile.pack(primal)
    dots = Pack(tangents.carry, set(tangents.carry), lanes)

    def body(k: Any, new: list[Value], state: Any) -> Any:
        packed, moving = state
        env = tile.base | pack.unpack(packed) | tile.at(k, new)
        scalars.evaluate(program, primal, env, lanes)

        def push(moving: Any, known: Any) -> Any:
            there = env | moved.known(known) | dots.unpack(moving)
            scalars.evaluate(program, linear_rest, there, lanes)
            return dots.pack({old: scalars.value_of(one, program, there) for old, one in tangents.ahead.items()})

        after = pack.pack({old: scalars.value_of(one, program, env) for old, one in tile.ahead.items()})
        return after, jax.vmap(push)(moving, moved.cells)

    begin = pack.pack({old: tile.start[old] for old in tile.ahead})
    moving = jax.vmap(lambda some: dots.pack(dict(zip(tangents.carry, map(_cells, some), strict=True))))(some_carry)
    packed, moving = tile.noise.loop(body, (begin, moving))
    ends = jax.vmap(lambda one: [scalars.spread(scalars.as_whole(v, lanes), lanes) for v in dots.unpack(one).values()])(moving)

    def finish(carry: Any, ends: Any) -> dict[str, Any]:
        value, push = jax.linearize(sensitive.end(carry, of), pick(carry, sensitive.carry))
        return {"value": value, "gradient": jax.vmap(push)(ends), "diverged_at": carry[-1]}

    return jax.vmap(finish, in_axes=(0, 1))(tile.carry(pack.unpack(packed)), ends)


class _Pushed:
    """What the derivatives of the fixed numbers alone determine, before the loop: cells (P, lanes)."""

    def __init__(self, program: Program, variables: Any, first: Any, rest: Any, base: Any, start: Any, lanes: int):
        needed = {one for equation in rest for one in equation.inputs if isinstance(one, Variable)}
        self.cells: Any = None
        self.values: dict[Any, Value] = {}

        def push(start: Any) -> Any:
            env = base | dict(zip(variables, map(_cells, start), strict=True))
            inside = set(variables) | {out for equation in first for out in equation.outputs}
            scalars.evaluate(program, first, env, lanes)
            self.values = {var: env[var] for var in needed & inside}
            return [_arrays(value, lanes) for value in self.values.values()]

        self.cells = jax.vmap(push)(start)

    def known(self, cells: Any) -> dict[Any, Value]:
        """The values from their cells."""
        return {var: _filled(value, some) for (var, value), some in zip(self.values.items(), cells, strict=True)}


def _start(sensitive: Sensitive, indices: Any) -> tuple[list[Any], list[Any]]:
    """The derivatives of fixed and carry before the first step, (P, lanes, ...) each."""
    arrays = sensitive.traced.arrays

    def lane(index: Any) -> Any:
        _, push = jax.linearize(sensitive.setup(arrays, tuple(index)), sensitive.values(arrays))
        return jax.vmap(push)([jnp.asarray(one) for one in sensitive.directions])

    return jax.vmap(lane, in_axes=1, out_axes=1)(indices)


def _apart(equations: Sequence[Equation], linear: set[Any]) -> tuple[list[Equation], list[Equation]]:
    is_linear = [any(out in linear for out in equation.outputs) for equation in equations]
    return [e for e, yes in zip(equations, is_linear, strict=True) if not yes], [
        e for e, yes in zip(equations, is_linear, strict=True) if yes
    ]


def _cells(array: Any) -> Value:
    return scalars.small(scalars.Whole(array, True))


def _arrays(value: Value, lanes: int) -> list[Any]:
    """What of a value is no constant, spread over the lanes."""
    if isinstance(value, scalars.Whole):
        return [scalars.spread(value, lanes)]
    return [jnp.broadcast_to(one, (lanes,)) for one in value.cells.reshape(-1) if not is_constant(one)]


def _filled(value: Value, arrays: list[Any]) -> Value:
    if isinstance(value, scalars.Whole):
        return scalars.Whole(arrays[0], True)
    rest, cells = list(arrays), value.cells.copy().reshape(-1)
    for i, one in enumerate(cells):
        cells[i] = one if is_constant(one) else rest.pop(0)
    return scalars.Entries(cells.reshape(value.cells.shape), value.dtype)
