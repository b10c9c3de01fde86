"""The state of a runner as JSON: every float exact, under one hash, with the observer that it belongs to."""

import hashlib
import json
import re
from os import PathLike
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxobs._version import __version__

FORMAT = "jaxobs-runner/1"


def arrays(tree: Any) -> list[dict[str, Any]]:
    """The leaves of a tree, in order."""
    return [_leaf(np.asarray(one)) for one in jax.tree.leaves(tree)]


def _leaf(array: np.ndarray) -> dict[str, Any]:
    floats = array.dtype.kind == "f"
    values = [float(one).hex() if floats else int(one) for one in array.reshape(-1)]
    return {"dtype": array.dtype.name, "shape": list(array.shape), "values": values}


def tree(path: Any, like: Any, stored: list[dict[str, Any]]) -> Any:
    """The stored leaves in the structure of `like`, whose leaves say their types and shapes."""
    leaves, structure = jax.tree.flatten(like)
    if len(leaves) != len(stored):
        raise ValueError(f"{path}: given {len(stored)} arrays of state; expected {len(leaves)} for this observer")
    found = []
    for leaf, one in zip(leaves, stored, strict=True):
        has, wants = (one["dtype"], tuple(one["shape"])), (np.asarray(leaf).dtype.name, np.shape(leaf))
        if has != wants:
            raise ValueError(f"{path}: given an array of state {has}; expected {wants} for this observer")
        values = [float.fromhex(v) if isinstance(v, str) else v for v in one["values"]]
        made = np.array(values, one["dtype"]).reshape(one["shape"])
        found.append(made[()] if isinstance(leaf, np.generic) else made)
    return jax.tree.unflatten(structure, found)


def write(path: str | PathLike[str], kind: str, observer: Any, settings: dict[str, Any], state: dict[str, Any]) -> None:
    """One file, or the file that was there before: never half of one."""
    body = {"format": FORMAT, "jaxobs": __version__, "runner": kind, "observer": _identity(observer)}
    body |= {"settings": settings, "state": state}
    target = Path(path)
    partial = target.with_name(f"{target.name}.partial")
    partial.write_text(json.dumps(body | {"sha256": _digest(body)}, indent=1) + "\n", encoding="utf-8")
    partial.replace(target)


def read(path: str | PathLike[str], kind: str) -> dict[str, Any]:
    """What a file says. ValueError if it is none of ours, of another format or kind, or damaged."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: given text that is not JSON ({error}); expected a {FORMAT} file") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        given = repr(data.get("format")) if isinstance(data, dict) else "no table"
        raise ValueError(f"{path}: given the format {given}; expected {FORMAT!r}, as Runner.save of this version writes it")
    body = {name: value for name, value in data.items() if name != "sha256"}
    if data.get("sha256") != _digest(body):
        raise ValueError(f"{path}: given contents that do not match their SHA-256; expected an undamaged file")
    if data["runner"] != kind:
        raise ValueError(
            f"{path}: given the state of a {data['runner']}; expected that of a {kind}. Restore it with that class"
        )
    return body


def require_same(path: Any, observer: Any, stored: dict[str, Any]) -> None:
    """ValueError that names what differs between this observer and the one whose state is stored."""
    own = _identity(observer)
    where = f"{path}: the state is of another observer"
    if own["class"] != stored["class"]:
        raise ValueError(f"{where}: given {own['class']}; expected {stored['class']}")
    for name, leaf in own["leaves"].items():
        before = stored["leaves"].get(name)
        if before != leaf:
            given, expected = (_shown(one) for one in (leaf, before))
            raise ValueError(f"{where}: given {name.lstrip('.')} = {given}; expected {expected}")
    if own["structure"] != stored["structure"]:
        raise ValueError(f"{where}: given {own['structure']}; expected {stored['structure']}")


def _identity(observer: Any) -> dict[str, Any]:
    leaves, structure = jax.tree_util.tree_flatten_with_path(observer)
    kind = type(observer)
    return {
        "class": f"{kind.__module__}.{kind.__qualname__}",
        "structure": re.sub(r" at 0x[0-9a-fA-F]+", "", str(structure)),  # where a function lies changes with the process
        "leaves": {jax.tree_util.keystr(place): _leaf(np.asarray(one)) for place, one in leaves},
    }


def _shown(leaf: dict[str, Any] | None) -> str:
    if leaf is None:
        return "nothing"
    values = [float.fromhex(v) if isinstance(v, str) else v for v in leaf["values"]]
    return f"{np.array(values, leaf['dtype']).reshape(leaf['shape']).tolist()} ({leaf['dtype']})"


def _digest(body: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
