"""A grid of observers: one observer, some of whose leaves run over values."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Module, Numbers, as_param, check, concrete, dtype_of, refuse, static


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
    values = []
    for name, given in axes.items():
        if name not in (known := leaf_names(observer)):
            raise refuse(
                "grid",
                name,
                f"no such number in {type(observer).__name__}",
                "one of " + ", ".join(known),
                "Check its name.",
            )
        leaf = _leaf(name)(observer)
        array = jnp.asarray(as_param(given), dtype_of(observer))
        if array.ndim != leaf.ndim + 1 or array.shape[1:] != leaf.shape or array.shape[0] == 0:
            fix = "The first axis counts the members of the family."
            raise refuse("grid", name, f"shape {array.shape}", f"(members, *{leaf.shape})", fix)
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

    return lambda keys=None: every(family, keys)


def leaf_names(tree: Module) -> list[str]:
    """The dotted names of all float leaves."""
    paths = jax.tree_util.tree_flatten_with_path(tree)[0]
    return [_dotted(path) for path, leaf in paths if eqx.is_inexact_array(leaf)]


def _dotted(path: tuple[Any, ...]) -> str:
    return ".".join(str(getattr(step, "name", getattr(step, "idx", getattr(step, "key", step)))) for step in path)


def _leaf(name: str) -> Callable[[Any], Any]:
    def get(tree: Any) -> Any:
        for step in name.split("."):
            tree = tree[int(step)] if step.isdigit() else getattr(tree, step)
        return tree

    return get
