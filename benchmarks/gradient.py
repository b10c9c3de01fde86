"""What the gradient of a study's mean RMSE costs beside the study itself, and that its memory does not grow with time.

The gains are gamma and alphas: 3 numbers for n = 2 (pendulum, RK4), 6 for n = 5 (chain of sines, RK4), held measurement noise
or none. A round runs the study, the gradient forward and the gradient in reverse, one after another; ratios are taken round by
round, of processor times (all threads), and their median is printed. Peaks are those of the whole process during one run.
Run: .venv/bin/python benchmarks/gradient.py [lanes] [steps] [rounds] [states, e.g. 2,5]
"""

import statistics
import sys
import time

import jaxobs

jaxobs.studies.devices.use_all_cores(fuse=True)

import jax  # noqa: E402
import numpy as np  # noqa: E402
from _worker import FORGET, memory  # noqa: E402

from jaxobs import Seeds, hurwitz, metrics, noise, observers, plants, signals  # noqa: E402
from jaxobs.studies.gradient import mean_gradient  # noqa: E402
from jaxobs.studies.kernel import compile_group  # noqa: E402

jax.config.update("jax_enable_x64", True)
LANES, STEPS, ROUNDS = (int(sys.argv[i]) if len(sys.argv) > i else default for i, default in ((1, 8192), (2, 500), (3, 7)))
STATES = [int(n) for n in sys.argv[4].split(",")] if len(sys.argv) > 4 else [2, 5]
PERIOD, SIGMA = 0.01, 0.1


def parts(n: int, dtype: str, noisy: bool, lanes: int, steps: int):
    """(plant, observer, the rest of the arguments)"""
    plant = plants.Pendulum() if n == 2 else plants.SineChain(1.0, n)
    observer = observers.HighGain(plant, hurwitz.binomial(n), 3.0)
    count = lanes if noisy else 1
    x0 = np.random.default_rng(0).normal(0, 0.3, (lanes // count, n))
    ts = np.arange(steps) * PERIOD
    rest = {
        "ts": ts, "metrics": {"rmse": jaxobs.astype(metrics.RMSE(ts[steps // 2]), dtype)}, "x0": x0, "xhat0": np.zeros(n),
        "signal": jaxobs.astype(signals.Sine(0.5), dtype) if n == 2 else None,
        "noise": jaxobs.astype(noise.Gaussian(SIGMA), dtype) if noisy else None,
        "keys": Seeds(jax.random.key(0), count) if noisy else None,
    }  # fmt: skip
    return jaxobs.astype(plant, dtype), jaxobs.astype(observer, dtype), rest


def contenders(n: int, dtype: str, noisy: bool, lanes: int = LANES, steps: int = STEPS):
    """{name: a function that runs it to the end}, all over the same lanes."""
    plant, observer, rest = parts(n, dtype, noisy, lanes, steps)
    found = {}
    for mode in ("forward", "reverse"):
        found[mode] = mean_gradient(lambda found: found["rmse"][1], plant, observer, wrt=["gamma", "alphas"], mode=mode, **rest)
    study = compile_group(found["forward"].group, chunk=lanes)
    return {"study": lambda: study(0)} | found


def cost(run) -> tuple[float, float]:
    """(processor, wall) seconds."""
    processor, wall = time.process_time(), time.perf_counter()
    jax.block_until_ready(run())
    return time.process_time() - processor, time.perf_counter() - wall


def peak(run) -> float:
    FORGET.write_text("5")
    jax.block_until_ready(run())
    return memory("VmHWM")


def main() -> None:
    print(f"{LANES} lanes, {STEPS} steps, {ROUNDS} rounds, {jax.local_device_count()} devices")
    heads = ("n", "dtype", "noise", "P", "study ns", "forward", "(wall)", "reverse", "(wall)", "first s")
    print(" ".join(f"{head:>8}" for head in heads))
    for n in STATES:
        for dtype in ("float32", "float64"):
            for noisy in (False, True):
                runs = contenders(n, dtype, noisy)
                first = [cost(run)[1] for run in runs.values()][1]
                rounds = [{name: cost(run) for name, run in runs.items()} for _ in range(ROUNDS)]
                ratios = [
                    statistics.median(one[mode][clock] / one["study"][clock] for one in rounds)
                    for mode in ("forward", "reverse") for clock in (0, 1)
                ]  # fmt: skip
                base = statistics.median(one["study"][0] for one in rounds) / LANES / STEPS * 1e9
                print(
                    f"{n:>8} {dtype:>8} {SIGMA if noisy else '-':>8} {n + 1:>8} {base:>8.1f} "
                    + " ".join(f"{ratio:>8.2f}" for ratio in ratios) + f" {first:>8.1f}", flush=True,
                )  # fmt: skip
    if not FORGET.exists():
        return
    print("peak memory [MB], float64, n = 2, with noise")
    for steps in (STEPS, 4 * STEPS, 16 * STEPS):
        runs = contenders(2, "float64", True, steps=steps)
        for run in runs.values():
            run()
        print(f"{steps:>8} steps " + " ".join(f"{name} {peak(run):.1f}" for name, run in runs.items()), flush=True)


if __name__ == "__main__":
    main()
