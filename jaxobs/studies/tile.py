"""Lanes side by side: setup, one fixed-step loop over time with noise, observer and running metrics, results.

A step is traced for one lane, taken apart into numbers (`scalars`) and run over the lanes of a tile; what no state and no time
determines is computed before the loop.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import scalars
from jaxobs._loop import Grid, results
from jaxobs._motion import Drawn, Motion
from jaxobs.noise import BLOCK
from jaxobs.scalars import Entries, Equation, Program, Value, Variable, Whole
from jaxobs.studies.axes import Members
from jaxobs.studies.fused import fused


class Lane(NamedTuple):
    """What a lane keeps, as arrays: the numbers of all parts and the integrator's cache, the keys of its streams, its state."""

    fixed: Any
    keys: Any
    carry: Any


class Traced:
    """The programs for one lane: setup (members, index) -> Lane; draw (fixed, keys, times, block) -> Drawn; one step."""

    def __init__(self, members: Members, grid: Grid, hold_innovation: bool):
        self.members, self.grid, self.hold_innovation = members, grid, hold_innovation
        self.arrays, self.rest = eqx.partition(members, eqx.is_array)
        index = tuple(jnp.zeros((), jnp.int32) for _ in members.shape)
        self.setup, self.lane = scalars.trace(self._setup, self.arrays, index)
        self.samples = grid.ts.shape[0]
        self.block = min(BLOCK, self.samples) if self.memoryless else self.samples
        ts = jax.ShapeDtypeStruct((self.block,), grid.ts.dtype)
        k, t = jax.ShapeDtypeStruct((), jnp.int32), jax.ShapeDtypeStruct((), ts.dtype)
        self.draw, drawn = scalars.trace(self._draw, self.lane.fixed, self.lane.keys, ts, k)
        self.at = at = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), drawn)
        self.step, _ = scalars.trace(self._step, self.lane.fixed, self.lane.carry, (k, t, t), at)

    def _setup(self, arrays: Any, index: Any) -> Lane:
        world, observer, x0, xhat0, key = eqx.combine(arrays, self.rest).at(index)
        self.memoryless = all(one is None or one.memoryless for one in (world.noise, world.disturbance))
        motion = Motion(world, observer, self.hold_innovation, self.members.metrics)
        keys = motion.streams(key)
        shapes = jax.eval_shape(lambda keys: motion.draw(keys, self.grid.ts[:1]), keys)
        drawn = jax.tree.map(lambda a: jnp.zeros(a.shape[1:], a.dtype), shapes)
        first = motion.sample(x0, (jnp.zeros((), jnp.int32), self.grid.ts[0], self.grid.dts[0]), drawn)
        carry, cache = motion.start(x0, xhat0, first, self.grid.spacing)
        fixed, self.parts = eqx.partition((world, observer, cache), eqx.is_array)
        self.implementations = [jax.random.key_impl(key) for key in keys]
        return Lane(fixed, [jax.random.key_data(key) for key in keys], carry)

    def _motion(self, fixed: Any) -> tuple[Motion, Any]:
        world, observer, cache = eqx.combine(fixed, self.parts)
        return Motion(world, observer, self.hold_innovation, self.members.metrics), cache

    def _draw(self, fixed: Any, keys: Any, ts: Any, block: Any) -> Drawn:
        typed = [jax.random.wrap_key_data(key, impl=impl) for key, impl in zip(keys, self.implementations, strict=True)]
        # The block is the whole path if any source has a memory: the others then draw theirs as `simulate` does.
        return self._motion(fixed)[0].draw((typed[0], typed[1]), ts, block if self.memoryless else None)

    def _step(self, fixed: Any, carry: Any, time: Any, drawn: Drawn) -> tuple[Any, Any]:
        motion, cache = self._motion(fixed)
        return motion.step(cache, carry, motion.sample(carry[0], time, drawn))

    def results(self, carry: Any) -> dict[str, Any]:
        """The metrics of one lane, from what it carries at the end."""
        return results(carry, self.members.metrics)


class Tile:
    """A step's program, of these inputs and outputs, over the lanes with these indices (axes, lanes).

    `base` has what is known before the loop; `start` and `ahead` the state, its variables at a sample and their values at the
    next one.
    """

    def __init__(self, traced: Traced, inputs: tuple[Variable, ...], outputs: tuple[Any, ...], indices: Any):
        self.traced, self.lanes = traced, indices.shape[1]
        fixed, keys, carry = set_up(traced, indices)
        states, given = inputs[len(fixed) : len(fixed) + len(carry)], inputs[len(fixed) + len(carry) :]
        self.times, drawn = given[:-3], given[-3:]
        self.start = dict(zip(states, map(scalars.small, carry), strict=True))
        self.ahead = {old: new for old, new in zip(states, outputs, strict=False) if new is not old}
        self.noise = Noise(traced, fixed, keys, self.lanes)
        self.base: dict[Any, Value] = dict(zip(inputs, map(scalars.small, fixed), strict=False))
        self.base |= {old: self.start[old] for old in states if old not in self.ahead}
        self.base |= {var: one for var, one in zip(drawn, self.noise.constants, strict=True) if one is not None}
        self.drawn = [var for var in drawn if var not in self.base]

    def pack(self, equations: Sequence[Equation]) -> scalars.Pack:
        """How the state is carried, if these equations move it."""
        lane = {*self.drawn, *(var for var, one in (self.start | self.base).items() if scalars.differs(one))}
        return scalars.Pack(tuple(self.ahead), scalars.lane_variables(equations, lane, self.ahead), self.lanes)

    def at(self, k: Any, new: list[Value]) -> dict[Any, Value]:
        """What is given at sample k: its times, and what was drawn for it."""
        grid = self.traced.grid
        times = zip(self.times, (k, grid.ts[k], grid.dts[k]), strict=True)
        return {var: Entries.of(one) for var, one in times} | dict(zip(self.drawn, new, strict=True))

    def carry(self, ahead: dict[Any, Value]) -> Any:
        """What `Motion` carries, with these values of what moves, (lanes, ...) each."""
        end = self.start | ahead
        arrays = [scalars.spread(scalars.as_whole(end[var], self.lanes), self.lanes) for var in self.start]
        return jax.tree.unflatten(jax.tree.structure(self.traced.lane.carry), arrays)


def run_tile(traced: Traced, indices: Any, save: int | None) -> dict[str, Any]:
    """The metrics of the lanes with these indices (axes, lanes), (lanes, ...); with `save` x and xhat (lanes, times, n)."""
    step, lanes = traced.step, indices.shape[1]
    tile = Tile(traced, step.inputs, step.outputs, indices)
    first, rest = scalars.split(step, set(tile.base))
    scalars.evaluate(step, first, tile.base, lanes)
    pack = tile.pack(rest)
    seen = () if save is None else step.outputs[len(tile.start) :]

    def body(k: Any, new: list[Value], state: Any) -> Any:
        packed, saved = state
        env = tile.base | pack.unpack(packed) | tile.at(k, new)
        scalars.evaluate(step, rest, env, lanes)
        if save is not None:
            # A slot is written until its own sample comes: no branch in the loop.
            both = [scalars.spread(scalars.as_whole(scalars.value_of(one, step, env), lanes), lanes) for one in seen]
            slot = (k + save - 1) // save
            saved = [jax.lax.dynamic_update_index_in_dim(path, one, slot, 1) for path, one in zip(saved, both, strict=True)]
        return pack.pack({old: scalars.value_of(new, step, env) for old, new in tile.ahead.items()}), saved

    room = [jnp.zeros((lanes, slots(traced.samples, save or 1) + 1, *v.aval.shape), v.aval.dtype) for v in seen]
    packed, saved = tile.noise.loop(body, (pack.pack({old: tile.start[old] for old in tile.ahead}), room))
    found = jax.vmap(traced.results)(tile.carry(pack.unpack(packed)))
    return flat_names(found) | dict(zip(("x", "xhat"), (path[:, :-1] for path in saved), strict=False))


def slots(samples: int, save: int) -> int:
    """How many samples are kept: 0, save, 2 save, ..."""
    return -(-samples // save)


def flat_names(results: dict[str, Any]) -> dict[str, Any]:
    """{"rmse": array, "whiteness.p_value": array}: nested results under dotted names."""
    leaves = jax.tree_util.tree_flatten_with_path(results)[0]
    return {
        ".".join(str(getattr(k, "key", getattr(k, "name", getattr(k, "idx", k)))) for k in path): leaf for path, leaf in leaves
    }


def set_up(traced: Traced, indices: Any) -> tuple[list[Whole], list[Whole], list[Whole]]:
    program, lanes = traced.setup, indices.shape[1]
    given: list[Value] = [Whole(a, False) for a in jax.tree.leaves(traced.arrays)]
    given += [Whole(index, True) for index in indices]
    env: dict[Any, Value] = dict(zip(program.inputs, given, strict=True))
    # By entries here too: how XLA sums the products of matrices depends on the number of devices.
    scalars.evaluate(program, program.equations, env, lanes)
    values = [scalars.as_whole(scalars.value_of(one, program, env), lanes) for one in program.outputs]
    ends = np.cumsum([len(jax.tree.leaves(part)) for part in traced.lane])
    return values[: ends[0]], values[ends[0] : ends[1]], values[ends[1] :]


class Noise:
    """Random paths, block by block; what is the same at all times and in all lanes (valid, no noise) is a constant."""

    def __init__(self, traced: Traced, fixed: list[Whole], keys: list[Whole], lanes: int):
        self.traced, self.given, self.lanes = traced, [*fixed, *keys], lanes
        program = traced.draw
        first, _ = scalars.split(program, set())
        env: dict[Any, Value] = {}
        with jax.ensure_compile_time_eval():
            scalars.evaluate(program, first, env, lanes, rules=False)
            self.constants = [_constant(one, program, env) for one in program.outputs]

    def loop(self, body: Callable[[Any, list[Value], Any], Any], state: Any) -> Any:
        """state = body(k, what is drawn for sample k, state) for all samples."""
        traced = self.traced
        alive = traced.grid.ts[0] <= traced.grid.ts[-1]
        if all(one is not None for one in self.constants):

            def whole(state: Any) -> Any:
                return jax.lax.fori_loop(0, traced.samples, lambda k, state: body(k, [], state), state)

            return fused(whole, alive, state)
        count = -(-traced.samples // traced.block)
        ts = traced.grid.ts
        ts = jnp.concatenate([ts, jnp.broadcast_to(ts[-1:], (count * traced.block - ts.shape[0],))]).reshape(count, -1)

        def block(i: Any, state: Any) -> Any:
            def advance(start: Any, end: Any, paths: Any, state: Any) -> Any:
                def one(k: Any, state: Any) -> Any:
                    drawn: list[Value] = [scalars.small(Whole(jnp.moveaxis(path[k - start], -1, 0), True)) for path in paths]
                    return body(k, drawn, state)

                return jax.lax.while_loop(lambda c: c[0] < end, lambda c: (c[0] + 1, one(*c)), (start, state))[1]

            start = i * traced.block
            end = jnp.minimum(start + traced.block, traced.samples)
            return fused(advance, alive, start, end, self._draw(ts[i], i), state)

        return jax.lax.fori_loop(0, count, block, state)

    def _draw(self, ts: Any, block: Any) -> list[Any]:
        """(block, p, lanes) of each stream that is not constant."""
        structure = jax.tree.structure((self.traced.lane.fixed, self.traced.lane.keys))

        def lane(*arrays: Any) -> list[Any]:
            fixed, keys = jax.tree.unflatten(structure, arrays)
            drawn = self.traced._draw(fixed, keys, ts, block)
            return [path for path, constant in zip(drawn, self.constants, strict=True) if constant is None]

        axes = tuple(0 if one.batched else None for one in self.given)
        return jax.vmap(lane, in_axes=axes, out_axes=-1, axis_size=self.lanes)(*(one.array for one in self.given))


def _constant(output: Any, program: Program, env: dict[Any, Value]) -> Value | None:
    """The value at one time of a stream (block, p), if all its entries are one constant."""
    if not (isinstance(output, np.ndarray) or output in env or output in program.constants):
        return None
    whole = np.asarray(scalars.as_whole(scalars.value_of(output, program, env), 1).array)
    if whole.size and np.any(whole != whole.flat[0]):
        return None
    return scalars.literal(whole[0])
