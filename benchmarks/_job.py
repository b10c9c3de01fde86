"""One row of the race: what every contender is asked to compute, and the studies themselves.

pendulum: x' = (x2, sin x1 + u cos x1), u = 0.5 sin t, with the high-gain observer, classical RK4, y = x1 + w_k held.
chain: x_i' = x_{i+1}, x_5' = mean of sin x_i, with a high-gain observer that is stiff on the sampling period. In float32 the
rounding of y times gain^5 is larger than what is compared, on long runs and without noise: it races in float64 by default.
tracker: the discrete derivative tracker (3 derivatives, one integrator) on a noisy parabola.

A contender is a module with `prepare(job)`. It returns a function without arguments that computes the study and returns
(rmse (n, m), lanes (m,) or None for all): the root mean square error of every state over the samples from job.first on, each
taken before one of the job.steps steps.
"""

import dataclasses
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True)
class Study:
    """One workload: sampling period [s], truth and estimate at the start, range of the gains [1/s], substeps of RK4, steps."""

    dt: float
    x0: tuple[float, ...]
    xhat0: tuple[float, ...]
    gains: tuple[float, float]
    substeps: int = 1
    steps: int = 1000


STUDIES = {
    "pendulum": Study(0.01, (0.5, 0.0), (0.0, 0.0), (2.0, 6.0)),
    # 8 substeps: the error of one exponential step, for 200; then the states, which grow as t^5, take its error with them
    "chain": Study(0.05, (0.1,) * 5, (0.0,) * 5, (20.0, 50.0), 8, 200),
    "tracker": Study(0.01, (0.5, 1.0, -0.2), (0.0, 0.0, 0.0), (5.0, 20.0)),
}
ALPHAS = (3.0, 2.0)
SIGMA = 0.1
SEEDS = 64  # with noise each gain meets this many seeds; without it every lane has a gain of its own


@dataclasses.dataclass(frozen=True)
class Job:
    """workload, precision ("float32" or "float64"), sigma of the noise (0 for none), lanes, steps, seed."""

    workload: str
    precision: str
    sigma: float
    lanes: int
    steps: int
    seed: int = 0

    @property
    def study(self) -> Study:
        return STUDIES[self.workload]

    @property
    def dtype(self) -> Any:
        return np.float32 if self.precision == "float32" else np.float64

    @property
    def first(self) -> int:
        """The first sample that counts: with noise the start-up is left out, without it little else is there."""
        return self.steps // 10 if self.sigma else 0

    @property
    def after(self) -> float:
        """A time between the last sample that does not count and the first that does."""
        return (self.first - 0.5) * self.study.dt

    @property
    def seeds(self) -> int:
        return SEEDS if self.sigma > 0 else 1

    def gains(self) -> np.ndarray:
        """The different gains, float64."""
        return np.linspace(*self.study.gains, self.lanes // self.seeds)

    def lane_gains(self) -> np.ndarray:
        """The gain of every lane: gain by gain, seed by seed."""
        return np.repeat(self.gains(), self.seeds)

    def times(self) -> np.ndarray:
        return self.study.dt * np.arange(self.steps)
