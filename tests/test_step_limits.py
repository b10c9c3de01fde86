"""Explicit steps beyond the stability limit warn with it; steps within it, and what cannot be known yet, do not."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxobs
from jaxobs.integrators import RK4, Euler, Exponential, UnstableStep, largest_step
from jaxobs.observers import HighGain, IntegralHighGain, OutputInjection, Sampled
from jaxobs.plants import Pendulum

FAST = HighGain(Pendulum(), [3.0, 2.0], 50.0)  # poles -50 and -100


def test_the_limits_of_euler_and_rk4_on_the_real_axis_and_off_it():
    assert largest_step(np.array([-1.0, -100.0]), 1) == pytest.approx(2 / 100)
    assert largest_step(np.array([-1.0, -100.0]), 4) == pytest.approx(2.785293563 / 100)
    assert largest_step(np.array([-1 + 3j, -1 - 3j]), 1) == pytest.approx(2 / 10)  # 2 |Re s| / |s|^2
    assert largest_step(np.array([0.5]), 4) == np.inf
    s = -0.3 + 2.0j
    h = largest_step(np.array([s]), 4)
    growth = [abs(sum((x * h * s) ** k / np.prod(np.arange(1, k + 1)) for k in range(5))) for x in (0.999, 1.001)]
    assert growth[0] < 1 < growth[1]


@pytest.mark.parametrize(
    ("observer", "limit"),
    [
        (FAST, "0.02785"),
        (IntegralHighGain(Pendulum(), [3.0, 3.0, 1.0], 100.0, 1), "0.02785"),
        (OutputInjection(Pendulum(), [[150.0], [5000.0]]), "0.02785"),
    ],
)
def test_a_step_beyond_the_limit_warns_with_it(observer, limit):
    with pytest.warns(UnstableStep, match=f"stable below {limit} s.*substeps=2"):
        Sampled(observer, RK4(), 0.05)
    Sampled(observer, RK4(2), 0.05)
    Sampled(observer, Exponential(), 0.05)
    with pytest.warns(UnstableStep, match=r"Euler.*stable below 0.02 s"):
        Sampled(FAST, Euler(), 0.021)


def test_what_was_warned_about_does_happen_and_what_was_not_does_not():
    ts = np.arange(200) * 0.05
    wishes = {"x0": [1.0, 0.0], "xhat0": [0.0, 0.0], "ts": ts, "signal": jaxobs.signals.Sine(0.5, 1.0)}
    with pytest.warns(UnstableStep, match="simulate: steps of 0.05 s by RK4 for HighGain"):
        lost = jaxobs.simulate(Pendulum(), FAST, integrator=RK4(), **wishes)
    kept = jaxobs.simulate(Pendulum(), FAST, integrator=RK4(2), **wishes)
    assert not np.max(np.abs(lost.xhat)) < 1e6
    assert np.max(np.abs(kept.x[-1] - kept.xhat[-1])) < 1e-3


def test_nothing_is_said_under_tracing():
    @jax.jit
    def built(gamma):
        observer = HighGain(Pendulum(), jnp.asarray([3.0, 2.0]), gamma)
        return Sampled(observer, RK4(), jnp.asarray(0.05)).init(jnp.zeros(2))[0]

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(built(jnp.asarray(50.0)), 0)
