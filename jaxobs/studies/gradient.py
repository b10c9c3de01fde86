"""The mean of a metric over the lanes of a study, and its gradient with respect to the observer's numbers."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jax.sharding import PartitionSpec
from jaxtyping import Array, Int

from jaxobs._loop import Grid
from jaxobs._module import Numbers, Scalar, check, concrete, refuse, require_integer
from jaxobs.integrators import AbstractIntegrator, Adaptive
from jaxobs.metrics import AbstractMetric
from jaxobs.studies.adjoints import run_adjoints
from jaxobs.studies.axes import Group, Members
from jaxobs.studies.devices import compiler_options, mesh
from jaxobs.studies.family import Family, leaf_names, part_of
from jaxobs.studies.groups import make_groups
from jaxobs.studies.kernel import LEAST
from jaxobs.studies.sensitive import Sensitive
from jaxobs.studies.tangents import Tangents, run_tangents

FEW = 64  # numbers: with more of them forward mode, whose cost grows with them, gives way to reverse mode
Mode = Literal["forward", "reverse"]
Diverged = Literal["keep", "drop"]


class Slope(NamedTuple):
    """The mean, its gradient, and the number of lanes that diverged: whose x, xhat, metric or derivative is not finite."""

    value: Scalar
    gradient: Any
    diverged: Int[Array, ""]


@dataclasses.dataclass(frozen=True)
class MeanGradient:
    """What `mean_gradient` returns: a function of the observer, checked and ready to be compiled."""

    group: Group
    of: Callable[[dict[str, Any]], Any]
    names: tuple[str, ...]
    named: bool
    mode: Mode
    diverged: Diverged
    tile: int

    def __call__(self, observer: Any = None) -> Slope:
        """At this observer: the same as the one given before, with other numbers; without it, at that one."""
        world = self.group.world
        if observer is not None:
            world = eqx.tree_at(lambda w: w.observer.observer, world, self._checked(observer))
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(world))
        what = self.of, self.names, self.mode, self.diverged == "drop", self.tile
        mean = _mean if traced else _compiled()
        value, flat, lost = mean(world, self.group.grid, mesh(), self.group.hold_innovation, *what)
        leaves = [functools.reduce(part_of, name.split("."), world.observer.observer) for name in self.names]
        slopes, at = {}, 0
        for name, leaf in zip(self.names, leaves, strict=True):
            slopes[name] = flat[at : at + leaf.size].reshape(leaf.shape)
            at += leaf.size
        return Slope(value, slopes if self.named else self._like_observer(slopes), lost)

    def loss(self, observer: Any) -> Scalar:
        """The mean alone; `jax.grad` of it is this gradient (first order, reverse mode). What is not in `wrt` is a constant."""
        numbers, rest = eqx.partition(observer, eqx.is_inexact_array)

        @jax.custom_vjp
        def value(numbers: Any) -> Any:
            return self(eqx.combine(numbers, rest)).value

        def ahead(numbers: Any) -> Any:
            found = self(eqx.combine(numbers, rest))
            return found.value, self._like_observer(found.gradient) if self.named else found.gradient

        def back(gradient: Any, cotangent: Any) -> Any:
            return (jax.tree.map(lambda one: cotangent * one, gradient),)

        value.defvjp(ahead, back)
        return value(numbers)

    def _like_observer(self, slopes: Mapping[str, Any]) -> Any:
        observer = eqx.filter(self.group.world.observer.observer, eqx.is_inexact_array)
        paths, structure = jax.tree_util.tree_flatten_with_path(observer)
        named = dict(zip(leaf_names(observer), (leaf for _, leaf in paths), strict=True))
        return jax.tree.unflatten(structure, [slopes.get(name, jnp.zeros_like(leaf)) for name, leaf in named.items()])

    def _checked(self, observer: Any) -> Any:
        known = self.group.world.observer.observer
        same = jax.tree.structure(observer) == jax.tree.structure(known)
        pairs = zip(jax.tree.leaves(observer), jax.tree.leaves(known), strict=False)
        if not same or any(jnp.shape(a) != jnp.shape(b) or jnp.result_type(a) != jnp.result_type(b) for a, b in pairs):
            fix = "Replace numbers only, e.g. with eqx.tree_at; another structure takes another mean_gradient."
            raise refuse(
                "mean_gradient", "observer", type(observer).__name__, f"the {type(known).__name__} it was made for", fix
            )
        check(observer)
        return jax.tree.map(_plain, observer)


def mean_gradient(
    of: Callable[[dict[str, Any]], Any],
    plant: Any,
    observer: Any,
    *,
    ts: Numbers,
    metrics: Mapping[str, AbstractMetric],
    x0: Any,
    xhat0: Any,
    wrt: str | Sequence[str] | None = None,
    keys: Any = None,
    signal: Any = None,
    noise: Any = None,
    disturbance: Any = None,
    integrator: AbstractIntegrator | None = None,
    hold_innovation: bool = False,
    mode: Mode | None = None,
    diverged: Diverged = "keep",
    tile: int = 512,
) -> MeanGradient:
    """f with f(observer).value = mean over all lanes of of(metrics), and f(observer).gradient = its derivative.

        f = mean_gradient(lambda found: found["rmse"][1], plant, observer, wrt=["gamma", "alphas"], metrics=..., ts=..., ...)
        found = f(observer)        # found.gradient["gamma"], found.gradient["alphas"]

    of: {metric: value} of one lane -> a number. The lanes and all other arguments are those of `jaxobs.study`; observer: one,
    or a family whose axes are lanes too. wrt: leaves of the observer by their dotted names ("model.a"); the gradient is then a
    dict. Without it, all its floats, and the gradient is an observer. `f.loss(observer)` is the mean as a function that
    `jax.grad` takes, for observers that are made from other parameters.

    f is compiled once and works inside `jit`: other numbers in the observer compile nothing again. Memory is that of the
    lanes, whatever the number of samples. mode: "forward" carries a derivative for each of the P numbers along each lane, and
    costs 1 + O(P) runs; "reverse" goes back in time over checkpoints (memory of a tile: sqrt(T)) at a cost that hardly depends
    on P. By itself: forward up to 64 numbers, but reverse with `Adaptive`, which has no other.
    diverged: "keep" averages over all lanes, so that one that diverged makes the mean NaN; "drop" leaves those out. They are
    counted in both cases. tile: lanes advanced together.

    ValueError names the argument that does not fit.
    """
    if not callable(of):
        fix = 'Give a function, e.g. lambda found: found["rmse"][0].'
        raise refuse("mean_gradient", "of", type(of).__name__, "a function of the metrics of a lane", fix)
    for name, given, known in (("mode", mode, (None, "forward", "reverse")), ("diverged", diverged, ("keep", "drop"))):
        if given not in known:
            raise refuse("mean_gradient", name, repr(given), "one of " + ", ".join(map(repr, known)), "Choose one of them.")
    require_integer("mean_gradient", "tile", tile, 1, "It counts the lanes that are advanced together.")
    group = make_groups(
        plant, observer, ts=ts, metrics=metrics, x0=x0, xhat0=xhat0, keys=keys, signal=signal, noise=noise,
        disturbance=disturbance, integrator=integrator, hold_innovation=hold_innovation, save=None,
    )[1]  # fmt: skip
    if len(group) != 1 or group[0].label:
        fix = "Take the gradient of each of them apart."
        raise refuse("mean_gradient", "observer", "several observers", "one observer or one family", fix)
    family = group[0].world.observer
    names = _names(family, wrt)
    adaptive = isinstance(group[0].world.integrator, Adaptive)
    if adaptive and mode == "forward":
        raise refuse("mean_gradient", "mode", "'forward' with Adaptive", "'reverse'", "diffrax goes back in time only here.")
    size = sum(functools.reduce(part_of, name.split("."), family.observer).size for name in names)
    chosen = mode or ("reverse" if adaptive or size > FEW else "forward")
    return MeanGradient(group[0], of, names, wrt is not None, chosen, diverged, tile)


def _names(family: Family, wrt: str | Sequence[str] | None) -> tuple[str, ...]:
    known = [name for name in leaf_names(family.observer) if name not in family.names]
    names = tuple(known) if wrt is None else (wrt,) if isinstance(wrt, str) else tuple(wrt)
    for name in names:
        if name not in known:
            fix = "A leaf that runs over values has no gradient." if name in family.names else "Check its name."
            raise refuse("mean_gradient", "wrt", repr(name), "one of " + ", ".join(known), fix)
    if not names or len(set(names)) != len(names):
        fix = "Name the numbers to differentiate by, e.g. wrt=['gamma']."
        raise refuse("mean_gradient", "wrt", str(list(names)), "one name or more, each once", fix)
    return names


def _plain(leaf: Any) -> Any:
    """The same number, of a strong dtype and on no device in particular: otherwise JAX would compile again for it."""
    known = concrete(leaf)
    return jax.lax.convert_element_type(leaf, leaf.dtype) if known is None else jnp.asarray(known)


def _mean(
    world: Members,
    grid: Grid,
    over: Any,
    hold: bool,
    of: Any,
    names: tuple[str, ...],
    mode: Mode,
    drop: bool,
    tile: int,
) -> tuple[Any, Any, Any]:
    arrays, rest = eqx.partition((world, grid), eqx.is_array)
    arrays = jax.lax.optimization_barrier(arrays)  # in a user's jit they are constants, which a kernel may not be given
    shape, lanes = world.shape, math.prod(world.shape)
    while tile > LEAST and tile * over.size >= 2 * lanes:
        tile //= 2
    tiles = -(-lanes // (tile * over.size)) * over.size

    def device(arrays: Any, starts: Any) -> dict[str, Any]:
        there, grid = eqx.combine(arrays, rest)
        sensitive = Sensitive(there, grid, hold, names)
        tangents = Tangents(sensitive) if mode == "forward" else None

        def one(start: Any) -> dict[str, Any]:
            lane = jnp.minimum(start + jnp.arange(tile, dtype=jnp.int32), lanes - 1)
            indices = jnp.stack(jnp.unravel_index(lane, shape)) if shape else jnp.zeros((0, tile), jnp.int32)
            return run_tangents(tangents, indices, of) if tangents else run_adjoints(sensitive, indices, of)

        return {name: a.reshape(-1, *a.shape[2:]) for name, a in jax.lax.map(one, starts).items()}

    spec = PartitionSpec("lanes")
    several = jax.shard_map(device, mesh=over, in_specs=(PartitionSpec(), spec), out_specs=spec, check_vma=False)
    spread = several if over.size > 1 else device
    found = {name: a[:lanes] for name, a in spread(arrays, jnp.arange(tiles, dtype=jnp.int32) * tile).items()}
    numbers = jnp.concatenate([found["value"][:, None], found["gradient"]], axis=1)
    lost = jnp.isfinite(found["diverged_at"]) | ~jnp.all(jnp.isfinite(numbers), axis=1)
    taken = jnp.where(lost[:, None], 0, numbers) if drop else numbers
    count = jnp.sum(~lost) if drop else jnp.asarray(lanes)
    mean = _tree_sum(taken) / count.astype(numbers.dtype)
    return mean[0], mean[1:], jnp.sum(lost)


@functools.cache
def _compiled() -> Any:
    jit: Any = eqx.filter_jit
    return jit(_mean, compiler_options=compiler_options())


def _tree_sum(values: Any) -> Any:
    """(v_0 + v_1) + (v_2 + v_3), ...: the same bits whatever the tiles and devices."""
    while values.shape[0] > 1:
        pairs = values.shape[0] // 2 * 2
        values = jnp.concatenate([values[0:pairs:2] + values[1:pairs:2], values[pairs:]])
    return values[0]
