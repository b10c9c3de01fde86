"""Small stores with numbers of every kind, for the tests of the store; ways to damage them; a disk that fills up."""

import math
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from jaxobs.studies.store import Store

LANES = {"observer": 2, "gamma": 3, "seed": 3}
BLOCK = {"observer": 1, "gamma": 1, "seed": 2}
CONFIG = {"ts": [0.0, 0.1], "observer": {"q": 1, "gamma": [1.0, 2.0, 3.0]}}


def variables(lanes=LANES, dtype=np.float64):
    dims, shape = tuple(lanes), tuple(lanes.values())
    rmse = SimpleNamespace(dims=(*dims, "state"), shape=(*shape, 3), dtype=np.dtype(dtype), attrs={"units": "m"})
    return {"rmse": rmse, "diverged_at": SimpleNamespace(dims=dims, shape=shape, dtype=np.dtype(dtype), attrs={"units": "s"})}


def frame():
    coords = {"observer": ["fast", "steady"], "gamma": ("gamma", [1.0, 2.0, 3.0], {"units": "1/s"})}
    ds = xr.Dataset(coords=coords, attrs={"jaxobs": "0.1", "created": "2026-01-01"})
    return ds.assign_coords(alphas=(("alphas_member", "alphas_component"), np.arange(4.0).reshape(2, 2)))


def make(path: Path, lanes=LANES, block=BLOCK, config=CONFIG, dtype=np.float64):
    ds = frame() if lanes is LANES else xr.Dataset()
    return Store.create(path, ds, variables(lanes, dtype), block, config)


def numbers(lanes=LANES, dtype=np.float64) -> dict[str, np.ndarray]:
    """Every kind of float: random bits are numbers of every size, subnormal ones, NaN of every payload, infinities.

    Of the first chunk every lane has diverged: it is all NaN, as if nothing were there.
    """
    rng, whole = np.random.default_rng(7), {}
    for name, variable in variables(lanes, dtype).items():
        whole[name] = rng.bytes(math.prod(variable.shape) * variable.dtype.itemsize)
        whole[name] = np.frombuffer(whole[name], variable.dtype).reshape(variable.shape).copy()
    whole["rmse"].reshape(-1)[-3:] = [np.nan, -np.inf, -0.0]
    for array in whole.values() if lanes else ():
        array[(*[0] * (len(lanes) - 1), slice(2))] = np.nan
    return whole


def blocks(store: Store, whole: dict[str, np.ndarray], chunk: int) -> dict[str, np.ndarray]:
    return {name: array[(*store.region(chunk).values(), ...)] for name, array in whole.items()}


def fill(store: Store, whole: dict[str, np.ndarray], chunks=None) -> None:
    for chunk in range(len(store)) if chunks is None else chunks:
        store.write(chunk, store.region(chunk), blocks(store, whole, chunk))


def bits(array: np.ndarray) -> bytes:
    return np.ascontiguousarray(array).tobytes()


def files(path: Path) -> dict[str, bytes]:
    return {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}


def truncated(file: Path):
    file.write_bytes(file.read_bytes()[:-3])


def emptied(file: Path):
    file.write_bytes(b"")


def flipped(file: Path):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 4
    file.write_bytes(data)


class Disk:
    """A disk that fills up after so many of the operations by which files are written."""

    def __init__(self, patch: pytest.MonkeyPatch):
        self.operations = self.room = math.inf
        for where, name in ((Path, "open"), (Path, "replace"), (Path, "mkdir"), (Path, "rename"), (os, "fsync")):
            patch.setattr(where, name, self.counted(getattr(where, name), name))

    def full_after(self, room: float) -> None:
        self.operations, self.room = 0, room

    def fail(self, path) -> None:
        raise OSError(28, "No space left on device", str(path))

    def counted(self, act, name):
        def acting(*args, **kwargs):
            mode = kwargs.get("mode", args[1] if len(args) > 1 else "r")
            if name != "open" or "w" in str(mode):
                self.operations += 1
                if self.operations > self.room:
                    self.fail(args[0])
            return act(*args, **kwargs)

        return acting
