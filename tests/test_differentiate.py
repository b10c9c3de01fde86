"""differentiate: the derivative of a noisy record, its rate chosen from the record alone."""

import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

import jaxobs

DT = 0.01
TS = DT * np.arange(1000)
LATE = slice(400, None)


def record(sigma, seed=0, rate=2.0):
    """y = sin(rate t) + noise, and its true derivatives up to the second."""
    w = sigma * np.random.default_rng(seed).normal(size=TS.shape)
    truth = np.stack([np.sin(rate * TS), rate * np.cos(rate * TS), -(rate**2) * np.sin(rate * TS)], axis=1)
    return truth[:, 0] + w, truth


def rms(x):
    return float(np.sqrt(np.mean(np.square(np.asarray(x)))))


@pytest.mark.parametrize("sigma", [1e-3, 1e-2, 1e-1])
def test_the_derivative_of_a_noisy_sine(sigma):
    y, truth = record(sigma)
    miss = rms((jaxobs.differentiate(TS, y).xhat - truth[:, :2])[LATE, 1])
    backward = rms((np.diff(y, prepend=y[0]) / DT - truth[:, 1])[LATE])
    assert miss < backward / 5
    grid = [rms((jaxobs.differentiate(TS, y, mu=mu).xhat - truth[:, :2])[LATE, 1]) for mu in np.geomspace(1, 60, 12)]
    assert miss < 1.1 * min(grid)


def test_the_rate_depends_on_the_record_alone_and_grows_as_noise_falls():
    y, _ = record(0.1)
    one, other = (jaxobs.differentiate(TS, c * y) for c in (1.0, 1000.0))
    assert np.allclose(1000 * one.xhat, other.xhat, rtol=1e-8, atol=1e-6)  # no scale enters
    later = jaxobs.differentiate(TS + 7.0, y)
    assert np.allclose(one.xhat, later.xhat, atol=1e-6)
    quiet = jaxobs.differentiate(TS, record(1e-3)[0])
    assert rms(np.diff(quiet.xhat[LATE, 0] - np.sin(2 * TS[LATE]))) < rms(np.diff(one.xhat[LATE, 0] - np.sin(2 * TS[LATE])))


def test_second_derivative():
    y, truth = record(1e-3)
    estimate = jaxobs.differentiate(TS, y, order=2)
    assert estimate.xhat.shape == (1000, 3)  # y, y', y''
    assert rms((estimate.xhat - truth)[LATE, 2]) < 0.2 * rms(truth[:, 2])


def test_a_polynomial_comes_back_exactly():
    y = 1 - 2 * TS + 0.3 * TS**2
    estimate = jaxobs.differentiate(TS, y, mu=5.0, order=2, extra=0)
    assert np.allclose(estimate.xhat[LATE], np.stack([y, -2 + 0.6 * TS, 0.6 + 0 * TS], axis=1)[LATE], atol=1e-7)


def test_lost_samples_are_bridged():
    y, truth = record(1e-2)
    holes = y.copy()
    holes[np.random.default_rng(1).random(len(y)) < 0.2] = np.nan
    holes[:3] = np.nan
    holes[600:610] = np.nan
    estimate = jaxobs.differentiate(TS, holes)
    assert np.all(np.isfinite(estimate.xhat))
    assert estimate.diverged_at == jnp.inf
    assert np.array_equal(estimate.valid, np.isfinite(holes))
    assert np.all(np.asarray(estimate.innovation)[~np.isfinite(holes)] == 0)
    full = rms((jaxobs.differentiate(TS, y).xhat - truth[:, :2])[LATE, 1])
    assert rms((estimate.xhat - truth[:, :2])[LATE, 1]) < 3 * full


@pytest.mark.parametrize("q", [1, 2])
def test_integrators_help_against_a_tone_far_above_the_rate(q):
    y, _ = record(0.0)
    tone = 0.1 * np.sin(60 * TS)
    mu = 6.0
    plain = jaxobs.differentiate(TS, y + tone, mu=mu).xhat - jaxobs.differentiate(TS, y, mu=mu).xhat
    mild = jaxobs.differentiate(TS, y + tone, mu=mu, q=q).xhat - jaxobs.differentiate(TS, y, mu=mu, q=q).xhat
    assert rms(mild[LATE, 1]) < rms(plain[LATE, 1]) / 1.5**q


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"order": 0}, r"differentiate\.order"),
        ({"order": 1.0}, r"differentiate\.order"),
        ({"extra": -1}, r"differentiate\.extra"),
        ({"q": -1}, r"DiscreteTracker\.q"),
        ({"mu": 0.0}, r"DiscreteTracker\.mu"),
        ({"mu": float("nan")}, r"DiscreteTracker\.mu"),
        ({"order": 8, "q": 1}, r"differentiate\.order: given .* 11 states"),
        ({"y": np.zeros(30)}, r"differentiate\.y: given shape \(30,\); expected \(40,\)"),
        ({"y": np.zeros((40, 1))}, r"differentiate\.y: given shape"),
        ({"y": np.full(40, np.nan)}, "no finite sample"),
        ({"ts": np.zeros(40)}, r"differentiate\.ts"),
        ({"ts": np.arange(40.0)[::-1]}, "increasing"),
        ({"ts": np.r_[np.arange(39.0), 60.0]}, "even spacing"),
        ({"ts": np.arange(6.0), "y": np.zeros(6)}, "more than 6"),
    ],
)
def test_errors(as_users_have_it, changes, words):
    arguments = {"ts": np.arange(40.0), "y": np.sin(np.arange(40.0))} | changes
    with pytest.raises(ValueError, match=words):
        jaxobs.differentiate(arguments.pop("ts"), arguments.pop("y"), **arguments)


SINGLE = """
import numpy as np, jaxobs
ts = 0.01 * np.arange(1000)
y = np.sin(2 * ts) + 0.01 * np.random.default_rng(0).normal(size=1000)
y[100:110] = np.nan
for order in (2,):
    xhat = np.asarray(jaxobs.differentiate(ts, y, order=order).xhat)
    assert xhat.dtype == np.float32 and np.isfinite(xhat).all()
    print(np.sqrt(np.mean((xhat[400:, 1] - 2 * np.cos(2 * ts[400:])) ** 2)))
"""


def test_single_precision_as_a_fresh_user_has_it():
    done = subprocess.run([sys.executable, "-W", "error", "-c", SINGLE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    misses = [float(line) for line in done.stdout.split()]
    assert max(misses) < 0.2


def test_causal_for_a_given_rate_and_honest_about_a_chosen_one():
    y, _ = record(0.1)
    changed = np.where(np.arange(1000) < 700, y, y + 5.0)
    one, other = (jaxobs.differentiate(TS, signal, mu=8.0) for signal in (y, changed))
    assert np.array_equal(one.xhat[:700], other.xhat[:700])
    assert one.mu == 8.0
    chosen = jaxobs.differentiate(TS, y)
    again = jaxobs.differentiate(TS, y, mu=chosen.mu)
    assert np.allclose(chosen.xhat, again.xhat, rtol=1e-12, atol=1e-12)
