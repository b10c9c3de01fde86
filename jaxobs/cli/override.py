"""Keys of a config with other values, from the command line."""

import re
import tomllib
from typing import Any


def override(tables: dict[str, Any], settings: tuple[str, ...]) -> dict[str, Any]:
    """The tables with `observer.gamma=[2.0, 4.0]` set: values as in TOML, texts also without quotes."""
    for setting in settings:
        key, sign, text = setting.partition("=")
        if not sign or not key.strip():
            raise _refused(setting, repr(setting), "KEY=VALUE", "For example --set observer.gamma=[2.0,4.0].")
        *path, last = key.strip().split(".")
        place: Any = tables
        for i, name in enumerate(path):
            if isinstance(place, list) and name.isdecimal() and int(name) < len(place):
                place = place[int(name)]
            elif isinstance(place, dict):
                place = place.setdefault(name, {})
            if not (isinstance(place, dict) or (isinstance(place, list) and place and isinstance(place[0], dict))):
                raise _refused(key, repr(place), f"a table at {'.'.join(path[: i + 1])}", "Set that key itself.")
        if not isinstance(place, dict):
            raise _refused(key, "a list of tables", "the number of one", f"Write {'.'.join(path)}.0.{last}=...")
        place[last] = _value(key, text.strip())
    return tables


def replace_plant(tables: dict[str, Any], plant: str | None) -> dict[str, Any]:
    """The tables with another plant, by its name or as FILE.py:NAME, and none of the parameters of the one before."""
    return tables if plant is None else tables | {"plant": {"name": plant}}


def _value(key: str, text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        if re.fullmatch(r"[A-Za-z][\w.-]*", text):
            return text
        fix = "A number, a list in brackets, a text in quotes."
        raise _refused(key, repr(text), "a value as in TOML", fix) from None


def _refused(key: str, given: str, expected: str, fix: str) -> ValueError:
    return ValueError(f"--set {key}: given {given}; expected {expected}. {fix}")
