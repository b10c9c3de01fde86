"""The experiment of paper 000: the pendulum (66), its two observers, and what the paper leaves open."""

# A type checker does not see that param() converts floats and lists.
# pyright: reportArgumentType=false

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import hurwitz
from jaxobs._module import Numbers, astype, dtype_of
from jaxobs._simulate import Trajectory, score, simulate
from jaxobs.metrics import RMSE
from jaxobs.noise import Gaussian
from jaxobs.observers import HighGain, IntegralHighGain, Observer
from jaxobs.plants import Pendulum
from jaxobs.signals import Sine
from jaxobs.studies import over

# The paper leaves noise and initial conditions open; these are ours.
SIGMA, PERIOD, AFTER, END = 0.1, 0.01, 10.0, 20.0
START, GUESS = [1.0, 0.0], [0.0, 0.0]
ALPHAS, GAMMA = (3.0, 2.0), 6.0  # of (67) and (71)
RHO = 1.5  # the paper's Lipschitz constant


def plain() -> HighGain:
    """(67) at gamma = 6."""
    return HighGain(Pendulum(), ALPHAS, GAMMA)


def integral(q: int = 2) -> IntegralHighGain:
    """(40) with alphas C(n + q, k) at gamma = 6, the gain of (71): for figure 3 the paper leaves gamma open."""
    return IntegralHighGain(Pendulum(), hurwitz.binomial(2 + q), GAMMA, q)


def control() -> Sine:
    """u = 0.5 sin t."""
    return Sine(amplitude=0.5)


def noise() -> Gaussian:
    return Gaussian(SIGMA)


def run(
    observer: Observer, *, noisy: bool = False, end: float = END, period: float = PERIOD, guess: Numbers = GUESS
) -> Trajectory:
    """The pendulum from START and an observer from `guess`, in its precision; the noise, if any, is held for one period."""
    plant, signal, hiss = astype((Pendulum(), control(), noise()), dtype_of(observer))
    with_noise = {"noise": hiss, "key": jax.random.key(0)} if noisy else {}
    return simulate(plant, observer, x0=START, xhat0=guess, ts=np.arange(0.0, end, period), signal=signal, **with_noise)


def rmse_of_x2(family: Any, seeds: int) -> np.ndarray:
    """RMSE of x2 over t >= 10 s under noise, (*family.shape, seeds), in float32. Every member meets the same noise."""
    single = jnp.float32
    plant, signal, noisy, metric = astype((Pendulum(), control(), noise(), RMSE(AFTER)), single)
    ts = np.arange(0.0, END, PERIOD)

    def loss(observer, key):
        kept = score(
            plant, observer, metrics={"rmse": metric}, x0=START, xhat0=GUESS, ts=ts, signal=signal, noise=noisy, key=key
        )
        return kept["rmse"][1]

    return np.asarray(over(astype(family, single), loss)(jax.random.split(jax.random.key(1), seeds)), float)
