"""The tracker's gains, rates and theorems against scipy: state space, Lyapunov solver, integration."""

import math
import re

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import algebraic as oracle
from oracles import tracker as loops
from scipy.linalg import expm

import jaxobs
from jaxobs import linalg
from jaxobs.designs import best_rate, equal_bandwidth, equal_bias, fading_rate, peak, theorem1, tracker_bounds, tracker_gains
from jaxobs.designs.tracker import lost, relative_tone, relative_white, response, transfer
from jaxobs.observers import DiscreteTracker, Tracker

SIZES = [(1, 0), (3, 0), (2, 1), (3, 2), (4, 1)]


@pytest.mark.parametrize(("n", "q"), SIZES)
def test_steady_h_is_that_of_a_lyapunov_solver(n, q):
    ours, expected = linalg.tracker_steady(n, q, 2.0), oracle.h_infinity(n, q, 2.0)
    assert np.allclose(ours, expected, rtol=1e-9, atol=0)
    a, s, b = linalg.tracker_structure(n, q)
    assert np.array_equal(a, oracle.structure(n, q)[0])
    assert np.array_equal(b, oracle.structure(n, q)[1])
    binomial = s * [math.comb(n + q, i) * 2.0**i for i in range(1, n + q + 1)]
    assert np.allclose(np.linalg.solve(ours, np.eye(n + q)[0]), binomial, rtol=1e-8)


@pytest.mark.parametrize(("n", "q"), SIZES)
def test_gains_are_those_of_the_state_space_system(n, q):
    gains = tracker_gains(n, q)
    for i in range(1, n + 1):
        system, gone = oracle.filter_of(n, q, i), oracle.lost_of(n, q, i)
        omega = np.asarray([0.0, 0.3, 1.0, 4.0, 30.0])
        assert np.allclose(response(n, q, i, omega), oracle.magnitude(system, omega), rtol=1e-7, atol=1e-12)
        assert math.isclose(gains.white[i - 1], oracle.h2(system), rel_tol=1e-7)
        assert math.isclose(gains.worst[i - 1], oracle.l1(system), rel_tol=1e-5)
        assert math.isclose(gains.worst_bias[i - 1], oracle.l1(gone), rel_tol=1e-5)
        constant = oracle.magnitude(gone, 0.0)[0]
        assert math.isclose(gains.bias[i - 1], constant, rel_tol=1e-7)
        edge = gains.bandwidth[i - 1]
        assert np.allclose(oracle.magnitude(system, edge), edge ** (i - 1) / math.sqrt(2), rtol=1e-7)
        beyond = oracle.magnitude(system, edge * np.geomspace(1.001, 30, 400))
        assert np.all(beyond < (edge * np.geomspace(1.001, 30, 400)) ** (i - 1) / math.sqrt(2))


@pytest.mark.parametrize(("n", "q", "i"), [(3, 1, 2), (3, 2, 3), (2, 1, 1)])
def test_gains_scale_with_powers_of_mu(n, q, i):
    mu, system = 7.0, oracle.filter_of(n, q, i, 7.0)
    gains = tracker_gains(n, q)
    assert math.isclose(oracle.h2(system), gains.white[i - 1] * mu ** (i - 0.5), rel_tol=1e-6)
    assert np.allclose(oracle.magnitude(system, 3.0), response(n, q, i, np.asarray(3.0 / mu)) * mu ** (i - 1), rtol=1e-6)
    assert transfer(2, 1, 1) == [1, 3]  # (1 + 3 s) / (s + 1)^3
    assert lost(2, 1, 1) == [-3, -1]  # 1 - (1 + 3 s) / (s + 1)^3 = s^2 (3 + s) / (s + 1)^3


def test_the_signal_lost_never_costs_more_than_under_a_constant_derivative():
    for n, q in SIZES:
        gains = tracker_gains(n, q)
        assert np.allclose(gains.worst_bias, gains.bias, rtol=1e-9)


@pytest.mark.parametrize("i", [1, 2, 3])
def test_equal_bias_and_equal_bandwidth_are_what_they_say(i):
    n, q = 3, 2
    r = n - i + 1
    ratio = equal_bias(n, q, i)
    assert math.isclose(tracker_gains(n, q).bias[i - 1] / ratio**r, tracker_gains(n, 0).bias[i - 1], rel_tol=1e-12)
    ratio = equal_bandwidth(n, q, i)
    edge = tracker_gains(n, 0).bandwidth[i - 1]
    assert np.allclose(oracle.magnitude(oracle.filter_of(n, q, i, ratio), edge), edge ** (i - 1) / math.sqrt(2), rtol=1e-6)
    white = oracle.h2(oracle.filter_of(n, q, i, ratio)) / oracle.h2(oracle.filter_of(n, 0, i))
    assert math.isclose(relative_white(n, q, i, ratio), white, rel_tol=1e-6)
    tone = oracle.magnitude(oracle.filter_of(n, q, i, ratio), 20.0) / oracle.magnitude(oracle.filter_of(n, 0, i), 20.0)
    assert np.allclose(relative_tone(n, q, i, 20.0, ratio), tone, rtol=1e-6)


@pytest.mark.parametrize("noise", [{"bound": 1e-3}, {"intensity": 1e-5}])
def test_best_rate_is_the_minimum(noise):
    n, q, i, top = 3, 1, 2, 5.0
    best, gains = best_rate(n, q, i, derivative=top, **noise), tracker_gains(n, q)

    def cost(mu):
        bias = gains.worst_bias[1] * top / mu**2
        if "bound" in noise:
            return bias + gains.worst[1] * noise["bound"] * mu
        return bias**2 + gains.white[1] ** 2 * noise["intensity"] * mu**3

    grid = best.mu * np.linspace(0.5, 2, 3001)
    assert abs(grid[np.argmin(cost(grid))] / best.mu - 1) < 1e-3
    total = best.bias + best.noise if "bound" in noise else best.bias**2 + best.noise**2
    assert math.isclose(total, cost(best.mu), rel_tol=1e-12)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: best_rate(3, 0, 1, derivative=1.0, bound=1.0), "i >= 2"),
        (lambda: best_rate(3, 0, 2, derivative=1.0), "one of them"),
        (lambda: best_rate(3, 0, 2, derivative=-1.0, bound=1.0), "best_rate.derivative: given -1.0"),
        (lambda: best_rate(3, 0, 4, derivative=1.0, bound=1.0), "at most n = 3"),
        (lambda: tracker_gains(0, 0), "tracker.n: given 0"),
        (lambda: theorem1(3, 1, 1.9, 1.0), "mu > sqrt(n + q) = 2"),
        (lambda: theorem1(2, 0, 5.0, 0.01), "H_inf only"),
        (lambda: peak(2, 0, 5.0, np.asarray([1.0, -1.0])), "H(0) > 0"),
        (lambda: Tracker(2, 0, 3.0, [1.0, 2.0, 3.0]), "Tracker.start: given shape (3,)"),
        (lambda: Tracker(2, 0, 3.0, [[1.0, 2.0], [2.0, 1.0]]), "symmetric positive definite"),
        (lambda: DiscreteTracker(2, 0, 3.0, 0.1, [[1.0, 0.2], [0.1, 1.0]]), "symmetric positive definite"),
        (lambda: DiscreteTracker(2, 0, 3.0, 0.1, [1.0, 0.0]), "a positive number"),
    ],
)
def test_bad_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


STARTS = {"scalar": 0.7, "diagonal": [0.5, 2.0, 1.0], "matrix": [[1.0, 0.3, 0.0], [0.3, 2.0, -0.4], [0.0, -0.4, 1.5]]}


@pytest.mark.parametrize("kind", STARTS)
@pytest.mark.parametrize(("n", "q"), [(3, 0), (2, 1)])
def test_every_start_gives_the_gain_of_its_own_equation(kind, n, q):
    start, mu = np.asarray(STARTS[kind]), 3.0
    whole = np.diag(np.broadcast_to(start, (3,))) if start.ndim < 2 else start
    a, _, c = loops.structure(n, q)
    s = linalg.tracker_structure(n, q)[1]
    t, dt = 0.4, 0.1
    back = expm(-a * t)
    g = whole - oracle.h_infinity(n, q, mu)
    h = oracle.h_infinity(n, q, mu) + math.exp(-mu * t) * back.T @ g @ back
    assert np.allclose(s * np.asarray(Tracker(n, q, mu, start).gain(jnp.asarray(t))), np.linalg.solve(h, c[0]), rtol=1e-9)
    h, back = whole + dt * c.T @ c, expm(-a * dt)
    for k in range(5):
        ours = s * np.asarray(DiscreteTracker(n, q, mu, dt, start).gain(jnp.asarray(float(k))))
        assert np.allclose(ours, dt * np.linalg.solve(h, c[0]), rtol=1e-8)
        h = math.exp(-mu * dt) * back.T @ h @ back + dt * c.T @ c


def test_the_start_from_h_infinity_keeps_the_gain_constant():
    n, q, mu = 2, 1, 5.0
    tracker = Tracker(n, q, mu, linalg.tracker_steady(n, q, mu))
    steady = [math.comb(3, i) * mu**i for i in (1, 2, 3)]
    for t in (0.0, 0.1, 3.0):
        assert np.allclose(tracker.gain(jnp.asarray(t)), steady, rtol=1e-9)
    ts = 0.01 * np.arange(200)
    found = jaxobs.observe(tracker, ts, 0 * ts, xhat0=[1.0, 0.0]).xhat
    assert np.max(np.abs(found[:, 1])) > 1  # the steady gain peaks at once


@pytest.mark.parametrize(("start", "mu", "t"), [(1.0, 8.0, 0.5), ([1.0, 1.0, 1.0, 1e-4], 20.0, 0.33), (1.0, 40.0, 0.3)])
def test_transition_is_the_integrated_system(start, mu, t):
    n, q = 3, 1
    whole = np.diag(np.broadcast_to(np.asarray(start), (4,)))
    expected = oracle.transition(n, q, mu, whole, t)
    assert np.allclose(
        tracker_bounds.transition(n, q, mu, np.asarray(start), t), expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max()
    )


def test_transition_from_the_steady_gain_is_an_exponential():
    n, q, mu = 2, 1, 6.0
    a, _ = oracle.structure(n, q)
    closed = a - np.outer(np.linalg.solve(oracle.h_infinity(n, q, mu), np.eye(3)[0]), np.eye(3)[0])
    for t in (0.05, 0.4):
        assert np.allclose(tracker_bounds.transition_steady(n, q, mu, t), expm(closed * t), rtol=1e-7, atol=1e-9)


def test_peaks_obey_the_bound_which_tends_to_the_root_of_the_condition_number():
    table = [peak(3, 1, mu, 1.0) for mu in (10.0, 100.0, 1000.0)]
    assert all(1 <= one.value <= one.bound for one in table)
    assert table[0].bound > table[1].bound > table[2].bound
    uneven = peak(2, 0, 1e4, np.asarray([4.0, 1.0]))
    assert uneven.value <= uneven.bound
    assert abs(uneven.bound - 2) < 0.02
    static = [peak(3, 1, mu, None).value for mu in (50.0, 500.0)]
    assert abs(math.log10(static[1] / static[0]) - 3) < 0.02


def test_growth_is_the_largest_eigenvalue():
    for n, q in SIZES:
        a, _ = oracle.structure(n, q)
        assert math.isclose(tracker_bounds.growth(n, q), np.linalg.eigvalsh(a + a.T)[-1], abs_tol=1e-12)


def test_theorem_1_holds_where_it_promises_to():
    n, q, mu = 2, 1, 15.0
    bound = theorem1(n, q, mu, 1.0)
    assert bound.settled <= bound.T <= bound.printed_T
    h = oracle.h_infinity(n, q, mu)
    root = np.linalg.cholesky(h).T
    a, _ = oracle.structure(n, q)
    for t in (0.3, bound.settled * 1.001, bound.T):
        back = expm(-a * t)
        now = h + math.exp(-mu * t) * back.T @ (np.eye(3) - h) @ back
        difference = np.linalg.inv(h) - np.linalg.inv(now)
        c = np.eye(1, 3)
        # ||H^{1/2} X H^{-1/2}|| is the same for every square root of H
        expected = 2 * np.linalg.norm(root @ difference @ c.T @ c @ np.linalg.inv(root), 2)
        assert math.isclose(tracker_bounds.disturbance(n, q, mu, 1.0, t), expected, rel_tol=1e-6)
        assert t < bound.settled or expected <= mu / 2
    assert tracker_bounds.disturbance(n, q, mu, 1.0, bound.settled * 0.999) > mu / 2
    theta = tracker_bounds.start_over_steady(n, q, mu, 1.0)
    assert abs(np.linalg.eigvalsh(np.eye(3) - theta * h)[0]) < 1e-9


@pytest.mark.parametrize(
    ("sigma", "dt"), [(0.0, 1.0), (1.0, 1.0), (-0.5, 1.0), (float("nan"), 1.0), (0.5, 0.0), (0.5, float("inf"))]
)
def test_a_memory_outside_its_range_is_refused(sigma, dt):
    name = "dt" if sigma == 0.5 else "sigma"
    with pytest.raises(ValueError, match=rf"fading_rate.{name}: given .*; expected a"):
        fading_rate(sigma, dt)
