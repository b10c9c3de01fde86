"""`jaxobs plants` and `jaxobs observers`: what is there, one line each; with a name, all that its class says."""

import dataclasses
import inspect
import json
from typing import Annotated, Any

import tyro

from jaxobs.cli import screen


def plants(
    name: Annotated[str | None, tyro.conf.Positional] = None,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """The plants of the package, one line each; with NAME, its equations, its parameters and the form that is found in it.

    Args:
        name: one of them, or a plant of yours: FILE.py:NAME.
        as_json: print JSON on standard output instead.
    """
    from jaxobs.plants import AbstractPlant

    return _show("plants", AbstractPlant, name, as_json, _plant)


def observers(
    name: Annotated[str | None, tyro.conf.Positional] = None,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """The observers of the package, one line each; with NAME, its equations, and its parameters.

    Args:
        name: one of them.
        as_json: print JSON on standard output instead.
    """
    from jaxobs.observers import Observer

    return _show("observers", Observer, name, as_json, _part)


def _show(what: str, base: Any, name: str | None, as_json: bool, detail: Any) -> int:
    from jaxobs.cli.parts import catalogue, chosen

    console = screen.console(stderr=False)
    if name is None:
        lines = {one: summary(kind) for one, kind in catalogue(base).items()}
        if as_json:
            print(json.dumps(lines, indent=2))
        else:
            screen.print_pairs(console, lines)
            console.print(f"\n`jaxobs {what} NAME` shows one of them.", highlight=False, markup=False)
        return 0
    try:
        kind, made = chosen(base, name, what.removesuffix("s"))
        found = detail(kind, made)
    except ValueError as error:
        return screen.complain(str(error))
    if as_json:
        print(json.dumps(found, indent=2))
        return 0
    console.print(f"[bold]{kind.__name__}[/bold]", highlight=False)
    console.print(found["says"], markup=False, highlight=False, soft_wrap=True)
    if found["parameters"]:
        console.print("\nparameters:", highlight=False)
        screen.print_pairs(console, found["parameters"])
    if "form" in found:
        console.print(f"\n{found['form']}", markup=False, highlight=False, soft_wrap=True)
    return 0


def summary(kind: type) -> str:
    """The first sentence of its docstring, or its first paragraph where that is none, on one line."""
    paragraph = " ".join((inspect.getdoc(kind) or "").split("\n\n")[0].split())
    return paragraph.split(". ")[0].rstrip(".:,")


def _part(kind: type, made: dict[str, Any]) -> dict[str, Any]:
    """What a class says of itself and its fields, with the values that they have where nothing else is given."""
    return {"name": kind.__name__, "says": inspect.getdoc(kind) or "", "parameters": dict(_fields(kind, made))}


def _fields(kind: type, made: dict[str, Any]) -> Any:
    for field in dataclasses.fields(kind):
        declared = getattr(field.type, "__name__", None) or str(field.type)
        shape = getattr(field.type, "dim_str", None)
        words = {"": "a number"}.get(shape, f"numbers ({', '.join(shape.split())})") if shape is not None else declared
        default = made.get(field.name, field.default)
        yield field.name, words if default is dataclasses.MISSING else f"{words}, {_spelled(default)}"


def _spelled(value: Any) -> str:
    return getattr(value, "__name__", None) or " ".join(str(value).split())


def _plant(kind: type, made: dict[str, Any]) -> dict[str, Any]:
    """With the form that its Jacobian's pattern shows, where it can be built without further numbers."""
    from jaxobs.structure import forms

    found = _part(kind, made)
    try:
        plant = kind(**made)
    except (TypeError, ValueError):  # some parameter has no default
        return found
    return found | {"n": plant.n, "m": plant.m, "p": plant.p, "form": str(forms(plant))}
