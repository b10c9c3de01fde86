"""What does one sample cost in Python? Microseconds of `Runner.update`, against the loop that a user would write.

The pendulum's high-gain observer with RK4 and the derivative tracker, float64: both backends of the Runner, with all that they
check and count, beside the same equations by hand in NumPy (arrays, no checks). Median and 99 % of single calls.
Run: python benchmarks/streaming.py
"""

import sys
import time
from collections.abc import Callable

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from jaxobs import Runner, observers, plants

DT, SAMPLES, WARM = 0.01, 20_000, 500


def main() -> int:
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(0)
    ys, us = 0.3 * rng.normal(size=(SAMPLES, 1)), 0.3 * rng.normal(size=(SAMPLES, 1))
    high_gain = observers.HighGain(plants.Pendulum(), [2.0, 1.0], 6.0)
    tracker = observers.DiscreteTracker(2, 0, 20.0, DT)
    table = Table("observer", "step", "median, us", "99 %, us", "last estimate")
    for name, observer, by_hand in (("pendulum, RK4", high_gain, pendulum()), ("tracker", tracker, fading())):
        ways = {"by hand, NumPy": by_hand}
        for backend in ("numpy", "jax"):
            runner = Runner(observer, DT, xhat0=[0.0, 0.0], backend=backend)
            ways[f"Runner, {backend}"] = lambda k, y, u, runner=runner, m=observer.m: runner.update(k * DT, y, u if m else None)
        for way, update in ways.items():
            times, xhat = np.zeros(SAMPLES), np.zeros(2)
            for k in range(SAMPLES):
                begin = time.perf_counter()
                xhat = update(k, ys[k], us[k])
                times[k] = time.perf_counter() - begin
            middle, high = np.quantile(1e6 * times[WARM:], [0.5, 0.99])
            table.add_row(name, way, f"{middle:.1f}", f"{high:.1f}", f"({xhat[0]:.9f}, {xhat[1]:.9f})")
    Console(width=120).print(table)
    return 0


def pendulum() -> Callable[..., np.ndarray]:
    """RK4 of z' = f(z, u) + L (y - z_1), both held, as one writes it down."""
    z, gain = np.zeros(2), np.array([12.0, 36.0])

    def flow(z: np.ndarray, y: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.array([z[1], np.sin(z[0]) + u[0] * np.cos(z[0])]) + gain * (y[0] - z[0])

    def update(k: int, y: np.ndarray, u: np.ndarray) -> np.ndarray:
        nonlocal z
        xhat = z
        k1 = flow(z, y, u)
        k2 = flow(z + DT / 2 * k1, y, u)
        k3 = flow(z + DT / 2 * k2, y, u)
        k4 = flow(z + DT * k3, y, u)
        z = z + DT / 6 * (k1 + 2 * (k2 + k3) + k4)
        return xhat

    return update


def fading() -> Callable[..., np.ndarray]:
    """xhat- = e^{A dt} xhat, xhat = xhat- + G (y - xhat-_1), of the steady fading-memory gain."""
    sigma = np.exp(-20.0 * DT)
    gain, ahead, xhat = np.array([1 - sigma**2, (1 - sigma) ** 2 / DT]), np.array([[1.0, DT], [0.0, 1.0]]), np.zeros(2)

    def update(k: int, y: np.ndarray, u: np.ndarray) -> np.ndarray:
        nonlocal xhat
        expected = ahead @ xhat if k else xhat
        xhat = expected + gain * (y[0] - expected[0])
        return xhat

    return update


if __name__ == "__main__":
    sys.exit(main())
