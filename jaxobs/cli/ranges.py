"""Values of one number along an axis of a study, as a config writes them."""

import dataclasses
import typing
from typing import Any, Literal

import numpy as np

from jaxobs._module import refuse
from jaxobs.cli.reading import Vector


@dataclasses.dataclass(frozen=True)
class Several:
    """The values of one number along an axis, and the one that a model has which is made like the plant."""

    where: str
    values: list[Any]
    nominal: float | None = None


@dataclasses.dataclass(frozen=True)
class Counts:
    """Whole numbers that fix shapes: one build for each."""

    where: str
    values: list[int]


@dataclasses.dataclass(frozen=True)
class Range:
    """gamma = { first = 1.0, last = 10.0, count = 5, spacing = "log" }, or { values = [1.0, 2.0], nominal = 1.0 }."""

    values: Vector | None = None
    first: float | None = None
    last: float | None = None
    count: int | None = None
    spacing: Literal["linear", "log"] = "linear"
    nominal: float | None = None

    def several(self, where: str) -> Several:
        if self.values is not None:
            return Several(where, list(self.values), self.nominal)
        for name in ("first", "last", "count"):
            if getattr(self, name) is None:
                fix = f"Write {where} = {{ first = 1.0, last = 10.0, count = 5 }} or {{ values = [1.0, 2.0] }}."
                raise refuse("config", f"{where}.{name}", "nothing", "a number", fix)
        first, last, count = typing.cast("tuple[float, float, int]", (self.first, self.last, self.count))
        if count < 1:
            raise refuse("config", f"{where}.count", count, "a whole number >= 1", "It counts the values of the axis.")
        if self.spacing == "log" and not first * last > 0:
            raise refuse("config", f"{where}.spacing", "'log'", "first and last of one sign", 'Or spacing = "linear".')
        space = np.geomspace if self.spacing == "log" else np.linspace
        return Several(where, space(first, last, count).tolist(), self.nominal)
