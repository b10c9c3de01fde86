"""What does an exported observer cost on a controller, and how far is it from Python? The examples of `jaxobs export` in C99.

Bytes of machine code and of state, the median time of a step (the compiler's optimisations -O2, a loop over the test vectors,
repeated), and the largest distance to the jitted step over 10,000 samples in ulps of full scale. Then the recorded walk: the
row of the table as Python and as C have it, and what rounding to float adds to the estimate at worst.
Run: python benchmarks/export.py
"""

import ctypes
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from jaxobs import astype
from jaxobs.cli.examples import examples
from jaxobs.cli.export_config import export_config
from jaxobs.datasets import shank_walk
from jaxobs.demo.walk import Entry, rate_of, row_of
from jaxobs.export import Straight, Tick, export, straight, ulps, vectors

NAMES = ("tracker", "pendulum", "flexible_joint", "kalman")
SAMPLES = 10_000
ROUNDS, REPEATS = 15, 50


def main() -> int:
    jax.config.update("jax_enable_x64", True)
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        print("export.py: given no C compiler; expected cc or gcc on the PATH", file=sys.stderr)
        return 1
    console, walked = Console(width=140), {}
    table = Table("observer", "precision", "code, bytes", "state, bytes", "ns a step", "ulps from Python", "covered")
    with tempfile.TemporaryDirectory() as folder:
        for name in NAMES:
            for precision in ("float64", "float32"):
                case = export_config(_tables(name), None)
                place = Path(folder) / f"{name}_{precision}"
                made = export(case.observer, place, certificate=case.certificate(), kinds=("c",), **case.options(precision))
                tick = Tick(astype(case.observer, np.dtype(precision)))
                code, compared = straight(tick), vectors(tick, count=SAMPLES)
                run = _Run(compiler, place, name, code)
                found, nanoseconds = run(compared.xhat0, compared.us, compared.ys)
                size, state = run.size, sum(one.itemsize for one in code.dtypes)
                off = f"{ulps(found, compared.xhat):.3g}"
                table.add_row(name, precision, f"{size}", f"{state}", f"{nanoseconds:.1f}", off, str(made.coverage.covered))
                if name == "tracker":
                    walked[precision] = run, case.observer
    console.print(table)
    _walk(console, walked)
    return 0


def _tables(name: str) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(examples("export")[f"export_{name}"])


class _Run:
    """A record through the compiled code: its estimates, and the time of a step."""

    def __init__(self, compiler: str, folder: Path, name: str, code: Straight):
        self.code = code
        source, loop = folder / f"{name}.c", folder / "loop.c"
        inputs = f"u + {code.m} * k, " if code.m else ""
        loop.write_text(f"""#include "{name}.h"
void loop({name}_state *s, const {name}_real *xhat0, const {name}_real *u, const {name}_real *y, {name}_real *xhat, long count)
{{
    (void)u;
    {name}_start(s, xhat0);
    for (long k = 0; k < count; ++k) {name}_update(s, {inputs}y + {code.p} * k, xhat + {code.n} * k);
}}
""")
        library, unit = folder / "loop.so", folder / "unit.o"
        subprocess.run([compiler, "-std=c99", "-O2", "-shared", "-fPIC", source, loop, "-lm", "-o", library], check=True)
        subprocess.run([compiler, "-std=c99", "-O2", "-c", source, "-o", unit], check=True)
        told = subprocess.run(["size", unit], capture_output=True, text=True, check=True).stdout
        self.size = int(re.split(r"\s+", told.splitlines()[1].strip())[0])
        self.loop = ctypes.CDLL(str(library)).loop

    def __call__(self, xhat0: Any, us: Any, ys: Any, timed: bool = True) -> tuple[np.ndarray, float]:
        real, count = self.code.real, len(ys)
        xhat = np.zeros((count, self.code.n), real)
        arrays = [np.ascontiguousarray(one, real) for one in (xhat0, us, ys)]
        state = np.zeros(len(self.code.dtypes) + 2)
        given = [ctypes.c_void_p(one.ctypes.data) for one in (state, *arrays, xhat)]
        times = []
        for _ in range(ROUNDS if timed else 1):
            begin = time.perf_counter()
            for _ in range(REPEATS if timed else 1):
                self.loop(*given, ctypes.c_long(count))
            times.append((time.perf_counter() - begin) / (REPEATS if timed else 1) / count * 1e9)
        return xhat, statistics.median(times)


def _walk(console: Console, walked: dict[str, Any]) -> None:
    """The last quarter of the record, and the difference between the precisions over the whole of it."""
    walk, tracker = shank_walk(), walked["float64"][1]
    entry = Entry("observer", "none", "tracker", "", 1, 0.0, rate_of(tracker))
    table, estimates = Table("the recorded walk", "RMSE [rad/s]", "95 %", "delay [ms]", "noise gain"), {}

    def by_c(run: _Run, angle: np.ndarray) -> np.ndarray:
        return run([angle[0], 0.0], np.zeros((len(angle), 0)), angle[:, None], timed=False)[0].astype(float)

    filters = {"Python": entry.filter}
    for precision, (run, _) in walked.items():
        filters[f"C, {precision}"] = lambda angle, run=run: by_c(run, angle)[:, 1]
        estimates[precision] = by_c(run, walk.angle)
    for name, function in filters.items():
        row = row_of(walk, entry._replace(filter=function), function(walk.angle))
        interval = f"{row.rmse_low:.6f} to {row.rmse_high:.6f}"
        table.add_row(name, f"{row.rmse:.6f}", interval, f"{row.delay_ms:.3f}", f"{row.noise_gain:.4f}")
    console.print(table)
    worst = np.max(np.abs(estimates["float32"] - estimates["float64"]), axis=0)
    console.print(f"Rounding to float on the walk, at worst: {worst[0]:.3g} rad of angle, {worst[1]:.3g} rad/s of rate.")


if __name__ == "__main__":
    sys.exit(main())
