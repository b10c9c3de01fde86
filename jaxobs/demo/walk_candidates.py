"""The observers that compete on the walk: how each is made from free parameters, and where its tuning starts."""

# A type checker does not see that param() converts floats and lists.
# pyright: reportArgumentType=false

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxobs import hurwitz
from jaxobs.integrators import RK4
from jaxobs.observers import CurrentLuenberger, DiscreteTracker, HighGain, Observer
from jaxobs.plants import Discretised, LearnedField, SampledChain, SwingingLeg, WithTones

DT = 1 / 120
HIDDEN = 10  # units of the learned field
SPEEDS = (0.7, 1.0, 1.4)  # the starts, side by side: slower, as given, faster
GAMMA = 70.0  # 1/s: the unit of the high-gain observer's rates


class Candidate(NamedTuple):
    """theta -> observer, with the starts of the tuning (a leading axis) and what the table says about it."""

    name: str
    parameters: str
    free: int
    make: Callable[[Any], Observer]
    starts: Any
    steps: int
    rate: float = 2e-2
    penalty: Callable[[Any], Any] = lambda theta: 0.0


def candidates(tones: tuple[float, ...]) -> list[Candidate]:
    """All of them, the simple ones first; tones [Hz] are where the models with tones start."""
    trackers = [tracker(n, q) for n in (2, 3, 4) for q in (0, 1, 2)]
    chains = [chain(2), chain(3), chain(2, tones)]
    models = [high_gain_leg(), current_leg(), learned(()), learned(tones)]
    return trackers + chains + models


def backward_difference() -> Observer:
    """xhat_1 = y_k, xhat_2 = (y_k - y_{k-1}) / dt, as an observer without memory."""
    return CurrentLuenberger(SampledChain(2, DT), [[1.0], [1 / DT]])


def tracker(n: int, q: int) -> Candidate:
    """One free number: the rate mu of all poles."""
    starts = np.log(np.geomspace(20.0, 400.0, 8))
    fading = f"fading memory n = {n} (tracker q = 0)" if q == 0 and n in (2, 3) else f"tracker n = {n}, q = {q}"
    return Candidate(fading, "mu", 1, lambda log_mu: DiscreteTracker(n, q, jnp.exp(log_mu), DT), starts, 15, 5e-2)


def chain(n: int, tones: tuple[float, ...] = ()) -> Candidate:
    """A Luenberger observer on the chain of n integrators, every gain free; with tones in the output if any."""

    def make(theta):
        model = SampledChain(n, DT) if not tones else _with_tones(SampledChain(n, DT), theta)
        return CurrentLuenberger(model, (_gain_scale(n, tones) * theta["gain"])[:, None])

    starts = [{"gain": _gain_start(n, tones, faster)} | _tone_start(tones) for faster in SPEEDS]
    name = f"Luenberger, chain n = {n}, free gains" + (f" + {len(tones)} tones" if tones else "")
    parameters = f"{n + 2 * len(tones)} gains" + (f", {len(tones)} frequencies and decays" if tones else "")
    return Candidate(name, parameters, n + 4 * len(tones), make, _stack(starts), 150, 5e-2)


def high_gain_leg() -> Candidate:
    """z' = f(z) + diag(gamma^i) alphas (y - z_1) with the swinging leg inside, alphas through log q; y held over the period."""

    def make(theta):
        return HighGain(_leg(theta), hurwitz.alphas_from_log_q(theta["log_q"]), GAMMA)

    power = 2 * np.arange(1, 4)  # q_i scales with the square of gamma^i
    starts = [{"log_q": np.log([3.0, 3.0, 1.0]) + power * np.log(faster)} | _leg_start() for faster in SPEEDS]
    return Candidate("high-gain, swinging leg (held samples)", "log q, a, b, c, rest", 7, make, _stack(starts), 120, 5e-2)


def current_leg() -> Candidate:
    """The same model one sample faster: in the current form, with free gains."""

    def make(theta):
        return CurrentLuenberger(Discretised(_leg(theta), RK4(), DT), (_gain_scale(3, ()) * theta["gain"])[:, None])

    starts = [{"gain": _gain_start(3, (), faster)} | _leg_start() for faster in SPEEDS]
    return Candidate("Luenberger, swinging leg, free gains", "3 gains, a, b, c, rest", 7, make, _stack(starts), 120, 5e-2)


def learned(tones: tuple[float, ...]) -> Candidate:
    """The acceleration as a learned function of angle and rate; it starts as the fading-memory filter (v = 0)."""
    starts = [
        _network(np.random.default_rng(seed)) | {"gain": _gain_start(2, tones, 1.0)} | _tone_start(tones) for seed in (0, 1)
    ]

    def make(theta):
        field = LearnedField(theta["weights"], theta["biases"], 10 * theta["v"], [0.6, 0.0], [0.4, 2.5], DT)
        model = field if not tones else _with_tones(field, theta)
        return CurrentLuenberger(model, (_gain_scale(2, tones) * theta["gain"])[:, None])

    def penalty(theta):
        return 1e-5 * sum(jnp.sum(theta[name] ** 2) for name in ("weights", "biases", "v"))

    name = "Luenberger, learned leg" + (f" + {len(tones)} tones" if tones else "")
    parameters = f"{2 + 2 * len(tones)} gains, {4 * HIDDEN} weights" + (", tones" if tones else "")
    return Candidate(name, parameters, 2 + 4 * HIDDEN + 4 * len(tones), make, _stack(starts), 300, penalty=penalty)


def _stack(starts: list[dict[str, Any]]) -> dict[str, Any]:
    return {name: np.stack([np.asarray(start[name], float) for start in starts]) for name in starts[0]}


def _network(rng: np.random.Generator) -> dict[str, Any]:
    """Random features, silent at first."""
    return {"weights": 1.5 * rng.normal(size=(HIDDEN, 2)), "biases": rng.normal(size=HIDDEN), "v": np.zeros(HIDDEN)}


def _gain_scale(n: int, tones: tuple[float, ...]):
    """The fading-memory gains with sigma = 0.33 (0.58 for n = 3) as units: raw gains spread over decades."""
    sigma = {2: 0.33, 3: 0.58}[n]
    steady = DiscreteTracker(n, 0, -np.log(sigma) / DT, DT).gain(jnp.zeros(()))
    return jnp.concatenate([steady, jnp.full((2 * len(tones),), 0.1, steady.dtype)])


def _gain_start(n: int, tones: tuple[float, ...], faster: float) -> np.ndarray:
    return np.concatenate([faster ** np.arange(n), np.tile([1.0, 0.0], len(tones))])


def _tone_start(tones: tuple[float, ...]) -> dict[str, Any]:
    return {"frequencies": tones, "log_decays": [1.5] * len(tones)} if tones else {}


def _with_tones(plant, theta) -> WithTones:
    return WithTones(plant, theta["frequencies"], jnp.exp(theta["log_decays"]), DT)


def _leg_start() -> dict[str, Any]:
    """A shank of 0.5 m, lightly damped, whose muscle torque is forgotten in half a second, hanging at 0.6 rad."""
    return {"a": 9.81 / 0.5 / 10, "b": 0.5, "c": 2.0, "rest": 0.6}


def _leg(theta) -> SwingingLeg:
    return SwingingLeg(10 * theta["a"], theta["b"], theta["c"], theta["rest"])
