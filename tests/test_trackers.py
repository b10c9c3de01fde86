"""The trackers of paper 001: gains against their equations, the filter against a plain loop, poles, exactness, no peaking."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import tracker as oracle
from scipy.linalg import expm

import jaxobs
from jaxobs.designs import fading_rate
from jaxobs.observers import DiscreteTracker, IntegralHighGain, Tracker
from jaxobs.observers._fading import fading_memory_gain
from jaxobs.plants import IntegratorChain

SIZES = [(1, 0), (3, 0), (5, 0), (1, 1), (3, 1), (3, 2)]


def signs(n, q):
    return np.asarray([1.0] * q + [-1.0 if q else 1.0] * n)


def graded(matrix_cond):
    """What is left of 1e-13 after an inversion."""
    return 1e-11 * matrix_cond


@pytest.mark.parametrize(("n", "q"), SIZES)
def test_gain_equals_the_lyapunov_equation(n, q):
    mu, start = 3.0, 0.7
    gain = jax.jit(jax.vmap(Tracker(n, q, mu, start).gain))(jnp.asarray([0.05, 0.4, 1.5]))
    for t, ours in zip((0.05, 0.4, 1.5), gain, strict=True):
        h = oracle.continuous_h(n, q, mu, start, t)
        expected = np.linalg.inv(h)[:, 0]
        d = np.sqrt(np.diag(h))
        cond = np.linalg.cond(h / np.outer(d, d))
        assert np.allclose(signs(n, q) * ours, expected, rtol=0, atol=graded(cond) * np.max(np.abs(expected)))


@pytest.mark.parametrize(("n", "q"), SIZES)
def test_gain_starts_at_its_prior_and_tends_to_the_binomial_one(n, q):
    mu, size = 20.0, n + q
    tracker = Tracker(n, q, mu, 2.0)
    gain = jax.jit(lambda t: tracker.gain(t))
    assert np.allclose(gain(jnp.asarray(0.0)), 0.5 * np.eye(size)[0], atol=1e-9 * mu**size)  # H(0)^-1 e_1
    steady = [math.comb(size, i) * mu**i for i in range(1, size + 1)]
    for t in (10.0, 1e6):
        assert np.allclose(gain(jnp.asarray(t)), steady, rtol=1e-9)
    a, _, c = oracle.structure(n, q)
    closed = (a - np.outer(signs(n, q) * steady, c)) / mu
    scale = mu ** np.arange(size)
    closed = closed / scale[:, None] * scale[None, :]
    assert np.allclose(np.linalg.matrix_power(closed + np.eye(size), size), 0, atol=1e-10)  # every eigenvalue is -mu


@pytest.mark.parametrize("sigma", [0.2, 0.6, 0.95])
def test_gain_of_paper_001_34(sigma):
    dt = 0.01
    expected = [1 - sigma**3, 1.5 * (1 - sigma) ** 2 * (1 + sigma) / dt, (1 - sigma) ** 3 / dt**2]
    assert np.allclose(fading_memory_gain(3, jnp.asarray(1 - sigma), jnp.asarray(dt)), expected, rtol=1e-13)


@pytest.mark.parametrize("size", range(1, 9))
def test_steady_gain_is_the_fixed_point_of_the_recursion(size):
    sigma, dt = 0.5, 0.1
    back = expm(-dt * np.eye(size, k=1))
    h = np.zeros((size, size))
    for k in range(400):  # the sum (31), term by term: 2^-400 k^{2 N} is nothing
        row = np.linalg.matrix_power(back, k)[0]
        h += dt * sigma**k * np.outer(row, row)
    d = np.sqrt(np.diag(h))
    cond = np.linalg.cond(h / np.outer(d, d))
    expected = dt * np.linalg.solve(h / np.outer(d, d), np.eye(size)[0] / d[0]) / d
    ours = jax.jit(fading_memory_gain, static_argnums=0)(size, jnp.asarray(1 - sigma), jnp.asarray(dt))
    assert np.allclose(ours, expected, rtol=1e-14 * cond)


@pytest.mark.parametrize(("n", "q"), SIZES)
def test_discrete_gain_equals_the_recursion(n, q):
    mu, dt, count = 15.0, 0.02, 60
    gains = jax.jit(lambda start: jax.vmap(DiscreteTracker(n, q, mu, dt, start).gain)(jnp.arange(float(count))))
    for start in (1.0, 1e-4):
        for h, gain in zip(oracle.discrete_h(n, q, mu, dt, start, count), gains(jnp.asarray(start)), strict=True):
            expected = dt * np.linalg.inv(h)[:, 0]
            d = np.sqrt(np.diag(h))
            cond = np.linalg.cond(h / np.outer(d, d))
            assert np.allclose(signs(n, q) * gain * d, expected * d, rtol=0, atol=1e-13 * cond * np.max(np.abs(expected * d)))


@pytest.mark.parametrize(("n", "q"), [*SIZES, (8, 0), (5, 3), (10, 0)])
def test_all_discrete_poles_lie_at_sigma(n, q):
    size = n + q
    gain_for = jax.jit(lambda mu, dt: DiscreteTracker(n, q, mu, dt).gain(jnp.asarray(5.0)))
    f, _, _ = oracle.held_first_order(n, q, 1.0)
    for sigma in (0.3, 0.9):
        mu = fading_rate(sigma, 1.0)
        gain = np.asarray(gain_for(mu, 1.0))
        closed = f - np.outer(signs(n, q) * gain, f[0])  # (I - G C) F
        off = closed - sigma * np.eye(size)
        # One N-fold eigenvalue: the power N of what is off vanishes, up to the rounding of its terms; the gain is a sum in
        # which up to three digits cancel.
        terms = np.linalg.matrix_power(np.abs(off) + 1e-16 * np.abs(closed), size - 1) @ np.abs(closed)
        assert np.max(np.abs(np.linalg.matrix_power(off, size))) <= 1e-13 * np.max(terms)
        assert np.allclose(gain_for(mu / 0.01, 0.01) * 0.01 ** np.arange(size), gain, rtol=1e-12)


@pytest.mark.parametrize(("n", "q"), [(3, 0), (2, 1), (3, 2)])
@pytest.mark.parametrize("start", [None, 1.0, 1e-3])
def test_observe_equals_the_plain_loop(n, q, start):
    mu, dt, count = 12.0, 0.02, 120
    tracker = DiscreteTracker(n, q, mu, dt, start)
    ts = dt * np.arange(count)
    ys = np.sin(3 * ts) + 0.1 * np.random.default_rng(1).normal(size=count)
    xhat0 = np.linspace(1.0, -1.0, n)
    if start is None:
        gains = [signs(n, q) * np.asarray(tracker.gain(jnp.asarray(0.0)))] * count
    else:
        gains = [dt * np.linalg.inv(h)[:, 0] for h in oracle.discrete_h(n, q, mu, dt, start, count)]
    expected = oracle.run(n, q, dt, gains, ys, xhat0)
    ours = jaxobs.observe(tracker, ts, ys, xhat0=xhat0).xhat
    assert np.allclose(ours, expected, rtol=0, atol=1e-9 * np.max(np.abs(expected), axis=0))


@pytest.mark.parametrize(("n", "q"), [(1, 0), (5, 0), (4, 1), (4, 2)])
def test_polynomials_are_followed_without_error_and_without_delay(n, q):
    dt, mu, count = 0.05, 8.0, 400
    ts = dt * np.arange(count)
    p = np.poly1d(np.random.default_rng(n).uniform(0.5, 1, min(n, 4)))  # degree < n
    expected = np.stack([np.polyder(p, i)(ts) if i else p(ts) for i in range(n)], axis=1)
    if q:  # a straight line between samples is a cubic plus dt^2/12 of its second derivative, in the mean
        expected += dt**2 / 12 * np.stack([np.polyder(p, i + 2)(ts) for i in range(n)], axis=1)
    for start in (None, 1.0):
        estimate = jaxobs.observe(DiscreteTracker(n, q, mu, dt, start), ts, p(ts), xhat0=np.zeros(n))
        late = np.abs(estimate.xhat - expected)[-20:]  # sigma^k k^{N-1} is below 1e-50 here
        assert np.all(late <= 1e-12 * np.max(np.abs(p(ts))) * (1 / dt + mu) ** np.arange(n))


def test_a_weak_prior_needs_n_samples():
    ts = 0.1 * np.arange(10)
    xhat = jaxobs.observe(DiscreteTracker(3, 0, 2.0, 0.1, 1e-9), ts, 1 + 2 * ts + 3 * ts**2, xhat0=np.zeros(3)).xhat
    assert np.allclose(xhat[2:], np.stack([1 + 2 * ts + 3 * ts**2, 2 + 6 * ts, np.full(10, 6.0)], axis=1)[2:], rtol=1e-3)


def peaks(n, q, start):
    """max |xhat| of each state from xhat0 = e_1 while y = 0, for mu = 20, 60, 200."""
    ts = 1e-4 * np.arange(5000)
    rows = []
    for mu in (20.0, 60.0, 200.0):
        estimate = jaxobs.observe(DiscreteTracker(n, q, mu, 1e-4, start), ts, 0 * ts, xhat0=np.eye(n)[0])
        rows.append(np.max(np.abs(estimate.xhat), axis=0))
    return np.asarray(rows)


@pytest.mark.parametrize(("n", "q"), [(3, 0), (3, 1)])
def test_a_gentle_start_does_not_peak_and_a_steady_one_does(n, q):
    gentle, steady = peaks(n, q, 1.0), peaks(n, q, None)
    assert np.max(gentle) <= 1  # for every mu: the bound sqrt(cond H(0)) is 1
    growth = np.log(steady[2] / steady[0]) / np.log(10)
    assert np.all(np.abs(growth - np.arange(n)) < 0.15)  # x_i peaks like mu^{i-1}
    assert steady[2, 1] > 40 * gentle[2, 1]


@pytest.mark.parametrize(("n", "q"), [(2, 0), (3, 2)])
def test_the_late_tracker_is_the_integral_observer_of_an_integrator_chain(n, q):
    mu, dt = 4.0, 0.01
    ts = dt * np.arange(2000)
    ys = np.sin(ts)
    alphas = [math.comb(n + q, i) for i in range(1, n + q + 1)]
    one = jaxobs.observe(Tracker(n, q, mu), ts, ys, xhat0=np.zeros(n)).xhat
    other = jaxobs.observe(IntegralHighGain(IntegratorChain(n), alphas, mu, q), ts, ys, xhat0=np.zeros(n)).xhat
    assert np.allclose(one[-200:], other[-200:], atol=1e-10)  # e^{-mu t} is 1e-31 by then
    assert np.max(np.abs(one[:200] - other[:200])) > 1e-2


@pytest.mark.parametrize("q", [1, 2])
def test_the_printed_q_integral_form_gives_the_same_estimates_and_drifts(q):
    n, gamma, dt = 2, 3.0, 0.01
    ts = dt * np.arange(4000)
    ys = 1 + np.sin(ts)
    size = n + q
    gain = np.asarray([math.comb(size, i) * gamma**i for i in range(1, size + 1)])

    def printed(z, y):  # paper 000, (37) and (40): xi' = (xi_2, ..., y), etahat' = A~ etahat + gain (xi_1 - etahat_1)
        xi, etahat = z[:q], z[q:]
        return np.concatenate([xi[1:], [y], np.append(etahat[1:], 0.0) + gain * (xi[0] - etahat[0])])

    z = oracle.rk4(printed, np.zeros(q + size), ys, dt)
    observer = IntegralHighGain(IntegratorChain(n), [math.comb(size, i) for i in range(1, size + 1)], gamma, q)
    xhat = jaxobs.observe(observer, ts, ys, xhat0=np.zeros(n)).xhat
    # Both are the same linear recursion in other coordinates; the printed one carries rounding of size eps |xi_1| |gain|.
    drift = np.max(np.abs(z[:, 0]))
    assert np.max(np.abs(z[:, 2 * q :] - xhat)) <= 10 * np.finfo(float).eps * drift * np.max(gain)
    assert drift > 0.9 * ts[-1] ** q / math.factorial(q)
    assert np.max(np.abs(xhat)) < 10
