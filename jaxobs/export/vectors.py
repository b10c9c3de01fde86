"""Test vectors: what goes in and what the Python step makes of it; and a C program that compares."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import dtype_of, refuse
from jaxobs.export.tick import Tick

LOST = 17  # every so many samples one is lost


class Vectors(NamedTuple):
    """The first guess (n,), inputs (T, m), measurements (T, p) with NaN where lost, and the estimates of Python, (T, n)."""

    xhat0: np.ndarray
    us: np.ndarray
    ys: np.ndarray
    xhat: np.ndarray


def vectors(tick: Tick, *, count: int, xhat0: Any = None, ys: Any = None, us: Any = None, seed: int = 0) -> Vectors:
    """The jitted step over `count` samples of a record, or of small random numbers, every seventeenth lost.

    ValueError for records of another shape.
    """
    observer, dtype = tick.observer, np.dtype(dtype_of(tick.observer))
    rng = np.random.default_rng(seed)
    if ys is None:
        ys = 0.3 * rng.normal(size=(count, observer.p))
        ys[LOST - 1 :: LOST, 0] = np.nan
    us = 0.3 * rng.normal(size=(len(ys), observer.m)) if us is None else us
    ys, us = (_rows(name, one, width, dtype)[:count] for name, one, width in (("ys", ys, observer.p), ("us", us, observer.m)))
    if len(us) != len(ys):
        raise refuse("export", "us", f"{len(us)} rows", f"{len(ys)}, one for each of ys", "Cut both to the same samples.")
    start = np.zeros(observer.n, dtype) if xhat0 is None else np.asarray(xhat0, dtype)
    if start.shape != (observer.n,):
        raise refuse("export", "xhat0", f"shape {start.shape}", f"({observer.n},)", "Give one number for each state.")

    @jax.jit
    def run(start: Any, us: Any, ys: Any) -> Any:
        def body(state: Any, sample: Any) -> Any:
            return tick(sample[0], state, *sample[1:])

        return jax.lax.scan(body, tick.start(start), (jnp.arange(len(ys), dtype=jnp.int32), us, ys))[1]

    return Vectors(start, us, ys, np.asarray(run(start, us, ys)))


def _rows(name: str, given: Any, width: int, dtype: np.dtype) -> np.ndarray:
    rows = np.asarray(given, dtype)
    rows = rows[:, None] if rows.ndim == 1 and width == 1 else rows
    if rows.ndim != 2 or rows.shape[1] != width:
        raise refuse("export", name, f"shape {np.shape(given)}", f"(T, {width})", "One row for each sample.")
    return rows


def ulps(found: np.ndarray, expected: np.ndarray) -> float:
    """The largest distance, in units in the last place of the largest number of each column; infinite if one is not finite."""
    if not (np.all(np.isfinite(found)) and np.all(np.isfinite(expected))):
        return 0.0 if np.array_equal(found, expected, equal_nan=True) else float("inf")
    scale = np.spacing(np.max(np.abs(expected), axis=0, initial=0).astype(expected.dtype))
    return float(np.max(np.abs(found.astype(float) - expected.astype(float)) / scale.astype(float), initial=0))


def csv_text(vectors: Vectors) -> str:
    """One row a sample: u, y, xhat, in digits that are read back exactly; before them the first guess."""
    digits = 9 if vectors.xhat.dtype == np.float32 else 17
    rows = [vectors.xhat0, *(np.concatenate(row) for row in zip(vectors.us, vectors.ys, vectors.xhat, strict=True))]
    return "\n".join(",".join(f"{x:.{digits}g}" for x in row) for row in rows) + "\n"


def test_program(name: str, n: int, m: int, p: int, largest: float, scale: np.ndarray) -> str:
    """A C program that reads the vectors from standard input: exit code 0 if all estimates are within `largest` ulps.

    scale (n,): the unit in the last place of each state.
    """
    width, inputs = m + p + n, "row, " if m else ""
    units = ", ".join(f"{float(x):.9g}" for x in scale)
    return f"""/* Compares {name}.c with its test vectors: cc {name}.c {name}_test.c -lm && ./a.out < {name}_vectors.csv */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "{name}.h"

static int read_row({name}_real *row, int count)
{{
    char text[{32 * max(width, n)}];
    if (!fgets(text, sizeof text, stdin)) return 0;
    char *at = text;
    for (int i = 0; i < count; ++i) {{
        row[i] = ({name}_real)strtod(at, &at);
        ++at; /* the comma */
    }}
    return 1;
}}

int main(void)
{{
    static const double unit[{n}] = {{ {units} }}; /* in the last place, of the largest number of each state */
    {name}_real row[{width}], xhat[{n}];
    {name}_state state;
    double worst = 0;
    long count = 0;
    if (!read_row(row, {n})) return 2;
    {name}_start(&state, row);
    for (; read_row(row, {width}); ++count) {{
        {name}_update(&state, {inputs}row + {m}, xhat);
        for (int i = 0; i < {n}; ++i) {{
            const double off = fabs((double)xhat[i] - (double)row[{m + p} + i]) / unit[i];
            if (!(off <= worst)) worst = off;
        }}
    }}
    printf("%ld samples, within %.3g ulps of the estimates of Python\\n", count, worst);
    return count > 0 && worst <= {largest:.9g} ? 0 : 1;
}}
"""
