"""Run-time monitors of corollaries 1 and 2: kept where the hypotheses hold, broken where one of them does not."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from oracles import riccati

import jaxobs
from jaxobs import chain_bounds, monitors
from jaxobs.integrators import RK4
from jaxobs.noise import Bias, Uniform
from jaxobs.observers import HighGain, IntegralHighGain
from jaxobs.plants import Pendulum
from jaxobs.signals import Sine

ALPHAS, GAMMA, RHO = jnp.asarray([3.0, 2.0]), jnp.asarray(6.0), jnp.asarray(1.5)
WIDE, FAST = jnp.asarray([4.0, 6.0, 4.0, 1.0]), jnp.asarray(45.0)
REACH = jnp.asarray([1.0, 0.5])


def run(observer, x0, plant=None, noise=None, until=4.0):
    ts = np.arange(0, until, 0.005)
    return jaxobs.simulate(
        plant or Pendulum(), observer, x0=x0, xhat0=[0.0, 0.0], ts=ts, signal=Sine(0.5, 1.0), noise=noise,
        key=jax.random.key(1), integrator=RK4(4),
    )  # fmt: skip


@pytest.fixture(scope="module")
def judge():
    """Compiled once: the monitors of both corollaries on a trajectory."""
    budget = jax.jit(lambda ts, y: monitors.budget(ts, y, ALPHAS, GAMMA, REACH))
    envelope = jax.jit(lambda ts, y, w, gamma=FAST: monitors.envelope(ts, y, WIDE, gamma, RHO, REACH, w))
    return budget, envelope


def test_the_budget_is_kept_from_every_corner_and_is_not_idle(judge):
    observer, most = HighGain(Pendulum(), ALPHAS, GAMMA), 0.0
    for signs in ((-1.0, 1.0), (1.0, 1.0)):  # the others are their mirror images
        seen = run(observer, np.array(signs) * np.asarray(REACH))
        found = judge[0](seen.ts, seen.innovation)
        assert found.holds
        assert found.broken_at == np.inf
        most = max(most, float(found.spent[-1]))
        energy = scipy.integrate.cumulative_trapezoid(np.asarray(seen.innovation[:, 0]) ** 2, seen.ts, initial=0)
        np.testing.assert_allclose(monitors.innovation_energy(seen.ts, seen.innovation), energy, rtol=1e-12)
    assert most > 0.2  # the corollary is within a factor of five of what happens


def test_the_budget_says_when_a_hypothesis_fails(judge):
    observer = HighGain(Pendulum(), ALPHAS, GAMMA)
    too_far = judge[0](*_signals(run(observer, [3.0, 0.0])))
    assert not too_far.holds
    assert 0 < too_far.broken_at < 1
    other_plant = judge[0](*_signals(run(observer, [0.5, 0.2], plant=Pendulum(40.0), until=20.0)))
    assert not other_plant.holds
    assert other_plant.broken_at > 1
    assert float(other_plant.spent[round(float(other_plant.broken_at) / 0.005)]) > 1


def _signals(seen):
    return seen.ts, seen.innovation


def test_the_energy_behind_33_is_an_upper_bound_with_the_weighted_error():
    """The whole left side of (33) with beta from `optimality_weight`: below V(0), at every time."""
    seen = run(HighGain(Pendulum(), ALPHAS, GAMMA), [1.0, -0.5])
    e = np.asarray(seen.x - seen.xhat)
    p, q = riccati.solve([3.0, 2.0], 6.0)
    beta = float(chain_bounds.optimality_weight(ALPHAS, GAMMA, RHO))
    weighted = beta * np.einsum("ti,i->t", e**2, 1 / np.diag(q)) + np.asarray(seen.innovation[:, 0]) ** 2
    spent = scipy.integrate.cumulative_trapezoid(weighted, seen.ts, initial=0)
    assert np.max(spent) < e[0] @ np.linalg.solve(p, e[0])


def test_the_envelope_is_kept_under_bounded_noise_and_broken_by_more(judge):
    observer = IntegralHighGain(Pendulum(), WIDE, FAST, 2)
    seen = run(observer, REACH, noise=Uniform(0.05))
    found = judge[1](*_signals(seen), jnp.asarray(0.05))
    assert found.holds
    assert np.all(np.abs(seen.innovation[:, 0]) <= found.limit)
    faulty = run(observer, [0.0, 0.0], noise=Bias(40.0), until=0.1)
    broken = judge[1](*_signals(faulty), jnp.asarray(0.05))
    assert not broken.holds
    assert broken.broken_at == 0


def test_the_limit_of_the_envelope_against_the_scalar_equation(judge):
    """W' = -C_1/2 W + c w by a numerical solver, from the worst corner; all constants from scipy's Riccati solution."""
    gamma, w = 45.0, 0.05
    z, _ = riccati.solve([4.0, 6.0, 4.0, 1.0], gamma)
    left, right = riccati.parts([4.0, 6.0, 4.0, 1.0], gamma)
    inverse, rate = np.linalg.inv(z), left - 1.5 * right
    corners = [np.array([0, 0, *(np.array(signs) * np.asarray(REACH))]) for signs in itertools.product((-1, 1), repeat=2)]
    start = np.sqrt(max(e @ inverse @ e for e in corners))
    ts = np.linspace(0, 2, 9)
    solved = scipy.integrate.solve_ivp(
        lambda t, v: -rate / 2 * v + np.sqrt(inverse[1, 1]) * w, (0, 2), [start], t_eval=ts, rtol=1e-10, atol=1e-14
    )
    found = judge[1](jnp.asarray(ts), jnp.zeros((9, 1)), jnp.asarray(w))
    np.testing.assert_allclose(found.limit, np.sqrt(z[2, 2]) * solved.y[0] + w, rtol=1e-5)
    uncertified = judge[1](jnp.asarray(ts), jnp.zeros((9, 1)), jnp.asarray(w), jnp.asarray(6.0))  # (44) fails there
    assert uncertified.holds
    assert np.all(np.isinf(uncertified.limit))


def test_the_worst_initial_energy_is_at_a_corner():
    p, _ = riccati.solve([3.0, 2.0], 6.0)
    inside = np.random.default_rng(0).uniform(-1, 1, (4000, 2)) * np.asarray(REACH)
    sampled = np.max(np.einsum("ki,ij,kj->k", inside, np.linalg.inv(p), inside))
    found = float(chain_bounds.initial_energy(ALPHAS, GAMMA, REACH))
    assert 0.9 * found < sampled <= found
