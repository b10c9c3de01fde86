"""One compiled shape of a study: its lanes in tiles that stay in the cache, the tiles spread over the devices."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.sharding import PartitionSpec

from jaxobs._loop import Grid
from jaxobs.studies.axes import Group, Members
from jaxobs.studies.devices import compiler_options, mesh
from jaxobs.studies.tile import Traced, run_tile

LEAST = 16  # lanes in a tile: one vector register of float32


def compile_group(group: Group, *, chunk: int, tile: int = 512) -> Callable[[int], dict[str, Any]]:
    """run(start) -> {name: (chunk, ...)}: the results of lanes start, ..., start + chunk - 1; past the end, of the last lane.

    What a lane yields does not depend on chunk, tile or devices. A second group of the same shapes is not compiled again.
    """
    over = mesh()
    count = over.size
    while tile > LEAST and tile * count >= 2 * chunk:
        tile //= 2
    tiles = -(-chunk // (tile * count)) * count

    def run(start: int) -> dict[str, Any]:
        lanes = np.minimum(np.arange(start, start + tiles * tile), group.lanes - 1)
        indices = np.zeros((len(group.shape), tiles, tile), np.int32)
        for row, index in zip(indices, np.unravel_index(lanes, group.shape) if group.shape else (), strict=True):
            row[:] = index.reshape(tiles, tile)
        found = _compiled()(group.world, group.grid, indices.swapaxes(0, 1), over, group.hold_innovation, group.save)
        return {name: array[:chunk] for name, array in found.items()}

    return run


def _spread(world: Members, grid: Grid, indices: Any, over: Any, hold_innovation: bool, save: int | None) -> dict[str, Any]:
    arrays, rest = eqx.partition((world, grid), eqx.is_array)

    def device(arrays: Any, indices: Any) -> dict[str, Any]:
        members, grid = eqx.combine(arrays, rest)
        traced = Traced(members, grid, hold_innovation)
        found = jax.lax.map(lambda index: run_tile(traced, index, save), indices)
        return {name: array.reshape(-1, *array.shape[2:]) for name, array in found.items()}

    lanes = PartitionSpec("lanes")
    return jax.shard_map(device, mesh=over, in_specs=(PartitionSpec(), lanes), out_specs=lanes, check_vma=False)(
        arrays, indices
    )


@functools.cache
def _compiled() -> Any:
    options: dict[str, Any] = {"compiler_options": compiler_options()}
    return eqx.filter_jit(_spread, **options)
