"""What a study computes for each lane: the names, axes, sizes and units of its variables."""

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._loop import results
from jaxobs._module import refuse
from jaxobs._motion import Motion
from jaxobs.metrics import AbstractMetric
from jaxobs.noise import BLOCK
from jaxobs.studies.axes import Group
from jaxobs.studies.config import spelled
from jaxobs.studies.tile import flat_names, slots


@dataclasses.dataclass(frozen=True)
class Variable:
    """One variable of the data set: first the axes of the lanes, then those of the metric. NaN is what is not computed."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype
    attrs: Mapping[str, Any]


class Lane(NamedTuple):
    """What one lane yields, and the bytes it takes: as one of a piece, and the more while it is being advanced."""

    outputs: dict[str, jax.ShapeDtypeStruct]
    each: int
    more: int

    @property
    def kept(self) -> int:
        return _bytes(self.outputs)


def lane_of(group: Group) -> Lane:
    """Found from shapes alone; nothing is computed. The bytes are rather too many than too few."""
    arrays, rest = eqx.partition((group.world, group.grid), eqx.is_array)
    leaves, structure = jax.tree.flatten(rest)
    carry, fixed, drawn, found = _lane.eval_shape(arrays, tuple(leaves), structure, group.hold_innovation)
    outputs = flat_names(found)
    if group.save is not None:
        path = jax.ShapeDtypeStruct((slots(len(group.ts), group.save), group.n), group.dtype)
        outputs |= {"x": path, "xhat": path}
    sources = [family.observer for family in (group.world.noise, group.world.disturbance) if family is not None]
    samples = min(BLOCK, len(group.ts)) if all(source.memoryless for source in sources) else len(group.ts)
    each = 3 * _bytes(outputs) + 16 + 16 * len(group.shape)  # on the device, on the host, in the data set; lane numbers
    return Lane(outputs, each, 2 * _bytes(outputs) + 3 * _bytes(carry) + _bytes(fixed) + 3 * samples * _bytes(drawn))


@functools.partial(jax.jit, static_argnums=(1, 2, 3))  # never run: it remembers the shapes of what it has traced
def _lane(arrays: Any, leaves: tuple[Any, ...], structure: Any, hold_innovation: bool) -> tuple[Any, ...]:
    """State, what does not change, one sample of noise and disturbance, results."""
    world, grid = eqx.combine(arrays, jax.tree.unflatten(structure, leaves))
    around, observer, x0, xhat0, key = world.at(tuple(jnp.zeros((), jnp.int32) for _ in world.shape))
    motion = Motion(around, observer, hold_innovation, world.metrics)
    drawn = jax.tree.map(lambda path: path[0], motion.draw(motion.streams(key), grid.ts[:1]))
    first = motion.sample(x0, (jnp.zeros((), jnp.int32), grid.ts[0], grid.dts[0]), drawn)
    carry, cache = motion.start(x0, xhat0, first, grid.spacing)
    fixed = eqx.filter((cache, motion.world, motion.observer), eqx.is_array)
    return carry, fixed, drawn, results(carry, world.metrics)


def _bytes(tree: Any) -> int:
    return sum(math.prod(leaf.shape) * leaf.dtype.itemsize for leaf in jax.tree.leaves(tree) if hasattr(leaf, "shape"))


def variables(groups: tuple[Group, ...], lanes: tuple[Lane, ...], lane_dims: Mapping[str, int]) -> dict[str, Variable]:
    """Every variable over all groups. An axis that is shorter in some of them (the states) has the size of the longest."""
    found: dict[str, tuple[tuple[str, ...], np.dtype, dict[str, Any]]] = {}
    sizes: dict[str, int] = {}
    for group, lane in zip(groups, lanes, strict=True):
        for name, out in lane.outputs.items():
            dims, attrs = _described(group.metrics, name, out)
            for dim, size in zip(dims, out.shape, strict=True):
                sizes[dim] = max(sizes.get(dim, 0), size)
            dtype = np.dtype(out.dtype) if jnp.issubdtype(out.dtype, jnp.floating) else np.dtype(np.float64)
            found[name] = (dims, dtype, attrs)
    lead, shape = tuple(lane_dims), tuple(lane_dims.values())
    return {
        name: Variable(lead + dims, shape + tuple(sizes[dim] for dim in dims), dtype, attrs)
        for name, (dims, dtype, attrs) in found.items()
    }


def _described(metrics: Mapping[str, AbstractMetric], name: str, out: jax.ShapeDtypeStruct) -> tuple[tuple[str, ...], dict]:
    """Axes and attributes of one variable; a metric that does not name its axes gets numbered ones."""
    if name in ("x", "xhat"):
        whose = "true state" if name == "x" else "estimate"
        return ("time", "state"), {"units": "x", "long_name": whose}
    if name == "diverged_at":
        return (), {"units": "s", "long_name": "first time at which x or xhat is not finite, inf if they always are"}
    whole, _, part = name.partition(".")
    metric = metrics[whole]
    dims, units = (value.get(part) if isinstance(value, Mapping) else value for value in (metric.dims, metric.units))
    if dims is None:
        dims = tuple(f"{name}_{i}" for i in range(len(out.shape)))
    if len(dims) != len(out.shape):
        fix = "It names the axes of the result, one each."
        raise refuse(metric, "dims", str(dims), f"{len(out.shape)} names for {name}", fix)
    return tuple(dims), {"units": units or "unknown", "metric": spelled(metric)}
