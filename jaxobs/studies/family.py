"""A grid of observers: one observer, some of whose leaves run over values."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import (
    Module,
    Numbers,
    as_param,
    check,
    concrete,
    dtype_of,
    key_axes,
    refuse,
    require_instance,
    require_integer,
    static,
)


class Family(Module):
    """`observer` with the leaf names[i] running over values[i] (its first axis); the combinations form a full grid.

    in_axes[i] is what `jax.vmap` takes to batch names[i] alone, everything else shared.
    """

    observer: Any
    values: tuple[Float[Array, "_ ..."], ...]
    names: tuple[str, ...] = static()

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(v.shape[0] for v in self.values)

    @property
    def in_axes(self) -> tuple[Any, ...]:
        nowhere = jax.tree.map(lambda _: None, self.observer)
        return tuple(eqx.tree_at(_leaf(name), nowhere, 0, is_leaf=lambda x: x is None) for name in self.names)

    def member(self, *chosen: Array) -> Any:
        """The observer with its named leaves at the given values."""
        return eqx.tree_at(lambda o: [_leaf(name)(o) for name in self.names], self.observer, list(chosen))


def grid(observer: Module, **axes: Numbers) -> Family:
    """`grid(observer, gamma=gammas)`: the named leaves get an axis, the rest is shared; several names make a full grid.

    Leaves of parts are named with dots: `grid(observer, **{"model.a": values})`. Every value is checked as at construction
    (gamma = -1 is refused here, before anything is traced). ValueError for a name that is no leaf.
    """
    require_instance("grid", "observer", observer, Module, "Give one observer; a design returns it with its certificate.")
    values = []
    for name, given in axes.items():
        if name not in (known := leaf_names(observer)):
            raise _unknown(observer, name, known)
        leaf = _leaf(name)(observer)
        array = jnp.asarray(as_param(given), dtype_of(observer))
        if array.ndim != leaf.ndim + 1 or array.shape[1:] != leaf.shape or array.shape[0] == 0:
            fix = "The first axis counts the members of the family."
            if array.ndim == 0:
                fix = f"Give a list: {name}=[{given}]."
            expected = str(("members", *leaf.shape)).replace("'", "")
            raise refuse("grid", name, f"shape {array.shape}", expected, fix)
        if concrete(array) is not None:
            for value in array:
                check(eqx.tree_at(_leaf(name), observer, value))
        values.append(array)
    return Family(observer, tuple(values), tuple(axes))


def over(family: Family | Module, loss: Callable[[Any, Any], Any], *, lanes: int = 512) -> Callable[..., Any]:
    """`over(family, loss)(keys)`: loss(observer, key) for every member and every key, of shape (*family.shape, len(keys)).

    Without keys, `over(family, loss)()` calls loss(observer, None) once for each member. `lanes` are advanced together (a tile
    that stays in the cache), tile after tile, so memory does not grow with the grid. The loss may return any pytree.
    """
    require_integer("over", "lanes", lanes, 1, "It counts the runs that are advanced together.")
    require_instance("over", "family", family, Module, "Give an observer or jaxobs.grid(observer, ...).")
    family = family if isinstance(family, Family) else Family(family, (), ())

    @eqx.filter_jit
    def every(family: Family, keys: Any) -> Any:
        seeds = () if keys is None else (keys.shape[0],)
        shape = family.shape + seeds
        index = [jnp.asarray(axis.reshape(-1)) for axis in np.indices(shape)]

        def lane(chosen):
            member = family.member(*(value[i] for value, i in zip(family.values, chosen, strict=False)))
            return loss(member, None if keys is None else keys[chosen[-1]])

        if not index:
            return loss(family.observer, None)
        results = jax.lax.map(lane, index, batch_size=min(lanes, index[0].shape[0]))
        return jax.tree.map(lambda a: a.reshape(shape + a.shape[1:]), results)

    def results(keys=None):
        if keys is not None and not key_axes(keys):
            given = f"{type(keys).__name__} of shape {np.shape(keys)}"
            fix = "Split one key: jax.random.split(jax.random.key(0), runs)."
            raise refuse("over", "keys", given, "PRNG keys along a leading axis", fix)
        return every(family, keys)

    return results


def leaf_names(tree: Module) -> list[str]:
    """The dotted names of all float leaves."""
    paths = jax.tree_util.tree_flatten_with_path(tree)[0]
    return [_dotted(path) for path, leaf in paths if eqx.is_inexact_array(leaf)]


def _unknown(observer: Module, name: str, known: list[str]) -> ValueError:
    try:
        found = functools.reduce(part_of, name.split("."), observer)
    except (AttributeError, IndexError, StopIteration, TypeError):
        found = None
    if isinstance(found, (int, float, str)):
        fix = "Build one observer for each value, and compare them in a loop."
        return refuse("grid", name, f"{found!r}, which fixes shapes or structure", "one of " + ", ".join(known), fix)
    given = f"no such number in {type(observer).__name__}"
    return refuse("grid", name, given, "one of " + ", ".join(known), "Check its name.")


def _dotted(path: tuple[Any, ...]) -> str:
    return ".".join(str(getattr(step, "name", getattr(step, "idx", getattr(step, "key", step)))) for step in path)


def _leaf(name: str) -> Callable[[Any], Any]:
    return lambda tree: functools.reduce(part_of, name.split("."), tree)


def part_of(tree: Any, step: str) -> Any:
    """One step of a dotted name: a field, an entry of a tuple or list, a key of a dict."""
    if isinstance(tree, dict):
        return next(value for key, value in tree.items() if str(key) == step)
    return tree[int(step)] if step.isdigit() else getattr(tree, step)
