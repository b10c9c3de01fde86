"""Tables of a TOML file into dataclasses: every complaint names the key, what was given and what is expected."""

import dataclasses
import difflib
import types
import typing
from typing import Any, TypeVar

import numpy as np

from jaxobs._module import refuse

Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]
Integers = tuple[int, ...]
T = TypeVar("T")

WORDS = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a text in quotes",
    Vector: "a list of numbers",
    Integers: "a list of whole numbers",
    Matrix: "a list of rows of numbers, all of one length",
}


def read(kind: type[T], table: Any, where: str) -> T:
    """The dataclass `kind` from a TOML table found at the key `where`. ValueError for keys that it has not, that are missing,
    or whose values have another type."""
    if not isinstance(table, dict):
        raise refuse("config", where, repr(table), "a table", f"Write [{where}] and its keys below.")
    hints = typing.get_type_hints(kind)
    fields = {field.name: field for field in dataclasses.fields(kind)}  # pyright: ignore[reportArgumentType]
    for name in table:
        if name not in fields:
            raise unknown(f"{where}.{name}", name, list(fields))
    for name, field in fields.items():
        if name not in table and field.default is dataclasses.MISSING:
            expected = words(hints[name])
            raise refuse("config", f"{where}.{name}", "nothing", expected, f"Add {name} = ... to [{where}].")
    return kind(**{name: value(hints[name], given, f"{where}.{name}") for name, given in table.items()})


def unknown(where: str, name: str, known: list[str]) -> ValueError:
    """The message for a name that is none of the known ones."""
    near = difflib.get_close_matches(name, known, 1, 0.5)
    return refuse("config", where, repr(name), f"one of {', '.join(known)}", f"Did you mean {near[0]!r}?" if near else "")


def value(kind: Any, given: Any, where: str) -> Any:
    """One value of a field of this type."""
    options = typing.get_args(kind) if typing.get_origin(kind) in (typing.Union, types.UnionType) else (kind,)
    kind = next(option for option in options if option is not types.NoneType)
    if dataclasses.is_dataclass(kind):
        return read(kind, given, where)  # pyright: ignore[reportArgumentType]
    if typing.get_origin(kind) is typing.Literal:
        if given not in typing.get_args(kind):
            raise unknown(where, str(given), [str(option) for option in typing.get_args(kind)])
        return given
    read_value = _plain(kind, given)
    if read_value is None:
        raise refuse("config", where, repr(given), words(kind), "Numbers stand bare, texts in quotes, rows in brackets.")
    return read_value


def words(kind: Any) -> str:
    """What a field of this type takes."""
    options = [option for option in typing.get_args(kind) or () if option is not types.NoneType]
    if kind in WORDS:
        return WORDS[kind]
    if typing.get_origin(kind) is typing.Literal:
        return f"one of {', '.join(map(str, options))}"
    return words(options[0]) if options else "a table"


def _plain(kind: Any, given: Any) -> Any:
    """The value, or None if it is of another type."""
    if kind in (bool, str):
        return given if type(given) is kind else None
    if kind is int:
        return given if type(given) is int else None
    if kind is float:
        return float(given) if type(given) in (int, float) else None
    entry = typing.get_args(kind)[0]
    if not isinstance(given, list):
        return None
    found = tuple(_plain(entry, one) for one in given)
    ragged = kind == Matrix and None not in found and len({len(row) for row in found}) > 1
    return None if None in found or ragged else found


def options(method: Any, *without: str) -> dict[str, Any]:
    """The fields that were given, for the design's function; rows of numbers as arrays."""
    fields = (field.name for field in dataclasses.fields(method) if field.name not in without)
    given = {name: getattr(method, name) for name in fields}
    rows = {name: np.array(x) for name, x in given.items() if isinstance(x, tuple) and x and isinstance(x[0], tuple)}
    return {name: x for name, x in (given | rows).items() if x is not None}
