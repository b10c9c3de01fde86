"""The ten inputs that the conditions of the paper are tried on, and a plant on which losing sight of a state is dangerous."""

import math
from typing import NamedTuple

import jax.numpy as jnp

from jaxobs._module import Scalar, param
from jaxobs.plants import AbstractTriangular
from jaxobs.signals import AbstractSignal, Zero


class One(AbstractSignal):
    """1."""

    m = 1

    def __call__(self, t):
        return jnp.ones_like(t)[None]


class Swinging(AbstractSignal):
    """1 + 0.5 sin t."""

    m = 1

    def __call__(self, t):
        return 1 + 0.5 * jnp.sin(t)[None]


class Cosine(AbstractSignal):
    """cos t: it changes its sign."""

    m = 1

    def __call__(self, t):
        return jnp.cos(t)[None]


class CosineCubed(AbstractSignal):
    """cos^3 t: it crosses zero with order 3."""

    m = 1

    def __call__(self, t):
        return jnp.cos(t)[None] ** 3


class SquareWave(AbstractSignal):
    """sign(cos t): never zero, not continuous."""

    m = 1

    def __call__(self, t):
        return jnp.where(jnp.cos(t) >= 0, 1, -1).astype(jnp.result_type(t))[None]


class Fading(AbstractSignal):
    """e^{-t}."""

    m = 1

    def __call__(self, t):
        return jnp.exp(-t)[None]


class SlowlyFading(AbstractSignal):
    """1 / (1 + t)."""

    m = 1

    def __call__(self, t):
        return 1 / (1 + t)[None]


class HalfWave(AbstractSignal):
    """max(0, sin(pi t / 2)): on for two seconds, off for two."""

    m = 1

    def __call__(self, t):
        on = jnp.mod(t, 4) < 2  # exactly zero while off
        return jnp.where(on, jnp.abs(jnp.sin(t * (math.pi / 2))), 0)[None]


class Bump(AbstractSignal):
    """sin^2(pi t) for t < 1, then 0."""

    m = 1

    def __call__(self, t):
        return jnp.where(t < 1, jnp.sin(math.pi * t) ** 2, 0)[None]


class Input(NamedTuple):
    """A signal, and the times at which it jumps or has a corner."""

    signal: AbstractSignal
    breaks: tuple[float, ...] = ()


HORIZON, THETAS = (2.0, 22.0), (4.0, 8.0, 16.0)  # [s]: each half holds a period of each input; [1/s]
INPUTS = {
    "1": Input(One()),
    "1 + 0.5 sin t": Input(Swinging()),
    "cos t": Input(Cosine()),
    "cos^3 t": Input(CosineCubed()),
    "sign(cos t)": Input(SquareWave(), tuple(math.pi * (k + 0.5) for k in range(7))),
    "exp(-t)": Input(Fading()),
    "1/(1+t)": Input(SlowlyFading()),
    "max(0, sin(pi t/2))": Input(HalfWave(), tuple(2.0 * k for k in range(1, 11))),
    "a bump, then 0": Input(Bump(), (1.0,)),
    "0": Input(Zero(1)),
}


class GatedGrowth(AbstractTriangular):
    """x1' = u x2, x2' = growth x2, y = x1: g is globally Lipschitz, and an error in x2 that is not seen grows."""

    growth: Scalar = param(default=0.2)
    n = 2
    m = 1

    def a(self, u):
        return u

    def g(self, x, u):
        return jnp.stack([jnp.zeros_like(x[0]), self.growth * x[1]])
