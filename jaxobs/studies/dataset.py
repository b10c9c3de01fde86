"""The data set of a study: named axes, units, and where the numbers come from."""

import datetime
import json
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
import xarray as xr

from jaxobs._version import __version__
from jaxobs.studies.axes import Axis, Group
from jaxobs.studies.config import FORMAT, fingerprint
from jaxobs.studies.plan import Chunk, Plan

COUNTED = 2**22  # longer axes of seeds have no coordinate: it would be the numbers 0, 1, ...
FIRST = {"lag": 1}  # where an axis that only counts does not start at 0


def frame(plan: Plan, config: Mapping[str, Any]) -> xr.Dataset:
    """Coordinates and attributes, no variables yet.

    An axis of numbers has them as its coordinate. One of vectors (alphas, x0) counts them, beside a coordinate
    "alphas_value" with the vectors themselves; where they differ from group to group, it has the axes of the groups too.
    """
    coords: dict[str, Any] = {name: ((name,), list(values), {}) for name, values in plan.shape_axes.items()}
    for i, axis in enumerate(plan.groups[0].axes):
        if axis.values is not None and axis.values.ndim == 1:
            coords[axis.name] = ((axis.name,), axis.values, {"of": axis.part})
        elif axis.values is not None or axis.size <= COUNTED:
            coords[axis.name] = ((axis.name,), np.arange(axis.size), {"of": axis.part})
        if axis.values is not None and axis.values.ndim > 1:
            coords[f"{axis.name}_value"] = _vectors(plan, [group.axes[i] for group in plan.groups])
    for variable in plan.variables.values():
        for dim, size in zip(variable.dims, variable.shape, strict=True):
            if dim == "time":
                coords[dim] = ((dim,), plan.groups[0].ts[:: plan.groups[0].save], {"units": "s"})
            elif dim not in coords and dim not in plan.sizes:
                coords[dim] = ((dim,), np.arange(size) + FIRST.get(dim, 0), {})
    return xr.Dataset(coords=coords, attrs=_attributes(plan.groups[0], config))


def _attributes(group: Group, config: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "title": "Study of state observers",
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "format": FORMAT,
        "jaxobs": __version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        "precision": str(group.dtype),
        "backend": jax.default_backend(),
        "device": jax.devices()[0].device_kind,
        "devices": jax.device_count(),
        "fingerprint": fingerprint(config),
        "config": json.dumps(config, sort_keys=True),
    }


def _vectors(plan: Plan, axes: list[Axis]) -> tuple[tuple[str, ...], np.ndarray, dict[str, Any]]:
    """The values along an axis of vectors; shorter ones are filled up with NaN."""
    values = [axis.values for axis in axes if axis.values is not None]
    first, name = values[0], axes[0].name
    own = ("state",) if axes[0].part in ("x0", "xhat0") else tuple(f"{name}_{i}" for i in range(first.ndim - 1))
    attrs = {"of": axes[0].part}
    if all(np.array_equal(first, other) for other in values):
        return (name, *own), first, attrs
    shape = tuple(max(sizes) for sizes in zip(*(v.shape for v in values), strict=True))
    padded = np.stack([_fill(v, shape) for v in values])
    points = tuple(len(given) for given in plan.shape_axes.values())
    return (*plan.shape_axes, name, *own), padded.reshape(points + shape), attrs


def block(plan: Plan, chunk: Chunk, results: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The lanes of a chunk, (count, ...) each, as the rectangle they fill; NaN where a group has fewer states than others."""
    lead = tuple(place.stop - place.start for place in chunk.region.values())
    blocks = {}
    for name, variable in plan.variables.items():
        shape = lead + variable.shape[len(lead) :]
        if name not in results:  # another group's metric
            blocks[name] = np.full(shape, np.nan, variable.dtype)
            continue
        array = np.asarray(results[name], variable.dtype)
        blocks[name] = _fill(array.reshape(lead + array.shape[1:]), shape)
    return blocks


def _fill(array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The array in the first corner of a larger one of NaN."""
    if array.shape == shape:
        return array
    full = np.full(shape, np.nan, array.dtype)
    full[tuple(slice(size) for size in array.shape)] = array
    return full


class Memory:
    """Where a study without a store collects its blocks. It does what a store does, and lasts as long as the call."""

    def __init__(self, frame: xr.Dataset, plan: Plan):
        self.frame, self.variables, self.chunks, self.finished = frame, plan.variables, len(plan), set()
        self.arrays = {name: np.full(v.shape, np.nan, v.dtype) for name, v in plan.variables.items()}

    def write(self, index: int, region: Mapping[str, slice], blocks: Mapping[str, np.ndarray]) -> None:
        for name, values in blocks.items():
            self.arrays[name][tuple(region.values())] = values
        self.finished.add(index)

    def done(self, chunks: Any = None) -> set[int]:
        return self.finished

    def dataset(self) -> xr.Dataset:
        parts = {name: (v.dims, self.arrays[name], dict(v.attrs)) for name, v in self.variables.items()}
        return self.frame.assign(parts).assign_attrs(complete=len(self.finished) == self.chunks)
