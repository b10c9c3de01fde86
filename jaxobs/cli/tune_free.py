"""The free numbers of an observer and their charts, from [free]."""

# A type checker does not see that param() converts floats and lists.
# pyright: reportArgumentType=false

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse
from jaxobs.cli.tune_config import Free, Search
from jaxobs.studies.family import leaf_names
from jaxobs.tuning import Affine, Box, LogQ, PoleSector, Positive, decode, encode


class Space:
    """The free leaves of an observer, by name, and their charts."""

    def __init__(self, observer: Any, free: dict[str, Free]):
        self.observer, self.names = observer, tuple(free)
        known = leaf_names(observer)
        for name in free:
            if name not in known:
                fix = "These are the numbers of the observer; those of a model begin with model."
                raise refuse("config", f"free.{name}", repr(name), f"one of {', '.join(known)}", fix)
        values = self.values_of(observer)
        self.charts = {name: _chart(one, values[name], name) for name, one in free.items()}
        self.theta0 = self.encode(values)

    def values_of(self, observer: Any) -> dict[str, Any]:
        return {name: functools.reduce(attribute, name.split("."), observer) for name in self.names}

    def encode(self, values: dict[str, Any]) -> dict[str, Any]:
        found = {}
        for name, value in values.items():
            try:
                found[name] = encode(self.charts[name], value)
            except ValueError as error:
                raise ValueError(f"config.free.{name}: {error}") from error
        return found

    def make(self, theta: dict[str, Any]) -> Any:
        values = decode(self.charts, theta)
        places = [lambda one, name=name: functools.reduce(attribute, name.split("."), one) for name in self.names]
        new = [jnp.asarray(values[name], place(self.observer).dtype) for name, place in zip(self.names, places, strict=True)]
        return eqx.tree_at(lambda one: [place(one) for place in places], self.observer, new)


def attribute(part: Any, step: str) -> Any:
    return part[int(step)] if step.isdigit() else getattr(part, step)


def _chart(free: Free, value: Any, name: str) -> Any:
    if free.chart == "PoleSector":
        return PoleSector(free.damping, free.slowest)
    if free.chart == "Box":
        return Box(free.lower, free.upper)
    if free.chart != "Affine":
        return {"LogQ": LogQ, "Positive": Positive}[free.chart]()
    sizes = np.abs(np.asarray(value, float))
    known = sizes[sizes > 0]
    if free.scale is None:
        return Affine(value, np.where(sizes > 0, sizes, np.mean(known) if known.size else 1.0))
    if len(free.scale) != (sizes.shape[0] if sizes.ndim else 1):
        given, expected = f"{len(free.scale)} numbers", f"{sizes.shape[0] if sizes.ndim else 1}"
        raise refuse("config", f"free.{name}.scale", given, expected, "One for each entry, or for each row.")
    scale = np.array(free.scale).reshape(-1, *[1] * (sizes.ndim - 1)) if sizes.ndim else np.array(free.scale[0])
    return Affine(value, np.broadcast_to(scale, sizes.shape))


def nearby(search: Search, space: Space) -> list[Any]:
    """Starts at random beside the first one."""
    rng = np.random.default_rng(0)

    def moved(leaf: Any) -> Any:
        return leaf + search.spread * jnp.asarray(rng.normal(size=np.shape(leaf)), leaf.dtype)

    return [jax.tree.map(moved, space.theta0) for _ in range(search.nearby)]
