"""Axes that change shapes: the order of an observer, its number of integrators, its kind."""

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from jaxobs._module import refuse


@dataclasses.dataclass(frozen=True)
class Variants:
    """make(**point) for every point of the full grid of the axes."""

    make: Callable[..., Any]
    axes: Mapping[str, Sequence[Any]]

    def __iter__(self) -> Iterator[tuple[dict[str, Any], Any]]:
        for values in itertools.product(*self.axes.values()):
            point = dict(zip(self.axes, values, strict=True))
            try:
                made = self.make(**point)
            except Exception as error:
                error.add_note(f"It came from variants(make, ...) at {_spelled(point)}.")
                raise
            yield point, made


def variants(make: Callable[..., Any], **axes: Sequence[Any]) -> Variants:
    """`variants(make, q=[0, 1, 2], n=[2, 3])`: what changes shapes, hence is compiled once for each; study's `families`.

    make(q=0, n=2) returns an observer, a family of observers (`jaxobs.grid`), or a pair (plant, observer or family) when the
    plant changes too. ValueError for an axis that is empty, has a value twice, or holds anything but numbers and strings.
    """
    if not callable(make):
        raise refuse("variants", "make", type(make).__name__, "a function", "For a plain comparison: {label: observer, ...}.")
    if not axes:
        raise refuse("variants", "axes", "none", "at least one", "Name it: variants(make, q=[0, 1, 2]).")
    checked = {}
    for name, values in axes.items():
        if not name.isidentifier():
            raise refuse("variants", "axes", f"the name {name!r}", "a Python name", "It becomes an axis of the data set.")
        if isinstance(values, str) or not hasattr(values, "__iter__"):
            raise refuse("variants", name, repr(values), "a list of values", f"Give a list: {name}=[{values!r}].")
        checked[name] = labels("variants", name, list(values))
    return Variants(make, checked)


def labels(owner: str, field: str, values: list[Any]) -> list[Any]:
    """Values that can stand along an axis: numbers or strings, at least one, none twice."""
    values = [value.item() if hasattr(value, "item") and getattr(value, "shape", None) == () else value for value in values]
    fix = "An axis needs values that tell its points apart."
    if not values:
        raise refuse(owner, field, "no values", "at least one", fix)
    if not (all(isinstance(v, str) for v in values) or all(isinstance(v, int | float) for v in values)):
        raise refuse(owner, field, repr(values), "numbers, or strings", fix)
    if len(set(values)) < len(values):
        raise refuse(owner, field, repr(values), "each value once", fix)
    return values


def _spelled(point: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in point.items())
