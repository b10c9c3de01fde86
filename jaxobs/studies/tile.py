"""Lanes side by side: setup, one fixed-step loop over time with noise, observer and running metrics, results.

A step is traced for one lane, taken apart into numbers (`scalars`) and run over the lanes of a tile; what no state and no time
determines is computed before the loop.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._loop import Grid, Sample, results
from jaxobs._motion import Drawn, Motion
from jaxobs.noise import BLOCK
from jaxobs.studies import scalars
from jaxobs.studies.axes import Members
from jaxobs.studies.fused import fused
from jaxobs.studies.scalars import Entries, Program, Value, Whole


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
        first = _sample(motion, x0, (jnp.zeros((), jnp.int32), self.grid.ts[0], self.grid.dts[0]), drawn)
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
        return motion.step(cache, carry, _sample(motion, carry[0], time, drawn))

    def results(self, carry: Any) -> dict[str, Any]:
        """The metrics of one lane, from what it carries at the end."""
        return results(carry, self.members.metrics)


def _sample(motion: Motion, x: Any, time: tuple[Any, Any, Any], drawn: Drawn) -> Sample:
    k, t, dt = time
    return Sample(k, t, dt, motion.world.signal(t), drawn.w, drawn.valid, motion.disturb(drawn.d, x))


def run_tile(traced: Traced, indices: Any, save: int | None) -> dict[str, Any]:
    """The metrics of the lanes with these indices (axes, lanes), (lanes, ...); with `save` x and xhat (lanes, times, n)."""
    lanes = indices.shape[1]
    fixed, keys, carry = set_up(traced, indices)
    step, grid = traced.step, traced.grid
    count = len(fixed)
    states = step.inputs[count : count + len(carry)]
    times, drawn = step.inputs[count + len(carry) : -3], step.inputs[-3:]
    start = dict(zip(states, map(scalars.small, carry), strict=True))
    ahead = {old: new for old, new in zip(states, step.outputs, strict=False) if new is not old}
    noise = Noise(traced, fixed, keys, lanes)

    base = dict(zip(step.inputs, map(scalars.small, fixed), strict=False))
    base |= {old: start[old] for old in states if old not in ahead}
    base |= {var: one for var, one in zip(drawn, noise.constants, strict=True) if one is not None}
    first, rest = scalars.split(step, set(base))
    scalars.evaluate(step, first, base, lanes)
    lane = {var for var in drawn if var not in base} | {var for var, one in (start | base).items() if scalars.differs(one)}
    lane = scalars.lane_variables(rest, lane, ahead)
    pack = scalars.Pack(tuple(ahead), lane, lanes)
    seen = step.outputs[len(carry) :]

    def body(k: Any, new: list[Value], state: Any) -> Any:
        packed, saved = state
        env = base | pack.unpack(packed)
        env |= {var: Entries.of(one) for var, one in zip(times, (k, grid.ts[k], grid.dts[k]), strict=True)}
        env |= dict(zip([var for var in drawn if var not in base], new, strict=True))
        scalars.evaluate(step, rest, env, lanes)
        if save is not None:
            # A slot is written until its own sample comes: no branch in the loop.
            x, xhat = (scalars.as_whole(scalars.output(one, step, env), lanes) for one in seen)
            saved = tuple(
                jax.lax.dynamic_update_index_in_dim(path, scalars.spread(one, lanes), (k + save - 1) // save, 1)
                for path, one in zip(saved, (x, xhat), strict=True)
            )
        return pack.pack({old: scalars.output(new, step, env) for old, new in ahead.items()}), saved

    room = (
        ()
        if save is None
        else tuple(jnp.zeros((lanes, slots(traced.samples, save) + 1, *v.aval.shape), v.aval.dtype) for v in seen)
    )
    packed, saved = noise.loop(body, (pack.pack({old: start[old] for old in ahead}), room))
    end = start | pack.unpack(packed)
    arrays = [scalars.spread(scalars.as_whole(end[var], lanes), lanes) for var in states]
    final = jax.tree.unflatten(jax.tree.structure(traced.lane.carry), arrays)
    found = jax.vmap(traced.results)(final)
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
    values = [scalars.as_whole(scalars.output(one, program, env), lanes) for one in program.outputs]
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
    whole = np.asarray(scalars.as_whole(scalars.output(output, program, env), 1).array)
    if whole.size and np.any(whole != whole.flat[0]):
        return None
    return scalars.literal(whole[0])
