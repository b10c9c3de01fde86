"""Each running metric against a plain formula on whole trajectories."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from jaxobs.metrics import RMSE, Consistency, NoiseGain, Peak, SettlingTime, Whiteness, evaluate, rmse

T, N, P = 40, 3, 2
RNG = np.random.default_rng(2)
TS = 1.0 + 0.1 * np.arange(T)  # a run that does not start at zero


@pytest.fixture
def run():
    """Errors that shrink, and now and then a lost sample."""
    x = RNG.normal(size=(T, N))
    error = RNG.normal(size=(T, N)) * np.exp(-np.arange(T) / 8)[:, None]
    made = SimpleNamespace(ts=TS, x=x, xhat=x + error, innovation=RNG.normal(size=(T, P)), valid=RNG.random((T, P)) < 0.8)
    return SimpleNamespace(**{name: jnp.asarray(value) for name, value in vars(made).items()})


def error(run):
    return np.asarray(run.xhat - run.x)


def root_mean_square(e):
    return np.sqrt(np.mean(e**2, axis=0))


def test_rmse(run):
    np.testing.assert_allclose(evaluate(RMSE(), run), root_mean_square(error(run)), rtol=1e-13)
    np.testing.assert_allclose(rmse(run.x, run.xhat), root_mean_square(error(run)), rtol=1e-13)
    late = root_mean_square(error(run)[TS >= 2.05])
    np.testing.assert_allclose(evaluate(RMSE(after=2.05), run), late, rtol=1e-13)
    np.testing.assert_allclose(evaluate(NoiseGain(sigma=0.2, after=2.05), run), late / 0.2, rtol=1e-13)
    assert np.isnan(evaluate(RMSE(after=99.0), run)).all()


def test_after_includes_its_own_sample(run):
    np.testing.assert_allclose(evaluate(RMSE(after=TS[-1]), run), np.abs(error(run)[-1]), rtol=1e-13)


def test_truth_may_be_given_apart(run):
    estimate = SimpleNamespace(ts=run.ts, xhat=run.xhat, innovation=run.innovation, valid=run.valid)
    assert (evaluate(RMSE(), estimate, run.x) == evaluate(RMSE(), run)).all()


def test_peak(run):
    assert (evaluate(Peak(), run) == np.max(np.abs(error(run)), axis=0)).all()


def test_settling_time(run):
    tolerance = 0.1
    expected = []
    for e in np.abs(error(run)).T:
        outside = np.flatnonzero(e > tolerance)
        expected.append(0 if outside.size == 0 else np.inf if outside[-1] == T - 1 else TS[outside[-1]] - TS[0])
    assert 0 < max(expected) < np.inf
    np.testing.assert_allclose(evaluate(SettlingTime(tolerance), run), expected, rtol=1e-13)


def test_settling_time_at_its_ends(run):
    """Never outside: 0. Outside at the last sample: infinity."""
    run.xhat = run.x + jnp.asarray(np.where(np.arange(T) == T - 1, 1.0, 0.0)[:, None] * [0.0, 1.0, 0.05])
    assert evaluate(SettlingTime(0.1), run).tolist() == [0, np.inf, 0]


def test_a_diverged_run_shows_in_every_error_metric(run):
    for bad in (np.nan, np.inf):
        run.xhat = run.xhat.at[20:, 1].set(bad)
        others = [0, 2]
        for metric in (RMSE(), Peak(), NoiseGain(sigma=0.2)):
            value = evaluate(metric, run)
            assert not np.isfinite(value[1])
            assert np.isfinite(value[jnp.asarray(others)]).all()
        assert evaluate(SettlingTime(0.1), run)[1] == np.inf


def test_consistency(run):
    valid, squares = np.asarray(run.valid), np.asarray(run.innovation) ** 2 / 0.7
    expected = [np.mean(squares[valid[:, i], i]) for i in range(P)]
    np.testing.assert_allclose(evaluate(Consistency(variance=0.7), run), expected, rtol=1e-13)
    late = [np.mean(squares[valid[:, i] & (TS >= 3.05), i]) for i in range(P)]
    np.testing.assert_allclose(evaluate(Consistency(variance=0.7, after=3.05), run), late, rtol=1e-13)
    run.valid = jnp.zeros((T, P), bool)
    assert np.isnan(evaluate(Consistency(variance=0.7), run)).all()


def test_consistency_is_one_for_the_right_variance():
    count = 20_000
    white = SimpleNamespace(
        ts=jnp.arange(count, dtype=float), x=jnp.zeros((count, 1)), xhat=jnp.zeros((count, 1)),
        innovation=jnp.asarray(RNG.normal(size=(count, 1)) * 0.3), valid=jnp.ones((count, 1), bool),
    )  # fmt: skip
    assert abs(evaluate(Consistency(variance=0.09), white)[0] - 1) < 5 * np.sqrt(2 / count)


def ljung_box(series, lags):
    """Q and its chi-square tail, for a series whose mean is known to be zero."""
    count = len(series)
    r = np.asarray([np.sum(series[lag:] * series[: count - lag]) for lag in range(lags + 1)])
    r = r[1:] / r[0]
    statistic = count * (count + 2) * np.sum(r**2 / (count - np.arange(1, lags + 1)))
    return r, scipy.stats.chi2.sf(statistic, lags)


def test_whiteness_is_the_test_of_ljung_and_box(run):
    run.innovation = run.innovation.at[5, 0].set(jnp.nan)
    run.valid = run.valid.at[5, 0].set(False)
    result = evaluate(Whiteness(lags=5), run)
    for i in range(P):
        series = np.where(run.valid[:, i], run.innovation[:, i], 0)  # lost samples count as zeros
        r, p_value = ljung_box(series, 5)
        np.testing.assert_allclose(result["autocorrelation"][i], r, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(result["p_value"][i], p_value, rtol=1e-9)


def p_values(innovations):
    """One for each lane of (lanes, T)."""
    count = innovations.shape[1]
    zeros, ts, valid = jnp.zeros((count, 1)), jnp.arange(count, dtype=float), jnp.ones((count, 1), bool)

    @jax.jit
    @jax.vmap
    def each(series):
        lane = SimpleNamespace(ts=ts, x=zeros, xhat=zeros, innovation=series[:, None], valid=valid)
        return evaluate(Whiteness(lags=8), lane)["p_value"][0]

    return np.asarray(each(jnp.asarray(innovations)))


def test_p_value_is_uniform_under_white_noise_and_small_under_a_bias_or_correlation():
    white = np.random.default_rng(3).normal(size=(400, 1000))
    assert scipy.stats.kstest(p_values(white), "uniform").pvalue > 1e-3
    coloured = white.copy()
    for k in range(1, coloured.shape[1]):
        coloured[:, k] += 0.3 * coloured[:, k - 1]
    assert np.max(p_values(coloured)) < 1e-3
    assert np.max(p_values(white + 0.5)) < 1e-3


def test_whiteness_needs_more_samples_than_lags(run):
    short = SimpleNamespace(**{name: value[:5] for name, value in vars(run).items()})
    for lags, known in ((4, True), (5, False), (8, False)):
        result = evaluate(Whiteness(lags=lags), short)
        assert np.isfinite(result["p_value"]).all() == np.isfinite(result["autocorrelation"]).all() == known
        assert known or np.isnan(result["p_value"]).all()


@pytest.mark.parametrize("after", [0.0, 99.0])
def test_the_gradient_of_an_rmse_is_finite_at_no_error_and_where_nothing_counts(run, after):
    def total(xhat):
        moved = SimpleNamespace(**vars(run) | {"xhat": xhat})
        return jnp.sum(evaluate(RMSE(after), moved)) + jnp.sum(rmse(run.x, xhat))

    assert (jax.grad(total)(run.x) == 0).all()
    assert np.isfinite(jax.grad(total)(run.xhat)).all()
