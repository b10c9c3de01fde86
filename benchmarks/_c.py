"""The C reference: compiled when a compiler is there, loaded through ctypes, and shown to be vectorised.

`build(folder, precision, variant)` gives the shared library, `Reference(path)` its functions. Variants: "vector" is the
reference, "libm" takes the C library's vector sin and cos (glibc's libmvec), "scalar" is the same source without vectors.
"""

import ctypes
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

SOURCES = Path(__file__).parent / "reference"
WORKLOADS = ("pendulum", "chain", "tracker")
DTYPES = {"float32": np.float32, "float64": np.float64}
FLAGS = ("-std=gnu11", "-O3", "-fopenmp", "-fPIC", "-shared", "-Wall", "-Wextra", "-Werror")
NUMERICS = ("-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")  # -ffast-math would undo the rounding trick of sin
WIDE = ("-mprefer-vector-width=512", "-fschedule-insns")  # GCC takes half the width on its own; stages are scheduled as a whole
VARIANTS = {
    "vector": WIDE,
    "libm": (*WIDE, "-DLIBM"),
    "scalar": ("-DSCALAR", "-fno-tree-vectorize", "-fno-tree-slp-vectorize"),
}


class NoCompiler(Exception):
    """There is no C compiler with OpenMP here, or it refuses the source; the message says which."""


def build(folder: Path, precision: str, variant: str = "vector", workload: str = "pendulum", march: str = "native") -> Path:
    """The shared library of one workload, compiled into `folder` for the processor `march`."""
    compiler = os.environ.get("CC") or next(filter(shutil.which, ("gcc", "cc")), None)
    if compiler is None or shutil.which(compiler.split()[0]) is None:
        raise NoCompiler(f"no C compiler on the path ({compiler or 'gcc, cc'}): install gcc, or name one in CC")
    path = folder / f"{workload}-{precision}-{variant}.so"
    double = ("-DDOUBLE",) if precision == "float64" else ()
    libraries = ("-lmvec", "-lm") if variant == "libm" else ("-lm",)
    command = [*compiler.split(), f"-march={march}", *FLAGS, *NUMERICS, *VARIANTS[variant], *double]
    made = subprocess.run(
        [*command, str(SOURCES / f"{workload}.c"), "-o", str(path), *libraries], capture_output=True, text=True, check=False
    )
    if made.returncode:
        raise NoCompiler(f"{' '.join(command)} failed:\n{made.stderr[:2000]}")
    return path


class Hot(NamedTuple):
    """What the disassembly of the step shows: widest register, packed and scalar multiplications, calls of sin and cos."""

    register: str
    packed: int
    scalar: int
    calls: tuple[str, ...]

    def vectorised(self, precision: str, variant: str, trigonometric: int) -> bool:
        """No scalar arithmetic to speak of, and `trigonometric` pairs of sin and cos on vectors: calls of vector functions, or
        the multiplications of as many polynomials."""
        if any(not call.startswith("_ZGV") for call in self.calls) or self.scalar > 8:  # h / 6 and the like, once a step
            return False
        terms = {"float32": 9, "float64": 16}[precision]  # multiplications in the two polynomials
        own = self.packed >= terms * trigonometric and not self.calls
        return own if variant != "libm" else len(self.calls) >= 2 * trigonometric


def disassembled(path: Path) -> dict[int, str]:
    """{offset: operation} of every instruction, by objdump."""
    text = subprocess.run(["objdump", "-d", "--no-show-raw-insn", str(path)], capture_output=True, text=True, check=True).stdout
    return {int(found[1], 16): found[2] for found in re.finditer(r"^\s+([0-9a-f]+):\s+(\S+)", text, re.MULTILINE)}


def inspect(path: Path, function: str = "step") -> Hot | None:
    """The disassembly of `function`, by objdump; None where there is none."""
    if shutil.which("objdump") is None:
        return None
    text = subprocess.run(["objdump", "-d", "--no-show-raw-insn", str(path)], capture_output=True, text=True, check=True).stdout
    body = "\n".join(part for part in text.split("\n\n") if re.match(rf"\s*[0-9a-f]+ <{function}(\.\w+)*>:", part))
    multiply = r"\bv(?:mul|fn?m(?:add|sub)\d+)"
    packed = re.findall(multiply + r"p[sd]\s.*?%(zmm|ymm|xmm)\d+\b", body)
    calls = re.findall(r"call\s+[0-9a-f]+ <(\w*(?:sin|cos)\w*)", body)
    widest = next((r for r in ("zmm", "ymm", "xmm") if r in packed), "none")
    return Hot(widest, len(packed), len(re.findall(multiply + r"s[sd]\s", body)), tuple(calls))


def _array(dtype: Any) -> Any:
    return np.ctypeslib.ndpointer(dtype, flags="C_CONTIGUOUS")


class Reference:
    """The functions of one shared library; arrays in its precision, one row for each state."""

    def __init__(self, path: Path, precision: str):
        self.dtype = DTYPES[precision]
        self.library = ctypes.CDLL(str(path))
        self.real = _array(self.dtype)

    def _call(self, name: str, types: Sequence[Any], *values: Any) -> None:
        function = getattr(self.library, name)
        function.argtypes, function.restype = types, None
        function(*values)

    def pendulum(self, *, gamma, alphas, start, dt, samples, first, sigma, seed):
        """(rmse (2, lanes), final (4, lanes)) after `samples` steps; the error counts from sample `first` on."""
        lanes = len(gamma)
        rmse, final = np.empty((2, lanes), self.dtype), np.empty((4, lanes), self.dtype)
        us = (0.5 * np.sin(dt / 2 * np.arange(2 * samples + 1))).astype(self.dtype)
        size, number, real = ctypes.c_long, ctypes.c_double, self.real
        types = (size, size, size, number, real, real, real, real, number, ctypes.c_uint64, real, real)
        alphas, start, gamma = (np.ascontiguousarray(a, self.dtype) for a in (alphas, start, gamma))
        self._call("pendulum", types, lanes, samples, first, dt, us, alphas, start, gamma, sigma, seed, rmse, final)
        return rmse, final

    def chain(self, *, gamma, alphas, start, dt, samples, first, substeps, sigma, seed):
        """rmse (5, lanes), RK4 with `substeps` in a sampling period."""
        rmse = np.empty((5, len(gamma)), self.dtype)
        size, number, real = ctypes.c_long, ctypes.c_double, self.real
        types = (size, size, size, number, size, real, real, real, number, ctypes.c_uint64, real)
        alphas, start, gamma = (np.ascontiguousarray(a, self.dtype) for a in (alphas, start, gamma))
        self._call("chain", types, len(gamma), samples, first, dt, substeps, alphas, start, gamma, sigma, seed, rmse)
        return rmse

    def tracker(self, *, mu, start, dt, samples, first, sigma, seed):
        """rmse (3, lanes)"""
        rmse = np.empty((3, len(mu)), self.dtype)
        size, number, real = ctypes.c_long, ctypes.c_double, self.real
        types = (size, size, size, number, real, real, number, ctypes.c_uint64, real)
        start, mu = (np.ascontiguousarray(a, self.dtype) for a in (start, mu))
        self._call("tracker", types, len(mu), samples, first, dt, start, mu, sigma, seed, rmse)
        return rmse

    def words(self, counter: tuple[int, int], key: tuple[int, int]) -> tuple[int, int]:
        out = np.empty(2, np.uint32)
        self._call("random_words", (ctypes.c_uint32,) * 4 + (_array(np.uint32),), *counter, *key, out)
        return int(out[0]), int(out[1])

    def normals(self, blocks: int, seed: int) -> np.ndarray:
        """(blocks, 2, lanes of a block)"""
        out = np.empty((blocks, 2, ctypes.c_int.in_dll(self.library, "block_lanes").value), self.dtype)
        self._call("random_normals", (ctypes.c_long, ctypes.c_uint64, self.real), blocks, seed, out)
        return out

    def functions(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """sin, cos and log of x, as the reference computes them."""
        x = np.ascontiguousarray(x, self.dtype)
        sines, cosines, logarithms = (np.empty_like(x) for _ in range(3))
        self._call("functions", (ctypes.c_long, *(self.real,) * 4), len(x), x, sines, cosines, logarithms)
        return sines, cosines, logarithms
