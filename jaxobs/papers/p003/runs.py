"""The computations that several claims share: each input classified once, and through the three observers once."""

from functools import lru_cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._simulate import simulate
from jaxobs.designs import lemma1
from jaxobs.excitation import Excitation, classify
from jaxobs.integrators import RK4, Field
from jaxobs.observers import Luenberger, Lyapunov
from jaxobs.observers.lyapunov import from_scaled
from jaxobs.papers.p003.inputs import HORIZON, INPUTS, THETAS, GatedGrowth
from jaxobs.plants import GatedChain
from jaxobs.signals import AbstractSignal, Recorded

THETA, GAMMA = 4.0, 2.0  # of (25); (12) has theta = THETA / GAMMA
STEP, END = 0.01, 30.0  # [s]
GROWTH = 0.2  # [1/s] of the hidden state of the other plant
CONVERGED = 1e-3  # of the first error, after END: the slowest constant gain here leaves 1e-9


@lru_cache
def classified(name: str) -> Excitation:
    """An input along example 1, (24)."""
    one = INPUTS[name]
    return classify(GatedChain(), one.signal, horizon=HORIZON, thetas=THETAS, breaks=one.breaks)


class Errors(NamedTuple):
    """|e(END)| / |e(0)| of the observers (7), (12) and (25)."""

    constant: float
    scaled: float
    fading: float


@lru_cache
def all_errors(growing: bool = False) -> dict[str, Errors]:
    """Every input through the three observers, on example 1 or where the hidden state grows; x(0) = (1, 1), xhat(0) = 0."""
    return _both()[int(growing)]


@lru_cache
def _both() -> tuple[dict[str, Errors], dict[str, Errors]]:
    knots = jnp.arange(0, END + STEP, STEP / 2)
    values = jnp.stack([jax.vmap(one.signal)(knots) for one in INPUTS.values()])
    ts = jnp.arange(0, END + STEP / 2, STEP)
    gain = THETA ** np.arange(1, 3) * lemma1([0.5], [1.5]).gain
    growths = jnp.asarray([0.0, GROWTH])  # x2' = 0 is example 1

    def last(plant, observer, path):
        trajectory = simulate(plant, observer, x0=[1.0, 1.0], xhat0=[0.0, 0.0], ts=ts, signal=Recorded(knots, path))
        return jnp.linalg.norm((trajectory.x - trajectory.xhat)[-1]) / jnp.sqrt(2.0)

    def constant(growth, path):
        plant = GatedGrowth(growth)
        return last(plant, Luenberger(plant, jnp.asarray(gain)[:, None]), path)

    def fading(growth, theta, start, path):
        plant = GatedGrowth(growth)
        return last(plant, Lyapunov(plant, theta, start), path)

    scaled = from_scaled(jnp.asarray(THETA / GAMMA), jnp.asarray(GAMMA), jnp.eye(2))
    thetas, starts = (jnp.stack(parts) for parts in zip(scaled, (jnp.asarray(THETA), jnp.eye(2)), strict=True))
    over_inputs = jax.vmap(jax.vmap(constant, (None, 0)), (0, None))
    first = np.asarray(jax.jit(over_inputs)(growths, values))[..., None]
    of_one = jax.vmap(fading, (None, 0, 0, None))
    rest = np.asarray(
        jax.jit(jax.vmap(jax.vmap(of_one, (None, None, None, 0)), (0, None, None, None)))(growths, thetas, starts, values)
    )
    example, other = (
        {name: Errors(*map(float, row)) for name, row in zip(INPUTS, rows, strict=True)}
        for rows in np.concatenate([first, rest], axis=-1)
    )
    return example, other


def solve_s(observer: Lyapunov, signal: AbstractSignal, end: float, count: int = 4000) -> np.ndarray:
    """S(end) by (19) from S(0), in `count` Runge-Kutta steps."""
    integrator, step = RK4(), jnp.asarray(end / count)
    field = Field(lambda t, z: observer.flow(t, z, signal(t), jnp.zeros(observer.p)))

    def body(z, k):
        return integrator.step(field, None, k * step, step, z), None

    (_, s), _ = jax.lax.scan(body, observer.init(jnp.zeros(observer.n)), jnp.arange(float(count)))
    return np.asarray(s)
