"""What does the exponential integrator's dense algebra buy on a stiff observer?

The 5-state chain of paper 002 and its high-gain observer (poles at -gamma), measurement noise held over 0.01: RK4 with 1 to 32
substeps against one exponential step. Interleaved, medians, one process; the error is against RK4 with 512 substeps.
Run: .venv/bin/python benchmarks/stiff.py [lanes]
"""

import statistics
import sys
import time

import jax
import numpy as np

import jaxobs
from jaxobs.integrators import RK4, Exponential

LANES = int(sys.argv[1]) if len(sys.argv) > 1 else 2048
STEPS, PERIOD, ROUNDS = 200, 0.01, 7


def study(gamma: float, integrator):
    """seeds -> the final estimates of all lanes, jitted."""
    plant = jaxobs.plants.SineChain(1.0, 5)
    observer = jaxobs.observers.HighGain(plant, jaxobs.hurwitz.binomial(5), gamma)
    ts = PERIOD * np.arange(STEPS)
    noise = jaxobs.noise.Gaussian(0.1)

    def final(key):
        run = jaxobs.simulate(
            plant, observer, x0=np.ones(5), xhat0=np.zeros(5), ts=ts, noise=noise, key=key, integrator=integrator
        )
        return run.xhat[-1]

    return jax.jit(jax.vmap(final))


def main() -> None:
    keys = jax.random.split(jax.random.key(0), LANES)
    print(f"{LANES} lanes x {STEPS} steps of {PERIOD}, float32; ns per lane-step (median of {ROUNDS}), worst relative error")
    for gamma in (20.0, 100.0, 500.0):
        truth = np.asarray(study(gamma, RK4(512))(keys[:64]))
        rivals = {"exponential": Exponential()} | {f"RK4, {k} substeps": RK4(k) for k in (1, 2, 4, 8, 16, 32)}
        made = {name: study(gamma, integrator) for name, integrator in rivals.items()}
        errors, times = {}, {name: [] for name in made}
        for name, run in made.items():  # compiles
            errors[name] = np.max(np.abs(np.asarray(run(keys))[:64] - truth) / np.max(np.abs(truth), axis=0))
        for _ in range(ROUNDS):
            for name, run in made.items():
                begin = time.perf_counter()
                jax.block_until_ready(run(keys))
                times[name].append((time.perf_counter() - begin) / (LANES * STEPS) * 1e9)
        base = statistics.median(times["exponential"])
        print(f"gamma = {gamma:g}")
        for name in made:
            took = statistics.median(times[name])
            error = f"{errors[name]:.1e}" if np.isfinite(errors[name]) else "diverged"
            print(f"  {name:18s} {took:8.1f} ns  {took / base:5.2f} x the exponential  error {error}")


if __name__ == "__main__":
    main()
