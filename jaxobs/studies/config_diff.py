"""What differs between two configs, in words."""

import json
import reprlib
from typing import Any

ABSENT = object()


def differences(stored: Any, given: Any, where: str = "") -> list[str]:
    """One line for every key whose values differ: "families.gamma[2]: stored 3.0, given 4.0"; in the order of the given one.

    Values are compared as JSON, so 1 is not 1.0, and NaN is NaN. Lists of different lengths differ as a whole.
    """
    if isinstance(stored, dict) and isinstance(given, dict):
        keys = [*given, *(key for key in stored if key not in given)]
        inner = [(stored.get(key, ABSENT), given.get(key, ABSENT), f"{where}.{key}" if where else key) for key in keys]
    elif isinstance(stored, list) and isinstance(given, list) and len(stored) == len(given):
        inner = [(one, other, f"{where}[{i}]") for i, (one, other) in enumerate(zip(stored, given, strict=True))]
    elif stored is not ABSENT and given is not ABSENT and json.dumps(stored) == json.dumps(given):
        return []
    else:
        return [f"{where or 'the config'}: stored {_short(stored)}, given {_short(given)}"]
    return [line for one, other, place in inner for line in differences(one, other, place)]


def _short(value: Any) -> str:
    if value is ABSENT:
        return "nothing"
    return f"{len(value)} values {reprlib.repr(value)}" if isinstance(value, list) else reprlib.repr(value)
