"""Exported C, compiled and run: what the tests of `jaxobs.export` share."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np

from jaxobs.export.straight import Straight

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2")


def compiler() -> str:
    """The C compiler; without one the tests fail, they are not skipped."""
    found = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    assert found, "exported C is tested with a C compiler: install one, e.g. gcc"
    return found


def compiled(folder: Path, name: str, *flags: str, program: bool = False) -> Path:
    """The shared library of NAME.c, or the program that compares it with its vectors."""
    out = folder / (f"{name}_test" if program else f"{name}.so")
    sources = [folder / f"{name}.c", *([folder / f"{name}_test.c"] if program else [])]
    kind = [] if program else ["-shared", "-fPIC"]
    made = subprocess.run([compiler(), *(flags or STRICT), *kind, "-o", out, *sources, "-lm"], capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return out


class Compiled:
    """The functions of an exported C file: xhat = update(u, y)."""

    def __init__(self, folder: Path, name: str, code: Straight, *flags: str):
        library = ctypes.CDLL(str(compiled(folder, name, *flags)))
        self._start, self._update = getattr(library, f"{name}_start"), getattr(library, f"{name}_update")
        self._start.restype = self._update.restype = None
        self._real, self._sizes = code.real, (code.n, code.m, code.p)
        self._state = np.zeros(len(code.dtypes) + 2, np.float64)  # as large as the struct, at least

    def start(self, xhat0) -> None:
        self._start(_pointer(self._state), _pointer(np.asarray(xhat0, self._real)))

    def update(self, u, y) -> np.ndarray:
        n, m, _ = self._sizes
        xhat = np.zeros(n, self._real)
        arrays = [np.ascontiguousarray(one, self._real) for one in ([u, y] if m else [y])]
        self._update(_pointer(self._state), *map(_pointer, arrays), _pointer(xhat))
        return xhat


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
