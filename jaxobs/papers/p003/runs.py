"""The computations that several claims share: each input classified once, and through the three observers once."""

from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxobs._simulate as simulation
from jaxobs.designs import lemma1
from jaxobs.excitation import Excitation, classify
from jaxobs.observers import Luenberger, Lyapunov
from jaxobs.observers.lyapunov import from_scaled
from jaxobs.papers.p003.inputs import HORIZON, INPUTS, GatedGrowth
from jaxobs.plants import GatedChain
from jaxobs.signals import Recorded

THETA, GAMMA = 4.0, 2.0  # of (25); (12) has theta = THETA / GAMMA
STEP, END = 0.01, 30.0  # [s]
CONVERGED = 1e-3  # of the first error, after END: the slowest constant gain here leaves 1e-9


@lru_cache
def classified(name: str) -> Excitation:
    """An input along example 1, (24)."""
    one = INPUTS[name]
    return classify(GatedChain(), one.signal, horizon=HORIZON, breaks=one.breaks)


class Errors(NamedTuple):
    """|e(END)| / |e(0)| of the observers (7), (12) and (25)."""

    constant: float
    scaled: float
    fading: float


@lru_cache
def all_errors(growing: bool = False) -> dict[str, Errors]:
    """Every input through the three observers, for example 1 or for the plant whose hidden state grows; x(0) = (1, 1), xhat(0) = 0."""
    plant: Any = GatedGrowth() if growing else GatedChain()
    knots = jnp.arange(0, END + STEP, STEP / 2)
    values = jnp.stack([jax.vmap(one.signal)(knots) for one in INPUTS.values()])
    ts = jnp.arange(0, END + STEP / 2, STEP)
    k = lemma1([0.5], [1.5]).gain
    theta, start = from_scaled(jnp.asarray(THETA / GAMMA), jnp.asarray(GAMMA), jnp.eye(2))
    observers = (
        Luenberger(plant, (THETA ** np.arange(1, 3) * k)[:, None]),
        Lyapunov(plant, theta, start),
        Lyapunov(plant, THETA, np.eye(2)),
    )

    def last(observer):
        def run(path):
            trajectory = simulation.simulate(
                plant, observer, x0=[1.0, 1.0], xhat0=[0.0, 0.0], ts=ts, signal=Recorded(knots, path)
            )
            return jnp.linalg.norm((trajectory.x - trajectory.xhat)[-1]) / jnp.sqrt(2.0)

        return np.asarray(jax.jit(jax.vmap(run))(values))

    rows = np.stack([last(observer) for observer in observers], axis=1)
    return {name: Errors(*map(float, row)) for name, row in zip(INPUTS, rows, strict=True)}
