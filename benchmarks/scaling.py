"""A scaling model of studies: its terms measured on small runs here, its prediction checked on a large one, then 1e9 lanes.

    seconds = k + call + (lanes x steps x c + lanes x l + chunks x o + bytes / b) / workers

c: a step of a lane. l: a lane, however long it runs. o: a chunk, computed and stored. b: bandwidth of writing the results.
call: one call of study() that finds its loop compiled. k: compiling the loop. The study: pendulum, high-gain observer, RK4,
float32, measurement noise, the RMSE of both states. A worker is this machine with all its cores. Workers share nothing but
the store, so that they enter as a divisor; the model leaves out a file system that slows down under many of them, and the end
of a study, where some have no chunk left.

Run: .venv/bin/python benchmarks/scaling.py [seconds of the run that checks it, 45]
"""

import math
import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

import jax
import numpy as np
import xarray as xr
from scipy.optimize import nnls

import jaxobs
from jaxobs.studies.outputs import Variable
from jaxobs.studies.plan import LANE_STEPS, LANES, block_of
from jaxobs.studies.store import Store

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 45.0
GAMMAS = np.geomspace(4, 20, 64)
# (lanes, steps, lanes of a chunk), each stored. Every term weighs in some of them.
RUNS = [(4096, 50, 4096), (32_768, 50, 32_768), (32_768, 50, 2048), (4096, 1000, 4096), (65_536, 1000, 65_536)]
REPEATS = 5
BYTES = 12  # of a lane: two states of rmse, diverged_at, float32
GOAL = (10**9, 10**4)
WORKERS = (1, 10, 100, 1000)


def run(folder: Path, lanes: int, steps: int, chunk: int) -> float:
    """Seconds of one stored study."""
    plant, where = jaxobs.plants.Pendulum(), folder / "study"
    observer = jaxobs.observers.HighGain(plant, [3.0, 2.0], 6.0)
    begun = time.perf_counter()
    jaxobs.study(
        plant, jaxobs.grid(observer, gamma=GAMMAS), keys=jaxobs.Seeds(jax.random.key(0), lanes // len(GAMMAS)),
        x0=[1.0, 0.0], xhat0=[0.0, 0.0], ts=np.arange(steps) * 0.01, signal=jaxobs.signals.Sine(0.5), chunk=chunk,
        noise=jaxobs.noise.Gaussian(0.1), metrics={"rmse": jaxobs.metrics.RMSE(steps * 0.005)}, store=where,
    )  # fmt: skip
    seconds = time.perf_counter() - begun
    shutil.rmtree(where)
    return seconds


def bandwidth(folder: Path, lanes: int = 2**21) -> float:
    """Bytes per second into the store, in chunks so large that nothing else counts."""
    variables = {
        "rmse": Variable(("seed", "state"), (4 * lanes, 2), np.dtype(np.float32), {}),
        "diverged_at": Variable(("seed",), (4 * lanes,), np.dtype(np.float32), {}),
    }
    store = Store.create(folder / "bandwidth", xr.Dataset(), variables, {"seed": lanes}, {})
    rmse = np.abs(np.random.default_rng(0).normal(0.1, 0.01, (lanes, 2))).astype(np.float32)
    seconds = []
    for chunk in range(4):
        begun = time.perf_counter()
        store.write(chunk, store.region(chunk), {"rmse": rmse, "diverged_at": np.full(lanes, np.inf, np.float32)})
        seconds.append(time.perf_counter() - begun)
    return BYTES * lanes / statistics.median(seconds)


def chunks_of(lanes: int, chunk: int) -> int:
    shape = (len(GAMMAS), lanes // len(GAMMAS))
    return math.prod(math.ceil(size / part) for size, part in zip(shape, block_of(shape, chunk), strict=True))


def default_chunk(steps: int) -> int:
    return max(LANES, LANE_STEPS // steps)


def columns(lanes: int, steps: int, chunk: int) -> np.ndarray:
    """What c, l, o and call are multiplied with."""
    return np.array([lanes * steps, lanes, chunks_of(lanes, chunk), 1.0])


def fit(folder: Path, bytes_per_second: float) -> tuple[np.ndarray, float]:
    """(c, l, o, call), none below 0, by least squares of relative errors; k."""
    compiled = [run(folder, *size) for size in RUNS]
    rounds = np.array([[run(folder, *size) for size in RUNS] for _ in range(REPEATS)])
    times = np.median(rounds, axis=0)
    writing = np.array([BYTES * lanes for lanes, _, _ in RUNS]) / bytes_per_second
    rows = np.array([columns(*size) for size in RUNS])
    scale = rows.max(axis=0)
    terms = nnls(rows / scale / times[:, None], (times - writing) / times)[0] / scale
    print(f"{'lanes':>8} {'steps':>6} {'chunks':>6} {'seconds':>8} {'spread':>7} {'model':>8}")
    for size, all_times, row, write in zip(RUNS, rounds.T, rows, writing, strict=True):
        measured, spread = np.median(all_times), np.ptp(all_times) / np.median(all_times)
        print(f"{size[0]:>8} {size[1]:>6} {row[2]:>6.0f} {measured:>8.3f} {spread:>7.0%} {row @ terms + write:>8.3f}")
    return terms, float(np.median(np.array(compiled) - times))


def main() -> None:
    cores = jaxobs.use_all_cores(fuse=True)
    jax.config.update("jax_enable_compilation_cache", False)  # k is that of a machine that has compiled nothing yet
    folder = Path(tempfile.mkdtemp(prefix="scaling-benchmark-"))
    try:
        print(f"{cores} cores, load {os.getloadavg()[0]:.1f} at the start, {REPEATS} rounds, medians")
        b = bandwidth(folder)
        terms, k = fit(folder, b)
        c, each, o, call = terms
        print(f"c = {c * 1e9:.3f} ns, l = {each * 1e9:.0f} ns, o = {o * 1e3:.1f} ms, b = {b / 1e6:.0f} MB/s, ", end="")
        print(f"call = {call:.3f} s, k = {k:.1f} s")

        def predicted(lanes: int, steps: int, workers: int = 1) -> float:
            work = columns(lanes, steps, default_chunk(steps))[:3] @ terms[:3] + BYTES * lanes / b
            return work / workers + call + k

        steps = 2000  # unlike those above
        per_lane = (predicted(2**20, steps) - call - k) / 2**20
        lanes = max(1, round((SECONDS - call - k) / per_lane / len(GAMMAS))) * len(GAMMAS)
        expected, measured = predicted(lanes, steps), run(folder, lanes, steps, default_chunk(steps))
        print(f"check, {lanes:,} lanes x {steps:,} steps (largest above {RUNS[-1][0]:,} x {RUNS[-1][1]:,}): ", end="")
        print(f"predicted {expected:.1f} s, measured {measured:.1f} s, error {expected / measured - 1:+.0%}, ", end="")
        print(f"load {os.getloadavg()[0]:.1f}")
        lanes, steps = GOAL
        chunks = chunks_of(lanes, default_chunk(steps))
        print(f"{lanes:.0e} lanes x {steps:.0e} steps, {chunks:,} chunks, {BYTES * lanes / 1e9:.0f} GB uncompressed:")
        overhead = chunks * o + BYTES * lanes / b
        for workers in WORKERS:
            total = predicted(*GOAL, workers)
            share = (overhead / workers + call + k) / total
            print(f"{workers:>6} workers: {total / 3600:>9.2f} h, of it {share:.2%} chunks, store, call and compiling")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
