"""How much wider than the range are the enclosures of Jacobian entries, and how fast does halving the box cure it?

For every plant and every program of the fuzz suite: a box of a quarter of the domain's side, the width of the enclosure of each
entry of the Jacobian over that of 20,000 sampled values, in the median and in the worst entry, for the box itself and for each
side halved once, twice and three times. Then the time of the pendulum's Jacobian. Run: .venv/bin/python benchmarks/tightness.py
"""

import itertools
import sys
import time
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from jaxobs import intervals
from tests.interval_programs import FURTHER, Program, of_plant, plant_names

SAMPLES, LEVELS, MOST_BOXES = 20_000, (0, 1, 2, 3), 5_000


def box_of(program: Program, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    side = (program.high - program.low) / 4
    lower = np.random.default_rng(seed).uniform(program.low, program.high - side, program.n)
    return lower, lower + side


def halved(lower: np.ndarray, upper: np.ndarray, level: int) -> intervals.Interval:
    """Every side in 2^level parts."""
    edges = np.linspace(lower, upper, 2**level + 1)  # the parts share their edges, so that they cover the box
    parts = np.array(list(itertools.product(range(2**level), repeat=len(lower))))
    columns = np.arange(len(lower))
    return intervals.Interval(edges[parts, columns], edges[parts + 1, columns])


def ratios(program: Program) -> list[np.ndarray | None]:
    """At each level, width of the enclosure / width of the sampled range, for the entries that vary."""
    lower, upper = box_of(program)
    jacobian = jax.vmap(jax.jacfwd(program.f))
    share = np.random.default_rng(1).random((SAMPLES, program.n))
    sampled = np.asarray(jax.jit(jacobian)(lower + share * (upper - lower)))
    least, greatest = sampled.min(0), sampled.max(0)
    varies = greatest - least > 1e-9
    found: list[np.ndarray | None] = []
    for level in LEVELS:
        if 2 ** (level * program.n) > MOST_BOXES:
            found.append(None)
            continue
        enclosure = intervals.bound(jacobian, halved(lower, upper, level))
        width = enclosure.upper.max(0) - enclosure.lower.min(0)
        found.append(width[varies] / (greatest - least)[varies])
    return found


def table(names: list[str]) -> list[tuple[str, int, list[tuple[float, float] | None]]]:
    """(name, number of entries that vary, (median, worst) at each level)."""
    rows = []
    for name in names:
        each = ratios(FURTHER[name] if name in FURTHER else of_plant(name))
        count = 0 if each[0] is None else each[0].size
        if count:
            rows.append((name, count, [None if r is None else (float(np.median(r)), float(r.max())) for r in each]))
    return rows


def nanoseconds_per_box(boxes: int = 1000, repeats: int = 10) -> tuple[float, float]:
    """CPU time of the pendulum's Jacobian on fresh boxes, and on the same ones again, whose endpoint values are remembered."""
    program, rng = of_plant("Pendulum"), np.random.default_rng(2)
    jacobian = jax.vmap(jax.jacfwd(program.f))
    lower = rng.normal(size=(repeats, boxes, program.n))
    batches = [intervals.Interval(part, part + 0.1) for part in lower]
    enclose = intervals.trace(jacobian, batches[0])
    seconds = []
    for _ in range(2):
        start = time.process_time()
        for batch in batches:
            enclose(batch)
        seconds.append(time.process_time() - start)
    return seconds[0] / (boxes * repeats) * 1e9, seconds[1] / (boxes * repeats) * 1e9


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    print("width of the enclosure / sampled width: median (worst) over the entries of the Jacobian that vary")
    print(f"{'':16} {'entries':>7}" + "".join(f"{'box' if level == 0 else f'1/{2**level}':>18}" for level in LEVELS))
    rows = table([*plant_names(), *FURTHER])
    for name, count, each in rows:
        print(f"{name:16} {count:7}" + "".join(f"{'-':>18}" if r is None else f"{r[0]:8.2f} ({r[1]:7.2f})" for r in each))
    for i, level in enumerate(LEVELS):
        medians = [each[i][0] for _, _, each in rows if each[i] is not None]
        print(f"sides / {2**level}: median of medians {np.median(medians):.3f} over {len(medians)} programs")
    print("pendulum's Jacobian: {:.0f} ns a box, {:.0f} ns with remembered endpoints".format(*nanoseconds_per_box()))


if __name__ == "__main__":
    main()
