"""From the arguments of a study to its groups: every argument is checked here, before anything is compiled."""

import itertools
import reprlib
import warnings
from collections.abc import Mapping
from typing import Any

import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from jaxobs._loop import as_state, check_period
from jaxobs._module import check, key_axes, refuse, require_integer
from jaxobs._motion import World
from jaxobs._simulate import check_scored
from jaxobs.integrators import check_step
from jaxobs.observers import AbstractFlowObserver, Observer
from jaxobs.studies.axes import RESERVED, Axis, Group, Members, Seeds, lane_axes
from jaxobs.studies.family import Family
from jaxobs.studies.variants import Variants, labels

LOOKED_AT = 8  # members of an axis whose sampling period and step are checked: the ends, and evenly between


def make_groups(
    plant, families, *, ts, metrics, x0, xhat0, keys, signal, noise, disturbance, integrator, hold_innovation, save
) -> tuple[dict[str, list[Any]], tuple[Group, ...]]:
    """The shape axes with their values, and one group for each of their points. ValueError names the argument at fault."""
    if not isinstance(hold_innovation, bool):
        raise refuse("study", "hold_innovation", repr(hold_innovation), "True or False", "It is a choice between two rules.")
    if save is not None:
        require_integer("study", "save", save, 1, "Every save-th sample is kept; None keeps no trajectories.")
    keys = _checked_keys(keys, noise, disturbance)
    shape_axes, members = _points(plant, families)
    for label, _, _ in members[:1]:
        for name in label:
            if name in RESERVED and name != "observer":
                raise refuse("study", "families", f"an axis {name!r}", "another name", "The data set uses this one itself.")
    groups = []
    for label, one_plant, observers in members:
        try:
            groups.append(
                _group(
                    label, one_plant, observers, ts, metrics, x0, xhat0, keys, signal, noise, disturbance, integrator,
                    hold_innovation, save,
                )
            )  # fmt: skip
        except ValueError as error:
            if label:
                error.add_note("It is about " + ", ".join(f"{name} = {value!r}" for name, value in label.items()) + ".")
            raise
    _check_alike(groups)
    check_names(metrics, (*shape_axes, *(axis.name for axis in groups[0].axes)))
    return shape_axes, tuple(groups)


def _points(plant: Any, families: Any) -> tuple[dict[str, list[Any]], list[tuple[dict[str, Any], Any, Any]]]:
    """(shape axes, [(point, plant, observer or family)])."""
    fix = "Give an observer, jaxobs.grid(observer, ...), {label: one of these}, or jaxobs.variants(make, q=[0, 1])."
    if isinstance(families, Variants):
        points = []
        for point, made in families:
            pair = isinstance(made, tuple) and len(made) == 2
            if pair and plant is not None:
                more = "Leave one of them out: study(None, ...)."
                raise refuse("study", "plant", "a plant beside variants that bring their own", "one plant", more)
            points.append((point, made[0] if pair else plant, made[1] if pair else made))
        return {name: list(values) for name, values in families.axes.items()}, points
    if isinstance(families, Mapping):
        names = labels("study", "families", list(families))
        return {"observer": names}, [({"observer": name}, plant, families[name]) for name in families]
    if not isinstance(families, Observer | Family):
        raise refuse("study", "families", type(families).__name__, "an observer or a family of observers", fix)
    return {}, [({}, plant, families)]


def _group(
    label, plant, observers, ts, metrics, x0, xhat0, keys, signal, noise, disturbance, integrator, hold_innovation, save
) -> Group:
    families = {
        "observer": _family(observers), "plant": _family(plant), "signal": _family(signal), "noise": _family(noise),
        "disturbance": _family(disturbance),
    }  # fmt: skip
    for part, family in families.items():
        if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(family)):
            fix = "A study runs outside jit, vmap and grad; inside them use jaxobs.over."
            raise refuse("study", part, "values that are being traced", "numbers", fix)
    first = {part: family and family.member(*(values[0] for values in family.values)) for part, family in families.items()}
    n = getattr(first["plant"], "n", None)
    starts = [_start(name, start, n) for name, start in (("x0", x0), ("xhat0", xhat0))]
    row, guess = (start[0] if start.ndim == 2 and len(start) else start for start in starts)
    observer = first.pop("observer")
    world = World(**first, integrator=integrator)
    key = None if keys is None else keys[0]
    world, _, one_x0, one_xhat0, grid = check_scored("study", world, observer, metrics, row, guess, ts, key)
    dtype, many = one_x0.dtype, []
    for name, start, one in (("x0", starts[0], one_x0), ("xhat0", starts[1], one_xhat0)):
        if start.ndim == 2:
            for row in start[~np.isfinite(start).all(axis=1)][:1]:
                as_state("study", name, row, len(one), dtype)
            one = jnp.asarray(start, dtype)
        many.append(one)
    families["signal"] = families["signal"] or _family(world.signal)
    members = Members(**families, x0=many[0], xhat0=many[1], keys=keys, integrator=world.integrator, metrics=dict(metrics))
    _check_members(members, grid)
    times = np.asarray(ts, np.float64)
    return Group(label, members, times, grid, hold_innovation, save, lane_axes(members, tuple(label)))


def _start(name: str, start: Any, n: int | None) -> np.ndarray:
    """Initial states as NumPy, (n,) or (members, n)."""
    given = start(n) if callable(start) and n is not None else start
    try:
        return np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        fix = "Give one number for each state, or a list of such rows of one length."
        raise refuse("study", name, reprlib.repr(given), "real numbers, (n,) or (members, n)", fix) from error


def _family(part: Any) -> Any:
    return part if part is None or isinstance(part, Family) else Family(part, (), ())


def _checked_keys(keys: Any, noise: Any, disturbance: Any) -> Any:
    """Seeds, or an array of typed keys: those of the old style give the same numbers as their typed equals."""
    fix = "Give jaxobs.Seeds(jax.random.key(0), 1000), or jax.random.split(jax.random.key(0), 1000)."
    expected = "Seeds, or PRNG keys along one axis"
    if keys is None:
        if noise is not None or disturbance is not None:
            raise refuse("study", "keys", "None", expected, f"Noise and disturbance draw from them. {fix}")
        return None
    if isinstance(keys, Seeds):
        return Seeds(_typed(keys.key), keys.count)
    if key_axes(keys) != 1 or keys.shape[0] == 0:
        raise refuse("study", "keys", f"{type(keys).__name__} of shape {np.shape(keys)}", expected, fix)
    return _typed(keys)


def _typed(keys: Any) -> Any:
    keys = keys if jnp.issubdtype(keys.dtype, jax.dtypes.prng_key) else jax.random.wrap_key_data(jnp.asarray(keys))
    if "rbg" in (kind := str(jax.random.key_impl(keys))):
        fix = "Under jax.vmap JAX draws such numbers from the first of all keys: give jax.random.key(0, impl='threefry2x32')."
        raise refuse("study", "keys", f"keys of the kind {kind!r}", "keys whose numbers do not depend on other lanes", fix)
    return keys


def _check_members(members: Members, grid: Any) -> None:
    """Sampling periods and steps of the members along each axis; a warning that many members give is given once."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for part in ("observer", "plant"):
            family = getattr(members, part)
            for i, values in enumerate(family.values):
                chosen = np.unique(np.linspace(0, len(values) - 1, min(len(values), LOOKED_AT)).astype(int))
                for j in chosen[chosen > 0]:
                    member = family.member(*(v[j if k == i else 0] for k, v in enumerate(family.values)))
                    check(member)
                    check_period("study", member, grid.spacing)
                    if isinstance(member, AbstractFlowObserver):
                        check_step("study", member, members.integrator, jnp.max(grid.dts))
    for kind, alike in itertools.groupby(caught, lambda warning: warning.category):
        first, *others = [str(warning.message) for warning in alike]
        more = f" The same holds for {len(others)} more of the members looked at." if others else ""
        warnings.warn(first + more, kind, stacklevel=5)


def _check_alike(groups: list[Group]) -> None:
    """All groups lie on one grid of lanes: same axes, same values, same precision."""
    first = groups[0]
    apart = "Give all of them the same axes (jaxobs.grid with one value makes an axis), or study them apart."
    for group in groups[1:]:
        where = ", ".join(f"{name} = {value!r}" for name, value in group.label.items())
        names, expected = [a.name for a in group.axes], [a.name for a in first.axes]
        if names != expected:
            raise refuse("study", "families", f"axes {names} at {where}", f"the axes {expected} of the first", apart)
        for ours, theirs in zip(group.axes, first.axes, strict=True):
            if ours.size != theirs.size or not _same_values(ours, theirs):
                given, wanted = (f"{ours.name} with {_brief(axis)}" for axis in (ours, theirs))
                raise refuse("study", "families", f"{given} at {where}", f"{wanted} as in the first", apart)
        if group.dtype != first.dtype:
            fix = "Convert the parts with jaxobs.astype(part, dtype)."
            raise refuse("study", "families", f"precision {group.dtype} at {where}", f"{first.dtype} as in the first", fix)


def _same_values(ours: Axis, theirs: Axis) -> bool:
    """Vectors along an axis may differ from group to group: they are told apart by their numbers 0, 1, ..."""
    return ours.values is None or theirs.values is None or ours.values.ndim > 1 or np.array_equal(ours.values, theirs.values)


def _brief(axis: Axis) -> str:
    short = axis.size <= 6 and axis.values is not None and axis.values.ndim == 1
    return f"values {axis.values.tolist()}" if short else f"{axis.size} values"  # pyright: ignore


def check_names(metrics: Mapping[str, Any], axes: tuple[str, ...]) -> None:
    """No name is used twice in the data set, and a name can be a folder."""
    for name in axes:
        if axes.count(name) > 1:
            fix = "Rename the argument of variants, or leave that leaf out of the grid."
            raise refuse("study", "families", f"the axis {name!r} twice", "each axis once", fix)
    for name in metrics:
        if not isinstance(name, str) or not name.isidentifier() or name in (*RESERVED, *axes):
            fix = "It becomes a variable of the data set, beside its axes " + ", ".join((*axes, *RESERVED)) + "."
            raise refuse("study", "metrics", f"the name {name!r}", "a Python name that no axis has", fix)
