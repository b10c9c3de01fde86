"""Objects of the package from the tables of a config: any plant, observer, signal, noise, integrator or metric, by its fields.

A table names a class and gives its fields. Reading it is a matter of types alone and computes nothing; `Part.build` makes the
object. A list in the place of a number is an axis; in the place of a whole number that fixes shapes, it is one build each.
"""

import dataclasses
import inspect
import re
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from jaxobs import hurwitz, integrators, metrics, noise, observers, plants, signals
from jaxobs._module import Module, astype, refuse
from jaxobs.cli import own
from jaxobs.cli.ranges import Counts, Range, Several
from jaxobs.cli.reading import read, unknown, words
from jaxobs.studies import grid

MODULES = (plants, observers, signals, noise, integrators, metrics)
DEPTHS = ("a number", "a list of numbers", "a list of rows of numbers, all of one length")


@dataclasses.dataclass(frozen=True)
class Part:
    """A class and the values of its fields: numbers, texts, `Several`, `Counts`, further parts."""

    kind: type
    where: str
    fields: Mapping[str, Any]
    keys: Mapping[str, str] = dataclasses.field(default_factory=dict)  # of fields that have another name in the config

    def build(self, point: Mapping[str, Any], given: Mapping[str, Any]) -> Any:
        """The object, at these whole numbers and the first value of each axis. given: what a field that is left out may be
        (n, dt). ValueError names the key."""
        values = {name: self._value(one, point, given) for name, one in self.fields.items()}
        for field in dataclasses.fields(self.kind):
            if field.name not in values and _required(field):
                values[field.name] = given[field.name]
        if values.get("alphas") == "binomial":
            default = next((f.default for f in dataclasses.fields(self.kind) if f.name == "q"), 0)
            values["alphas"] = hurwitz.binomial(values["model"].n + values.get("q", default))
        try:
            return self.kind(**values)
        except ValueError as error:
            raise ValueError(self._renamed(str(error))) from error

    def family(self, point: Mapping[str, Any], given: Mapping[str, Any], dtype: Any) -> Any:
        """The object, or the grid of it over its axes, in this precision."""
        made, axes = astype(self.build(point, given), dtype), dict(self.axes())
        try:
            return grid(made, **{leaf: one.values for leaf, one in axes.items()}) if axes else made
        except ValueError as error:
            raise self._of_axis(made, axes, error) from error

    def axes(self) -> Iterator[tuple[str, Several]]:
        """The leaves that vary, by their dotted names."""
        for name, value in self.fields.items():
            if isinstance(value, Several):
                yield name, value
            for i, part in _parts(value):
                yield from ((f"{name}{i}.{leaf}", one) for leaf, one in part.axes())

    def counts(self) -> Iterator[tuple[str, Counts]]:
        """The whole numbers that vary, by their keys."""
        for name, value in self.fields.items():
            if isinstance(value, Counts):
                yield name, value
            for _, part in _parts(value):
                yield from part.counts()

    def _value(self, value: Any, point: Mapping[str, Any], given: Mapping[str, Any]) -> Any:
        if isinstance(value, Part):
            return value.build(point, given)
        if isinstance(value, tuple):
            return tuple(part.build(point, given) if isinstance(part, Part) else part for part in value)
        if isinstance(value, Counts):
            return point[value.where.rpartition(".")[2]]
        return value.values[0] if isinstance(value, Several) else value

    def _renamed(self, message: str) -> str:
        """ "HighGain.gamma: ..." as "config.observer.gamma: ..."."""
        found = re.match(r"(\w+)\.(\w+): ", message)
        if found is None or found[1] != self.kind.__name__:
            return f"config.{self.where}: {message}"
        return f"config.{self.where}.{self.keys.get(found[2], found[2])}: {message[found.end() :]}"

    def _of_axis(self, made: Any, axes: Mapping[str, Several], error: ValueError) -> ValueError:
        """The error of `grid` under the key of the axis that causes it."""
        for leaf, one in axes.items():
            try:
                grid(made, **{leaf: one.values})
            except ValueError as its_own:
                return ValueError(re.sub(r"^[\w.]+: ", f"config.{one.where}: ", str(its_own)))
        return ValueError(f"config.{self.where}: {error}")


@dataclasses.dataclass(frozen=True)
class Reader:
    """Reads parts. numbers, counts: whether a list makes an axis of a number, several builds of a whole number. model: the
    table of the observer's model where the config gives none, or not its name. given: fields that may be left out."""

    numbers: bool = False
    counts: bool = False
    model: Callable[[str, Mapping[str, Any]], dict[str, Any]] | None = None
    given: tuple[str, ...] = ()
    key: str = "name"

    def part(self, base: Any, what: str, table: Any, where: str) -> Part:
        """The part at the key `where`: a subclass of `base`, which is `what` in words. ValueError names the key."""
        table = {self.key: table} if isinstance(table, str) else table
        known = catalogue(base)
        if not isinstance(table, dict) or not isinstance(table.get(self.key), str):
            raise refuse("config", f"{where}.{self.key}", repr(table), f"the name of {what}", f"One of {', '.join(known)}.")
        if "period" in table and plants.Discretised in known.values():
            return self._euler(table, where)
        kind, made = chosen(base, table[self.key], f"{where}.{self.key}")
        fields = {field.name: field for field in dataclasses.fields(kind)}
        more = ["period"] if issubclass(kind, plants.AbstractFlowPlant) else []
        given = {name: value for name, value in table.items() if name != self.key}
        for name in given:
            if name not in fields:
                raise unknown(f"{where}.{name}", name, [*fields, *more])
        if "model" in fields and self.model is not None:
            given["model"] = self.model(f"{where}.model", given.get("model", {}))
        for name, field in fields.items():
            if name not in given and name not in made and name not in self.given and _required(field):
                expected = self._words(field.type)
                raise refuse("config", f"{where}.{name}", "nothing", expected, f"{kind.__name__} has no default for it.")
        return Part(
            kind, where, made | {name: self._field(fields[name], one, f"{where}.{name}") for name, one in given.items()}
        )

    def _euler(self, table: dict[str, Any], where: str) -> Part:
        """period = 0.1 makes the Euler model with that step of the plant."""
        inner = {name: value for name, value in table.items() if name != "period"}
        plant = self.part(plants.AbstractFlowPlant, "a plant", inner, where)
        if type(table["period"]) not in (int, float):
            given = repr(table["period"])
            raise refuse("config", f"{where}.period", given, words(float), "It is the step of the Euler model.")
        fields = {"plant": plant, "integrator": Part(integrators.Euler, where, {}), "dt": float(table["period"])}
        return Part(plants.Discretised, where, fields, {"dt": "period"})

    def _field(self, field: Any, given: Any, where: str) -> Any:
        """One value of a field, by the type that the class says."""
        (kind,) = _kinds(field.type)[:1] or (field.type,)
        if hasattr(kind, "dim_str"):
            return self._numbers(kind.dim_str, given, where)
        if all(inspect.isclass(one) and issubclass(one, Module) for one in _kinds(field.type)):
            return self.part(field.type, f"the {field.name}", given, where)
        if kind is int and self.counts and isinstance(given, list) and given and all(type(one) is int for one in given):
            if len(set(given)) < len(given):
                raise refuse("config", where, repr(given), "each number once", "An axis tells its points apart by them.")
            return Counts(where, given)
        if kind in (int, float, str, bool):
            fits = type(given) in (int, float) if kind is float else type(given) is kind
            if not fits:
                raise refuse("config", where, repr(given), self._words(kind), self._why(kind, given))
            return float(typing.cast("float", given)) if kind is float else given
        inner = typing.get_args(kind)[:1]
        if inner and inspect.isclass(inner[0]) and issubclass(inner[0], Module):
            if not isinstance(given, list):
                raise refuse("config", where, repr(given), "a list of tables", f"Write [[{where}]] and its keys below, twice.")
            return tuple(self.part(inner[0], f"one of the {field.name}", one, f"{where}.{i}") for i, one in enumerate(given))
        raise refuse("config", where, repr(given), "nothing", "It cannot be set in a file: make this study in Python.")

    def _numbers(self, dims: str, given: Any, where: str) -> Any:
        """An array: a number, rows of them; one level deeper, an axis."""
        expected, rank = self._words(dims), len(dims.split())
        if given == "binomial" and where.endswith(".alphas"):
            return given
        if isinstance(given, dict) and rank == 0 and self.numbers:
            return _distinct(read(Range, given, where).several(where))
        depth = _depth(given)
        if depth is not None and (depth <= 2 if dims == "..." else depth == rank):
            return given
        if depth is not None and depth == rank + 1 and dims != "..." and self.numbers and len(given) > 0:
            return _distinct(Several(where, list(given)))
        raise refuse("config", where, repr(given), expected, self._why(float, given))

    def _words(self, kind: Any) -> str:
        """What a field takes."""
        kind = kind if isinstance(kind, str) else (_kinds(kind)[:1] or (kind,))[0]
        dims = kind if isinstance(kind, str) else getattr(kind, "dim_str", None)
        if dims is not None:
            one = "numbers, rows of them in brackets" if dims == "..." else DEPTHS[min(len(dims.split()), 2)]
            return f"{one}, or several of them in a list" if self.numbers and dims == "" else one
        if kind is int and self.counts:
            return f"{words(int)}, or several in a list"
        return words(kind) if kind in (int, float, str, bool) else "a table"

    def _why(self, kind: type, given: Any) -> str:
        if isinstance(given, list) and not (self.counts if kind is int else self.numbers):
            return "It is the same for all runs; axes are numbers of plant, observer, signal, noise and disturbance."
        return "Numbers stand bare, texts in quotes, rows in brackets."


def catalogue(base: Any) -> dict[str, type]:
    """The classes of the package that are a `base` (or one of a union), by their names."""
    kinds = tuple(one for one in _kinds(base) if inspect.isclass(one))
    every = {name: one for module in MODULES for name, one in vars(module).items() if inspect.isclass(one)}
    return {name: one for name, one in every.items() if issubclass(one, kinds) and not name.startswith("Abstract")}


def chosen(base: Any, name: str, where: str) -> tuple[type, dict[str, Any]]:
    """The class of this name that is a `base`; of an object in a file of the user's own, its class and its fields."""
    known = catalogue(base)
    if not own.is_own(name):
        if name not in known:
            raise unknown(where, name, [*known, *(["FILE.py:NAME"] if plants.Pendulum in known.values() else [])])
        return known[name], {}
    found = own.load(name, where)
    kind = found if isinstance(found, type) else type(found)
    if not issubclass(kind, _kinds(base)):
        words = " or ".join(one.__name__ for one in _kinds(base))
        raise refuse("config", where, repr(name), f"a plant of the kind {words}", f"It is a {kind.__name__}.")
    return kind, {} if found is kind else {field.name: getattr(found, field.name) for field in dataclasses.fields(kind)}


def _kinds(kind: Any) -> tuple[Any, ...]:
    """The types of a union, without None."""
    return tuple(one for one in (typing.get_args(kind) if _union(kind) else (kind,)) if one is not type(None))


def _union(kind: Any) -> bool:
    return typing.get_origin(kind) in (typing.Union, type(int | str))


def _parts(value: Any) -> list[tuple[str, Part]]:
    if isinstance(value, Part):
        return [("", value)]
    return [(f".{i}", one) for i, one in enumerate(value) if isinstance(one, Part)] if isinstance(value, tuple) else []


def _required(field: Any) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _depth(given: Any) -> int | None:
    """0 for a number, 1 for a list of them, ...; None for anything else, and for ragged rows."""
    if not isinstance(given, list):
        return 0 if type(given) in (int, float) else None
    depths = {_depth(one) for one in given}
    ragged = len({len(one) for one in given if isinstance(one, list)}) > 1
    return None if None in depths or len(depths) > 1 or ragged else 1 + (depths.pop() or 0 if depths else 0)


def _distinct(several: Several) -> Several:
    if not several.values or any(one in several.values[:i] for i, one in enumerate(several.values)):
        raise refuse(
            "config", several.where, repr(several.values), "values, each once", "An axis tells its points apart by them."
        )
    return several
