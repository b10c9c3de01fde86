"""Everything that determines the numbers of a study, as JSON: what a store is compared with before it is resumed."""

import dataclasses
import functools
import hashlib
import inspect
import json
import math
import os
import re
import types
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._version import __version__
from jaxobs.studies.axes import PARTS, Group, Seeds
from jaxobs.studies.devices import FLAGS
from jaxobs.studies.family import Family

FORMAT = 1  # of the data set and of the store
SHORT = 16  # longer arrays are written as a hash


def config(groups: tuple[Group, ...], shape_axes: Mapping[str, list[Any]]) -> dict[str, Any]:
    """What is the same for all groups once, then each group with its label. Nothing of how the work is cut or where it runs,
    but versions and platform, whose arithmetic may differ in the last bit."""
    first = groups[0]
    common = {
        "format": FORMAT,
        "jaxobs": __version__,
        "jax": jax.__version__,
        "platform": jax.default_backend(),
        "fuse": FLAGS in os.environ.get("XLA_FLAGS", ""),  # use_all_cores(fuse=True) moves last bits
        "precision": str(first.dtype),
        "random streams": {
            "threefry_partitionable": jax.config.values["jax_threefry_partitionable"],
            "keys": describe(first.world.keys),
        },
        "shape axes": {name: list(values) for name, values in shape_axes.items()},
        "axes": {axis.name: {"of": axis.part, "leaf": axis.leaf, "values": describe(axis.values)} for axis in first.axes},
        "ts": describe(first.ts),
        "hold_innovation": first.hold_innovation,
        "save": first.save,
        "metrics": describe(first.world.metrics),
        "integrator": describe(first.world.integrator),
    }
    each = [
        {"label": dict(group.label)}
        | {part: describe(getattr(group.world, part)) for part in (*PARTS, "x0", "xhat0")}
        for group in groups
    ]  # fmt: skip
    return json.loads(json.dumps(common | {"groups": each}))


def fingerprint(config: Mapping[str, Any]) -> str:
    """SHA-256 of the config: equal for studies with equal numbers."""
    return hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()


def describe(value: Any) -> Any:
    """An object by its class, fields and numbers. Floats keep every digit; long arrays are a hash beside shape and ends."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Seeds):
        return {"class": _name(type(value)), "key": describe(value.key), "count": value.count}
    if isinstance(value, Family):
        member = describe(value.member(*(values[0] for values in value.values)))
        return {"first member": member, "varied": dict(zip(value.names, map(describe, value.values), strict=True))}
    if isinstance(value, jax.Array) and jnp.issubdtype(value.dtype, jax.dtypes.prng_key):
        return {"implementation": str(jax.random.key_impl(value)), "data": describe(np.asarray(jax.random.key_data(value)))}
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return _array(np.asarray(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: describe(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {"class": _name(type(value)), **_own_code(type(value)), **fields}
    if isinstance(value, Mapping):
        return {str(key): describe(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [describe(item) for item in value]
    if isinstance(value, functools.partial):
        return {"partial": describe(value.func), "of": [describe(value.args), describe(value.keywords)]}
    if isinstance(value := inspect.unwrap(value) if callable(value) else value, types.FunctionType):
        cells = [describe(cell.cell_contents) for cell in value.__closure__ or ()]
        return {"function": _name(value), "code": _code(value.__code__), "given": [cells, describe(value.__defaults__)]}
    return _name(value) if hasattr(value, "__qualname__") else re.sub(r" at 0x[0-9a-f]+", "", repr(value))


def spelled(module: Any) -> str:
    """An object as one would type it: RMSE(after=10.0)."""
    fields = ", ".join(f"{field.name}={_short(getattr(module, field.name))}" for field in dataclasses.fields(module))
    return f"{type(module).__name__}({fields})"


def _short(value: Any) -> str:
    if dataclasses.is_dataclass(value):
        return spelled(value)
    return str(np.asarray(value).tolist()) if isinstance(value, jax.Array | np.ndarray) else repr(value)


def _array(array: np.ndarray) -> Any:
    if array.size <= SHORT:
        return describe(array.tolist())
    flat = array.reshape(-1)
    digest = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()
    ends = {"first": describe(flat[0].item()), "last": describe(flat[-1].item())}
    return {"shape": list(array.shape), "dtype": str(array.dtype), **ends, "sha256": digest}


def _own_code(kind: type) -> dict[str, Any]:
    """Of a class that is not of this package, where a version says what it does: a hash of its functions."""
    if kind.__module__.partition(".")[0] == "jaxobs":
        return {}
    codes = {name: _code(one.__code__) for name, one in sorted(_functions(kind).items())}
    return {"code": hashlib.sha256(json.dumps(codes).encode()).hexdigest()}


def _functions(kind: type) -> dict[str, types.FunctionType]:
    """The functions and properties that the class has from its own module, by itself or by inheritance."""
    own = kind.__module__
    inherited = {name: one for base in reversed(kind.__mro__) if base.__module__ == own for name, one in vars(base).items()}
    found = {name: getattr(one, "fget", None) or one for name, one in inherited.items()}
    defined: dict[str, Any] = {name: inspect.unwrap(one) for name, one in found.items() if callable(one)}
    return {name: one for name, one in defined.items() if isinstance(one, types.FunctionType) and one.__module__ == own}


def _name(thing: Any) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"


def _code(code: types.CodeType) -> str:
    """A hash of what a function does, so that an edited one is another one (and so is one of another Python)."""
    parts = [_code(const) if isinstance(const, types.CodeType) else repr(const) for const in code.co_consts]
    return hashlib.sha256(repr((code.co_code, code.co_names, parts)).encode()).hexdigest()
