"""The gradient of the noise RMSE with respect to log q of the alphas: closed form, Monte Carlo, finite differences; its cost.

Three observers of x_2: the pendulum's with q = 0 and 1 integrators, and that of a chain of five states. Monte Carlo takes the
same keys for every gain (common random numbers) and gives its standard error over keys; finite differences are central ones of
the closed form, and of Monte Carlo with the same keys. Both are roots of mean squares over keys and time. Costs are the least
processor time of some rounds, compiled, divided by that of one forward run of all keys.
Run: .venv/bin/python benchmarks/tuning_gradients.py [--quick] [--json FILE]
"""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import hurwitz, noise, observers, plants
from jaxobs.tuning import objectives

jax.config.update("jax_enable_x64", True)
PERIOD, SMALL, ROUNDS = 0.01, 1e-4, 5
# name, n, q, gamma, sigma: errors so small that the closed form, exact to first order in them, is put to the test.
CASES = (("pendulum, q = 0", 2, 0, 3.0, 0.1), ("pendulum, q = 1", 2, 1, 3.0, 0.1), ("chain of 5", 5, 0, 4.0, 1e-4))


def problem(n: int, q: int, gamma: float, sigma: float, seconds: float):
    """(closed form, Monte Carlo, theta -> observer, theta)."""
    plant = plants.Pendulum() if n == 2 else plants.SineChain(1.0, n)
    weight = np.eye(n)[1]
    closed = objectives.SteadyNoise(plant, [np.zeros(n)], sigma, weight=weight, dt=PERIOD)
    ts = np.arange(round(seconds / PERIOD)) * PERIOD
    start = 8.0 / gamma * n
    chance = objectives.MonteCarlo(
        plant, ts, np.zeros(n), np.zeros(n), noise.Gaussian(sigma), weight=weight, after=start
    )  # fmt: skip
    theta = jnp.log(hurwitz.binomial(n + q))

    def make(theta):
        return observers.IntegralHighGain(plant, hurwitz.alphas_from_log_q(theta), gamma, q)

    return closed, chance, make, theta


def cost(run, *given) -> float:
    """Processor seconds: the least of some rounds."""
    jax.block_until_ready(run(*given))
    taken = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        jax.block_until_ready(run(*given))
        taken.append(time.process_time() - begin)
    return min(taken)


def row(name: str, n: int, q: int, gamma: float, sigma: float, count: int, seconds: float) -> dict:
    closed, chance, make, theta = problem(n, q, gamma, sigma, seconds)
    keys = jax.random.split(jax.random.key(0), count)

    def squares(theta):
        return jax.vmap(lambda key: chance(make(theta), key) ** 2)(keys)

    def rmse(theta):
        return jnp.sqrt(jnp.mean(squares(theta)))

    @jax.jit
    def each(theta):
        return jax.vmap(jax.value_and_grad(lambda theta, key: chance(make(theta), key) ** 2), in_axes=(None, 0))(theta, keys)

    exact = jax.jit(jax.value_and_grad(lambda theta: closed(make(theta))))
    forward, gradient = jax.jit(rmse), jax.jit(jax.value_and_grad(rmse))
    value, slope = exact(theta)
    single, slopes = (np.asarray(part) for part in each(theta))
    mean = float(np.sqrt(np.mean(single)))
    # d sqrt(m) = dm / (2 sqrt(m)), and its standard error over keys with that of m in it.
    parts = slopes / (2 * mean) - (single - mean**2)[:, None] * np.mean(slopes, axis=0) / (4 * mean**3)
    directions = SMALL * np.eye(n + q)
    value_only = jax.jit(lambda theta: closed(make(theta)))
    differences = [[float(f(theta + d) - f(theta - d)) / (2 * SMALL) for d in directions] for f in (value_only, forward)]
    run = cost(forward, theta)
    return {
        "case": name, "n": n, "q": q, "gamma": gamma, "sigma": sigma, "keys": count, "samples": int(chance.ts.shape[0]),
        "rmse": float(value), "rmse_monte_carlo": mean,
        "analytic": slope.tolist(), "monte_carlo": np.mean(slopes / (2 * mean), axis=0).tolist(),
        "standard_error": (np.std(parts, axis=0, ddof=1) / np.sqrt(count)).tolist(),
        "difference_analytic": differences[0], "difference_monte_carlo": differences[1],
        "forward_run_s": run, "cost_monte_carlo": cost(gradient, theta) / run, "cost_analytic": cost(exact, theta) / run,
    }  # fmt: skip


def report(found: dict) -> None:
    print(
        f"\n{found['case']}: gamma = {found['gamma']:g}, {found['keys']} keys of {found['samples']} samples; "
        f"sigma = {found['sigma']:g}, RMSE of x_2 {found['rmse']:.6g} (Monte Carlo {found['rmse_monte_carlo']:.6g})"
    )
    heads = ("d / d log q_i", "analytic", "its difference", "Monte Carlo", "std. error", "its difference", "z")
    print(" ".join(f"{head:>15}" for head in heads))
    for i, exact in enumerate(found["analytic"]):
        drawn, error = found["monte_carlo"][i], found["standard_error"][i]
        numbers = (exact, found["difference_analytic"][i], drawn, error, found["difference_monte_carlo"][i])
        print(f"{i + 1:>15} " + " ".join(f"{number:>15.7g}" for number in numbers) + f" {(drawn - exact) / error:>15.2f}")
    print(
        f"cost in forward runs ({1e3 * found['forward_run_s']:.1f} ms): Monte Carlo value and gradient "
        f"{found['cost_monte_carlo']:.2f}, analytic value and gradient {found['cost_analytic']:.6f}", flush=True,
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer and shorter runs")
    parser.add_argument("--json", type=Path, help="write the rows there")
    options = parser.parse_args()
    count, seconds = (32, 40.0) if options.quick else (256, 100.0)
    rows = []
    for case in CASES:
        rows.append(row(*case, count, seconds))
        report(rows[-1])
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
