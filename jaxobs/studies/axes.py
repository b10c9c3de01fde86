"""What a study runs over: its axes, its seeds, and the groups of lanes that share one compiled shape."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from jaxobs._loop import Grid
from jaxobs._module import Module, Numbers, key_axes, refuse, require_integer, static
from jaxobs._motion import World
from jaxobs.integrators import AbstractIntegrator
from jaxobs.metrics import AbstractMetric
from jaxobs.studies.family import Family

PARTS = ("observer", "plant", "signal", "noise", "disturbance")  # in the order of the axes


class Seeds(Module):
    """The keys fold_in(key, 0), ..., fold_in(key, count - 1): each is made where it is used, none is stored."""

    key: Any
    count: int = static()

    def __check_init__(self):
        if key_axes(self.key) != 0:
            fix = "Make it from the seed: Seeds(jax.random.key(0), 1000)."
            raise refuse(self, "key", f"{type(self.key).__name__} of shape {np.shape(self.key)}", "one PRNG key", fix)
        require_integer(self, "count", self.count, 1, "It is the number of runs of each member.")
        if self.count > 2**32:
            raise refuse(self, "count", self.count, "at most 2**32 seeds", "fold_in would make the same keys again.")

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, i: Any) -> Any:
        return jax.random.fold_in(self.key, i)


@dataclasses.dataclass(frozen=True)
class Axis:
    """One named axis of lanes: `leaf` of `part` at values[i] (its first axis); a leaf "" is the whole of the part."""

    name: str
    part: str
    leaf: str
    size: int
    values: np.ndarray | None  # None: the axis only counts (seeds)


class Members(Module):
    """All numbers of a group as one pytree, to be given to a compiled function."""

    observer: Family
    plant: Family
    signal: Family
    noise: Family | None
    disturbance: Family | None
    x0: Float[Array, "*starts n"]
    xhat0: Float[Array, "*guesses n"]
    keys: Any
    integrator: AbstractIntegrator
    metrics: dict[str, AbstractMetric]

    @property
    def shape(self) -> tuple[int, ...]:
        """One entry for each leaf that varies, then x0 and xhat0 if there are several, and the keys if there are any."""
        leaves = [size for part in PARTS if (family := getattr(self, part)) is not None for size in family.shape]
        return (*leaves, *self.x0.shape[:-1], *self.xhat0.shape[:-1], *(() if self.keys is None else (len(self.keys),)))

    def at(self, index: Any) -> tuple[World, Any, Array, Array, Any]:
        """One lane: (world, observer, x0, xhat0, key); index has one number for each entry of shape."""
        numbers = iter(index)
        lane = {}
        for part in PARTS:
            family = getattr(self, part)
            lane[part] = family and family.member(*(values[next(numbers)] for values in family.values))
        x0 = self.x0[next(numbers)] if self.x0.ndim == 2 else self.x0
        xhat0 = self.xhat0[next(numbers)] if self.xhat0.ndim == 2 else self.xhat0
        key = None if self.keys is None else self.keys[next(numbers)]
        observer = lane.pop("observer")
        return World(**lane, integrator=self.integrator), observer, x0, xhat0, key


@dataclasses.dataclass(frozen=True)
class Group:
    """Lanes of one compiled shape. Lane i is that of np.unravel_index(i, shape): the last axis (the seeds) runs fastest."""

    label: Mapping[str, Any]  # shape axis -> its value
    world: Members
    ts: np.ndarray
    grid: Grid
    hold_innovation: bool
    save: int | None
    axes: tuple[Axis, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(axis.size for axis in self.axes)

    @property
    def lanes(self) -> int:
        return math.prod(self.shape)

    @property
    def metrics(self) -> dict[str, AbstractMetric]:
        return self.world.metrics

    @property
    def dtype(self) -> Any:
        return self.world.x0.dtype

    @property
    def n(self) -> int:
        return self.world.x0.shape[-1]


RESERVED = ("observer", "state", "output", "lag", "time", "seed", "x0", "xhat0", "x", "xhat", "diverged_at")


def lane_axes(world: Members, taken: tuple[str, ...]) -> tuple[Axis, ...]:
    """The axes by their names in the data set, in the order of the lanes.

    Leaves of the observer go by the names they have in `grid`; those of plant, signal, noise and disturbance too, unless
    another axis or one of the `taken` names is the same: then "noise.sigma".
    """
    families = [(part, family) for part in PARTS if (family := getattr(world, part)) is not None]
    found = [(part, leaf, v) for part, family in families for leaf, v in zip(family.names, family.values, strict=True)]
    leaves = [leaf for _, leaf, _ in found]
    axes = []
    for part, leaf, values in found:
        shared = leaves.count(leaf) > 1 and part != "observer"
        name = f"{part}.{leaf}" if shared or leaf in (*RESERVED, *taken) else leaf
        axes.append(Axis(name, part, leaf, len(values), decimal(values)))
    for name, start in (("x0", world.x0), ("xhat0", world.xhat0)):
        if start.ndim == 2:
            axes.append(Axis(name, name, "", len(start), decimal(start)))
    if world.keys is not None:
        axes.append(Axis("seed", "seed", "", len(world.keys), None))
    return tuple(axes)


def decimal(values: Numbers) -> np.ndarray:
    """In float64, the shortest decimals that are these numbers: 0.1 for the float32 next to 0.1, so that it can be selected."""
    array = np.asarray(values)
    if array.dtype != np.float32:
        return array if array.dtype == np.float64 else array.astype(str).astype(np.float64)
    exact = array.astype(np.float64)
    common = (np.abs(exact) > 1e-9) & (np.abs(exact) < 1e9)  # where the powers of ten below are exact
    found, left = exact.copy(), np.flatnonzero(common)
    found[~common] = array[~common].astype(str).astype(np.float64)
    for digits in range(6, 10):
        x = exact.flat[left]
        place = digits - 1 - np.floor(np.log10(np.abs(x)))
        ten = 10.0 ** np.abs(place)
        tried = np.where(place > 0, np.rint(x * ten) / ten, np.rint(x / ten) * ten)
        same = tried.astype(np.float32) == array.flat[left]
        found.flat[left[same]] = tried[same]
        left = left[~same]
    return found
