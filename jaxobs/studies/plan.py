"""How the lanes of a study are cut into chunks: the units of storing, resuming and sharing."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.studies.axes import Group
from jaxobs.studies.outputs import Lane, Variable, lane_of, variables

# A chunk has at most so much of each; they depend on the study alone, so that every machine cuts it in the same way.
LANE_STEPS = 2**29  # seconds, on a few cores
LANES = 2**15  # at least, where there are so many and their results fit: less would leave large devices idle
BYTES = 2**28  # of results


@dataclasses.dataclass(frozen=True)
class Chunk:
    """Lanes start, ..., start + count - 1 of a group, which fill one rectangle of the data set."""

    index: int
    group: int
    start: int
    count: int
    region: Mapping[str, slice]  # axis -> its part; the metrics' axes are whole


@dataclasses.dataclass(frozen=True)
class Plan:
    """Groups by chunks. `block` has the size of a chunk along each axis but the metrics'; those at the ends are shorter.

    In a chunk the leading axes have one value, one axis a run of values, the trailing ones all: a rectangle whose lanes follow
    one another.
    """

    groups: tuple[Group, ...]
    lanes: tuple[Lane, ...]  # one for each group
    shape_axes: Mapping[str, list[Any]]
    variables: Mapping[str, Variable]
    block: Mapping[str, int]

    @property
    def sizes(self) -> dict[str, int]:
        """Of all axes but the metrics'."""
        return _sizes(self.groups, self.shape_axes)

    @property
    def cuts(self) -> tuple[int, ...]:
        """The number of chunks along each axis of the lanes."""
        return tuple(-(-axis.size // self.block[axis.name]) for axis in self.groups[0].axes)

    def __len__(self) -> int:
        return len(self.groups) * math.prod(self.cuts)

    def __getitem__(self, index: int) -> Chunk:
        if not 0 <= index < len(self):
            raise IndexError(f"chunk {index} of {len(self)}")
        which, within = divmod(index, math.prod(self.cuts))
        place = np.unravel_index(within, self.cuts) if self.cuts else ()
        points = np.unravel_index(which, tuple(len(values) for values in self.shape_axes.values())) if self.shape_axes else ()
        region = {name: slice(int(i), int(i) + 1) for name, i in zip(self.shape_axes, points, strict=True)}
        start, count, axes = 0, 1, self.groups[which].axes
        for axis, i in zip(axes, place, strict=True):
            low = int(i) * self.block[axis.name]
            high = min(low + self.block[axis.name], axis.size)
            start, count = start * axis.size + low, count * (high - low)
            region[axis.name] = slice(low, high)
        return Chunk(index, which, start, count, region)

    def cut_as(self, block: Mapping[str, int]) -> "Plan":
        """The same study in other chunks, those that a store has."""
        return dataclasses.replace(self, block=dict(block))


def make_plan(groups: tuple[Group, ...], shape_axes: Mapping[str, list[Any]], chunk: int | None) -> Plan:
    """Chunks of at most `chunk` lanes, or of the size that the constants of this module give."""
    sizes, each = _sizes(groups, shape_axes), tuple(lane_of(group) for group in groups)
    kept = max(lane.kept for lane in each)
    most = chunk or max(1, min(max(LANES, LANE_STEPS // len(groups[0].ts)), BYTES // kept))
    lanes = block_of(groups[0].shape, most)
    names = [axis.name for axis in groups[0].axes]
    block = dict.fromkeys(shape_axes, 1) | dict(zip(names, lanes, strict=True))
    return Plan(groups, each, shape_axes, variables(groups, each, sizes), block)


def block_of(shape: tuple[int, ...], most: int) -> tuple[int, ...]:
    """The largest chunk of at most `most` lanes: trailing axes whole, one axis in equal parts, leading axes single."""
    whole, block = 1, [1] * len(shape)
    for i in reversed(range(len(shape))):
        parts = math.ceil(shape[i] / max(1, most // whole))
        block[i] = math.ceil(shape[i] / parts)
        whole *= block[i]
        if parts > 1:
            break
    return tuple(block)


def parts_of(plan: Plan, part: tuple[int, int]) -> range:
    """The chunks of worker i of `count`: i, i + count, i + 2 count, ..."""
    valid = isinstance(part, tuple) and len(part) == 2 and all(isinstance(n, int) and not isinstance(n, bool) for n in part)
    if not valid or not 0 <= part[0] < part[1]:
        fix = "It is (this worker's number from 0, the number of workers)."
        raise refuse("study", "part", repr(part), "(i, count) with 0 <= i < count", fix)
    return range(part[0], len(plan), part[1])


def _sizes(groups: tuple[Group, ...], shape_axes: Mapping[str, list[Any]]) -> dict[str, int]:
    points = {name: len(values) for name, values in shape_axes.items()}
    return points | {axis.name: axis.size for axis in groups[0].axes}
