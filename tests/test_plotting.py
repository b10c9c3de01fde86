"""The pictures: what stands on the axes is what the run, the study, the search or the proof says."""

import dataclasses
import subprocess
import sys

import equinox as eqx
import jax
import numpy as np
import picture_cases as cases
import pytest
import scipy.linalg
import scipy.signal
import scipy.stats
from matplotlib.figure import Figure

import jaxobs
from jaxobs import designs, hurwitz, metrics, noise, plotting, tuning
from jaxobs.certificates import Corners
from jaxobs.observers import ContinuousDiscreteKalman, ContinuousKalman, DiscreteTracker, HighGain, IntegralHighGain
from jaxobs.plants import IntegratorChain
from jaxobs.plotting import innovations, pole_map, regions, studies, style
from jaxobs.plotting._covariance import believed

pytestmark = pytest.mark.usefixtures("hardly_optimised")  # runs of 200 samples: compiling is what costs


def lines(ax):
    """Label -> y data."""
    return {line.get_label(): np.asarray(line.get_ydata(), float) for line in ax.lines}


def band(ax):
    """Lower and upper edge of the first band of the axes, at its times."""
    path = ax.collections[0].get_paths()[0].vertices
    half = (len(path) - 3) // 2
    low, high = path[1 : half + 1], path[half + 2 : -1][::-1]
    return (low, high) if low[0, 1] <= high[0, 1] else (high, low)


def legend(part):
    return [text.get_text() for one in part.legends for text in one.get_texts()]


def test_an_estimate_stands_over_the_truth_with_its_samples():
    run = cases.run()
    figure = plotting.estimate(run, title="one")
    first, second = figure.axes
    np.testing.assert_array_equal(lines(first)["truth"], run.x[:, 0])
    np.testing.assert_array_equal(lines(second)["estimate"], run.xhat[:, 1])
    valid = np.asarray(run.valid[:, 0])
    np.testing.assert_array_equal(lines(first)["measurement"], np.asarray(run.y[:, 0])[valid])
    lost = next(line for line in first.lines if line.get_label() == "lost sample")
    np.testing.assert_array_equal(lost.get_xdata(), cases.TS[~valid])
    assert 5 < np.count_nonzero(~valid) < 50
    assert "measurement" not in lines(second)
    low, high = band(first)
    own = np.abs(np.asarray(run.innovation))[valid]
    np.testing.assert_allclose(high[:, 1] - low[:, 1], 4 * 1.4826 * np.median(own))
    np.testing.assert_allclose((low + high)[:, 1] / 2, np.asarray(run.y - run.innovation)[:, 0], atol=1e-12)
    assert set(legend(figure)) == {"truth", "estimate", "measurement", "lost sample", "±2 sigma of the innovation"}


def test_a_batch_has_the_quantiles_of_its_runs():
    runs = cases.batch()
    (_, ax) = plotting.estimate(runs, names=["angle", "rate"]).axes
    low, high = band(ax)
    expected = np.quantile(np.asarray(runs.xhat)[:, :, 1], [0.05, 0.5, 0.95], axis=0)
    np.testing.assert_allclose(low[:, 1], expected[0])
    np.testing.assert_allclose(high[:, 1], expected[2])
    np.testing.assert_allclose(lines(ax)["median estimate"], expected[1])
    np.testing.assert_array_equal(lines(ax)["truth"], runs.x[0, :, 1])
    assert ax.get_ylabel() == "rate"
    other = eqx.tree_at(lambda runs: runs.x, runs, runs.x + np.arange(8.0)[:, None, None])
    (ax, _) = plotting.estimate(other).axes
    errors = np.asarray(other.xhat - other.x)[:, :, 0]
    np.testing.assert_allclose(lines(ax)["median error"], np.median(errors, axis=0))
    assert ax.get_ylabel() == "error of x1"
    assert "truth" not in lines(ax)


def test_runs_that_diverged_are_left_out_and_counted():
    runs = cases.batch()
    gone = eqx.tree_at(lambda runs: runs.xhat, runs, runs.xhat.at[3, 100:].set(np.nan))
    figure = plotting.estimate(gone)
    kept = np.delete(np.asarray(runs.xhat)[:, :, 0], 3, axis=0)
    np.testing.assert_allclose(lines(figure.axes[0])["median estimate"], np.median(kept, axis=0))
    assert "1 of 8 runs diverged" in figure.get_suptitle()


def test_the_band_of_a_kalman_observer_is_its_covariance():
    """Against the recursion of the covariance form, P- = F P F' + Q."""
    run = cases.filtered()
    _, ax = plotting.estimate(run, observer=cases.kalman(), errors=True).axes
    low, high = band(ax)
    p, c, f, found = np.eye(2), np.eye(1, 2), np.array([[1.0, 0.01], [0.0, 1.0]]), []
    for _ in cases.TS:
        p = p - p @ c.T @ c @ p / (c @ p @ c.T + 0.0025)
        found.append(2 * np.sqrt(p[1, 1]))
        p = f @ p @ f.T + np.diag([0.0, 0.003])
    np.testing.assert_allclose(high[:, 1], found, rtol=1e-9)
    np.testing.assert_allclose(low[:, 1], -high[:, 1])
    errors = np.asarray(run.xhat - run.x)[:, 1]
    assert np.mean(np.abs(errors) <= high[:, 1]) > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("kind", [ContinuousDiscreteKalman, ContinuousKalman])
def test_the_band_of_a_continuous_kalman_observer_is_the_steady_covariance(kind):
    """In the steady state of a double integrator, by the Riccati equations of scipy."""
    plant, dt, discrete = IntegratorChain(2), 0.01, kind is ContinuousDiscreteKalman
    r = 0.0025 if discrete else 0.0025 * dt
    more = {"dt": dt} if discrete else {}
    observer = kind(plant, np.array([[0.3]]), np.array([[r]]), np.eye(2) * 1e-3, **more)
    ts = np.arange(1500) * dt
    around = {"x0": [0.1, 0.0], "xhat0": [0.0, 0.0], "ts": ts, "key": jax.random.key(0), "noise": noise.Gaussian(0.05)}
    run = jaxobs.simulate(plant, observer, **around)
    found = believed("estimate", observer, run)
    f, q = np.array([[1.0, dt], [0.0, 1.0]]), 0.3 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    if discrete:
        p = scipy.linalg.solve_discrete_are(f.T, np.eye(2, 1), q, np.array([[r]]))
        expected = np.diag(p - np.outer(p[:, 0], p[0]) / (p[0, 0] + r))
        assert found.innovation[-1, 0, 0] == pytest.approx(p[0, 0] + r, rel=1e-6)
    else:
        expected = np.diag(
            scipy.linalg.solve_continuous_are(np.eye(2, k=1).T, np.eye(2, 1), np.diag([0, 0.3]), np.array([[r]]))
        )
    np.testing.assert_allclose(found.deviations[-1] ** 2, expected, rtol=1e-5)


def test_measurements_of_a_filter_stand_with_the_state_they_measure():
    first, second = plotting.estimate(cases.filtered()).axes
    assert "measurement" in lines(first)
    assert "measurement" not in lines(second)


def test_a_record_has_no_truth_unless_it_is_given():
    run = cases.run()
    estimate = jaxobs.Estimate(run.ts, run.xhat, run.y, run.valid, run.innovation, run.diverged_at)
    assert "truth" not in lines(plotting.estimate(estimate).axes[0])
    np.testing.assert_array_equal(lines(plotting.estimate(estimate, x=run.x).axes[1])["truth"], run.x[:, 1])
    (ax,) = plotting.estimate(run, states=2, span=(0.5, 1.0)).axes
    assert (len(lines(ax)["truth"]), ax.get_ylabel()) == (51, "x2")


def test_the_peak_that_is_marked_is_that_of_the_metric():
    runs = {f"gamma = {g:g}": cases.study().sel(q=0, gamma=g) for g in (2.0, 8.0)}
    single = {name: cases.run() for name in ("one", "two")}
    (ax,) = plotting.peaking(single, states=2).axes
    marked = [line for line in ax.lines if line.get_marker() == "o" and len(line.get_xdata()) == 1]
    peak = np.asarray(jaxobs.metrics.evaluate(metrics.Peak(), cases.run()))[1]
    assert [float(line.get_ydata()[0]) for line in marked] == [pytest.approx(peak)] * 2
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    at = cases.TS[np.argmax(np.abs(np.asarray(cases.run().xhat - cases.run().x)[:, 1]))]
    assert words[0] == f"one: {peak:.3g} at {at:.3g} s"
    assert ax.get_yscale() == "log"
    for one, ds in zip(plotting.peaking(runs, scale="linear").axes, "ab", strict=True):
        drawn = [line for line in one.lines if len(line.get_xdata()) > 1]
        assert len(drawn) == 2
        assert ds
    errors = (runs["gamma = 8"]["xhat"] - runs["gamma = 8"]["x"]).transpose("seed", "time", "state").values[:, :, 1]
    drawn = [line for line in plotting.peaking(runs).axes[1].lines if len(line.get_xdata()) > 1]
    np.testing.assert_allclose(drawn[1].get_ydata(), np.sqrt(np.mean(errors**2, axis=0)))


def test_a_data_set_of_runs_makes_a_line_a_member():
    (ax,) = plotting.peaking(cases.study().isel(seed=0), states=1, until=1.0).axes
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert len(words) == 6
    assert words[0].startswith("q = 0, gamma = 2: ")
    assert words[0].endswith(" at 0 s")


def test_the_least_cell_of_a_noise_map_is_that_of_the_study():
    ds = cases.study()
    figure = plotting.noise_map(ds)
    median = ds["rmse"].median("seed")
    for i, ax in enumerate(figure.axes):
        values = median.isel(state=i).transpose("q", "gamma").values
        np.testing.assert_allclose(ax.images[0].get_array(), values)
        row, column = np.unravel_index(np.argmin(values), values.shape)
        (frame,) = ax.patches
        assert (frame.get_x() + 0.5, frame.get_y() + 0.5) == (column, row)
        written = {tuple(map(int, text.get_position())): float(text.get_text()) for text in ax.texts}
        for (r, c), value in np.ndenumerate(values):
            assert written[c, r] == pytest.approx(value, rel=5.1e-3)
        assert [text.get_text() for text in ax.get_xticklabels()] == ["2", "4", "8"]
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("gamma", "q")
    turned = plotting.noise_map(ds, "peak", rows="gamma").axes[0]
    assert (turned.get_xlabel(), turned.get_ylabel(), turned.get_title(loc="left")) == ("q", "gamma", "peak error of x1")


def test_lanes_that_diverged_are_no_numbers():
    ds = cases.study().copy(deep=True)
    ds["diverged_at"][1, 2, :] = 0.5
    ds["diverged_at"][0, 0, 1] = 0.5
    figure = plotting.noise_map(ds)
    values = figure.axes[0].images[0].get_array()
    assert values.mask.tolist() == [[False] * 3, [False, False, True]]
    expected = np.median(np.delete(ds["rmse"].values[0, 0, :, 0], 1))
    assert values[0, 0] == pytest.approx(expected)
    assert "7 of 36 runs diverged" in figure.get_suptitle()


def test_runs_that_never_settle_are_the_worst_and_not_left_out():
    ds = cases.study()[["rmse", "diverged_at"]].copy(deep=True)
    ds.rmse[1, 1, 1:] = np.inf  # the least cell of before: most of its runs never get there
    values = ds.rmse.median("seed")
    assert np.isinf(values[1, 1]).all()
    figure = plotting.noise_map(ds)
    least = np.unravel_index(np.argmin(values[:, :, 0].values), values.shape[:2])
    box = next(patch for patch in figure.axes[0].patches if patch.get_label() == "least")
    assert (box.get_y() + 0.5, box.get_x() + 0.5) == least
    assert "∞" in [text.get_text() for text in figure.axes[0].texts]
    assert "10 of 72 values are infinite" in figure.get_suptitle()
    curve = plotting.noise_curve(ds)
    drawn = next(line for line in curve.axes[0].lines if line.get_label() == "q = 1")
    assert np.isnan(drawn.get_ydata()).tolist() == [False, True, False]
    assert "10 of 72 values are infinite" in plotting.convergence(ds).get_suptitle()


def test_members_that_differ_late_keep_their_own_lines():
    ds = cases.study().assign_coords(gamma=[100.01, 100.02, 100.03])
    figure = plotting.noise_curve(ds.isel(q=[0]), axis=None)
    assert len(figure.axes[0].lines) == 1
    figure = plotting.convergence(ds.isel(q=0))
    assert [line.get_label().partition(":")[0] for line in figure.axes[0].lines] == [
        "gamma = 100.01", "gamma = 100.02", "gamma = 100.03",
    ]  # fmt: skip


def test_a_noise_curve_has_the_quantiles_over_the_seeds():
    ds = cases.study()
    figure = plotting.noise_curve(ds, law={"q = 0": [1.0, 2.0, 3.0]})
    ax = figure.axes[1]
    for q in (0, 1):
        expected = ds["rmse"].sel(q=q, state=1).quantile([0.05, 0.5, 0.95], "seed").transpose("quantile", "gamma").values
        np.testing.assert_allclose(lines(ax)[f"q = {q}"], expected[1])
        path = ax.collections[q].get_paths()[0].vertices[:, 1]
        assert {expected[0, 0], expected[2, 0]} <= {float(f"{v:.15g}") for v in path} | set(path)
    dotted = [line for line in ax.lines if line.get_linestyle() == ":" and len(line.get_xdata())]
    assert [line.get_ydata().tolist() for line in dotted] == [[1.0, 2.0, 3.0]]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["q = 0", "q = 1", "law"]


def test_convergence_is_the_running_mean_with_its_interval():
    values = np.random.default_rng(0).normal(3, 1e-3, 40)
    count, mean, half = studies.running_mean(np.append(values, np.nan))
    assert count.tolist() == list(range(2, 41))
    for n in (2, 7, 40):
        i = n - 2
        assert mean[i] == pytest.approx(np.mean(values[:n]), rel=1e-12)
        assert half[i] == pytest.approx(1.96 * np.std(values[:n], ddof=1) / np.sqrt(n), rel=1e-9)
    ax = plotting.convergence(cases.study().sel(gamma=8.0)).axes[0]
    own = cases.study()["rmse"].sel(q=1, gamma=8.0, state=0).values
    label = next(label for label in lines(ax) if label.startswith("q = 1"))
    assert lines(ax)[label][-1] == pytest.approx(np.mean(own))


def test_the_sectors_decide_condition_10():
    """All poles within the inner sector: every q_i > 0; one beyond the outer: not; N = 2: nothing in between."""
    rng = np.random.default_rng(0)
    between = 0
    weights = jax.jit(hurwitz.q_from_alphas)
    for _ in range(200):
        size = int(rng.integers(1, 4)) * 2
        inner, outer = pole_map.sectors(size)
        angles = rng.uniform(0, 88, size // 2)
        upper = -rng.uniform(0.3, 3, size // 2) * np.exp(1j * np.deg2rad(angles))
        holds = np.all(np.asarray(weights(np.poly([*upper, *upper.conj()]).real[1:])) > 0)
        if np.all(angles < inner - 1e-6):
            assert holds
        elif np.any(angles > outer + 1e-6):
            assert not holds
        else:
            between += 1
            assert size > 2
    assert between > 10
    assert pole_map.sectors(2) == (45.0, 45.0)


def test_poles_are_those_of_the_error_and_the_legend_says_the_margin():
    butterworth = HighGain(cases.PLANT, [1.2, 1.0], 6.0)
    found = {"printed": HighGain(cases.PLANT, [3.0, 2.0], 6.0), "fast turn": butterworth, "alphas": [3.0, 3.0, 1.0]}
    (ax,) = plotting.poles(found).axes
    drawn = {
        line.get_label().split(":")[0]: np.asarray(line.get_xdata()) + 1j * np.asarray(line.get_ydata()) for line in ax.lines
    }
    np.testing.assert_allclose(np.sort(drawn["printed"].real), [-12.0, -6.0])
    closed = np.array([[-7.2, 1.0], [-36.0, 0.0]])  # A - L C
    np.testing.assert_allclose(np.sort_complex(drawn["fast turn"]), np.sort_complex(np.linalg.eigvals(closed)))
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "printed: margin 6 1/s; (10) holds" in words
    assert "fast turn: margin 3.6 1/s; (10) fails, q1 = -0.56" in words
    assert any("N = 3, all within 45°" in text for text in words)
    assert any("to 60°" in text for text in words)
    assert sorted(round(patch.theta2 - patch.theta1, 6) for patch in ax.patches) == [90.0, 120.0]


def test_local_poles_are_those_of_the_jacobian():
    one = HighGain(cases.PLANT, [3.0, 2.0], 2.0)
    (ax,) = plotting.poles(one, x=[[0.3, 0.0], [2.0, 1.0]]).axes
    dots = next(line for line in ax.lines if line.get_marker() == "." and len(line.get_xdata()))
    jacobians = [np.array([[-6.0, 1.0], [-8.0 + np.cos(angle), 0.0]]) for angle in (0.3, 2.0)]
    expected = np.concatenate([np.linalg.eigvals(f) for f in jacobians])
    np.testing.assert_allclose(np.sort_complex(dots.get_xdata() + 1j * dots.get_ydata()), np.sort_complex(expected), atol=1e-9)


def test_step_observers_have_the_unit_circle():
    (ax,) = plotting.poles(DiscreteTracker(2, 0, 5.0, 0.01), plant=IntegratorChain(2)).axes
    circle = lines(ax)["unit circle"]
    assert np.max(np.abs(circle)) == pytest.approx(1, abs=1e-4)
    own = next(line for line in ax.lines if line.get_label().startswith("DiscreteTracker"))
    largest = np.max(np.abs(own.get_xdata() + 1j * own.get_ydata()))
    assert largest == pytest.approx(np.exp(-0.05), rel=1e-5)
    assert not ax.patches


def test_the_ladder_shows_where_each_proof_begins():
    rungs = cases.rungs()
    (ax,) = plotting.proof_ladder(rungs, at=6.0).axes
    known = [rung for rung in rungs if rung.smallest_gamma is not None]
    solid = [patch for patch in ax.patches if patch.get_alpha() is not None and patch.get_width() > 0]
    np.testing.assert_allclose([patch.get_x() for patch in solid], [rung.smallest_gamma for rung in known])
    np.testing.assert_allclose([patch.get_x() + patch.get_width() for patch in solid], ax.get_xlim()[1])
    marks = [float(line.get_xdata()[0]) for line in ax.lines if line.get_marker() == "o" and len(line.get_xdata())]
    assert marks == [rung.gamma for rung in known]
    words = [text.get_text() for text in ax.texts]
    assert sum(text.startswith("not certified") for text in words) == len(rungs) - len(known) == 3
    assert "unstable" not in " ".join(words)
    assert [text.get_text().split("\n")[0] for text in ax.get_yticklabels()] == [rung.name for rung in rungs]


def test_slopes_away_from_zero_say_nothing_of_larger_gammas():
    """A point box whose observer is stable at gamma = 1 and unstable at 8: nothing may be painted as certified there."""
    alphas = [1.18651, 60.2138, 1.82492, 0.0475354]
    psi = np.array([-233.8, 4.605, 2.197, -0.1387])
    smallest = designs.corners_gamma(alphas=alphas, slopes=np.stack([psi, psi], 1))
    closed = np.eye(4, k=1) + np.eye(4)[:, 3:] * psi - (alphas * 8.0 ** np.arange(1, 5))[:, None] * np.eye(4)[:1]
    assert np.max(np.linalg.eigvals(closed).real) > 0
    assert smallest < 8
    (_, _, _, _, rung, _) = designs.ladder(IntegratorChain(4), alphas=alphas, lipschitz=240.0, slopes=np.stack([psi, psi], 1))
    assert not rung.upward
    ax = plotting.proof_ladder([rung]).axes[0]
    assert [patch.get_x() + patch.get_width() for patch in ax.patches if patch.get_width() > 0] == pytest.approx([smallest])
    assert all(one.upward for one in cases.rungs())


def test_a_certificate_that_does_not_hold_is_not_drawn_as_a_proof():
    region = dataclasses.replace(cases.region(), level=50 * cases.region().level)
    assert not region.verify()
    (ax,) = plotting.certified_region(region).axes
    assert any("not certified: e'P e" in text.get_text() for text in ax.get_legend().get_texts())
    rung = next(one for one in cases.rungs() if one.certificate is not None)
    broken = dataclasses.replace(rung, certificate=region)
    marks = [
        line for line in plotting.proof_ladder([broken]).axes[0].lines if line.get_marker() == "o" and len(line.get_xdata())
    ]
    assert [line.get_markerfacecolor() for line in marks] == ["white"]


def test_what_is_proved_absent_has_a_row_of_its_own():
    certificate = cases.region()  # positive: it proves, and nothing is absent
    (ax,) = plotting.proof_ladder(cases.rungs(), absent={"here": certificate}).axes
    assert [text.get_text() for text in ax.texts][-1] == "proved"
    false = dataclasses.replace(certificate, rate=1e6)
    (ax,) = plotting.proof_ladder(cases.rungs(), absent={"here": false}).axes
    assert [text.get_text() for text in ax.texts][-1] == "not proved"


def test_the_border_of_a_region_is_the_level_of_its_lyapunov_function():
    certificate = cases.region()
    (ax,) = plotting.certified_region(certificate, starts=6).axes
    p = np.asarray(certificate.p)
    border = next(line.get_xydata() for line in ax.lines if line.get_label().startswith("proved"))
    np.testing.assert_allclose(np.einsum("ti,ij,tj->t", border, p, border), certificate.level)
    sides = [line for line in ax.lines if line.get_color() == style.GREY]
    np.testing.assert_allclose(sorted(float(line.get_ydata()[0]) for line in sides), [-1.1, 1.1])
    assert "6 of 6 errors stay" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_errors_that_leave_are_shown_and_counted():
    certificate = cases.region()
    paths = regions.simulated(certificate, 5, seed=1)
    p = np.asarray(certificate.p)
    for path in paths:
        values = np.einsum("ti,ij,tj->t", path, p, path)
        assert values[0] == pytest.approx(certificate.level)
        assert np.all(np.diff(values) < 0)
        assert not regions.leaves(path, p, certificate.level)
    assert regions.leaves(paths[0][::-1] * 1.01, p, certificate.level)
    (ax,) = plotting.certified_region(certificate, runs=cases.run()).axes
    assert any("errors stay" in text.get_text() for text in ax.get_legend().get_texts())


def test_the_shadow_of_a_region_is_the_largest_reach_in_its_plane():
    """n = 3: sup |e1| over the ellipsoid, by the support function."""
    p = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.2], [0.1, 0.2, 3.0]])
    one = Corners(
        a=((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)), b=((), (), ()), c=(), lower=(), upper=(),
        output=((1.0, 0.0, 0.0),), gain=((0.0,), (0.0,), (0.0,)), p=tuple(map(tuple, p.tolist())), rate=0.0,
    )  # fmt: skip
    (ax,) = plotting.certified_region(one, states=(1, 3), starts=2).axes
    border = next(line.get_xydata() for line in ax.lines if line.get_label().startswith("proved"))
    np.testing.assert_allclose(np.max(border, axis=0), np.sqrt(np.diag(np.linalg.inv(p)))[[0, 2]], rtol=1e-4)


def test_innovation_statistics_are_those_of_scipy():
    rng = np.random.default_rng(0)
    values = scipy.signal.lfilter([1.0], [1.0, -0.5], rng.normal(size=400))
    found = innovations.autocorrelation(values, 5)
    centred = values - values.mean()
    full = scipy.signal.correlate(centred, centred)[399:405] / np.sum(centred**2)
    np.testing.assert_allclose(found, full, atol=1e-12)
    run = cases.run()
    own = innovations.statistics("innovation", run, 1, 1.0, 10, None, None)
    assert np.all(own.ts >= 1.0)
    assert len(own.values) == np.count_nonzero(np.asarray(run.valid)[cases.TS >= 1.0])
    assert np.mean((own.values / own.deviations) ** 2) == pytest.approx(1)


def test_innovations_of_a_kalman_observer_have_the_variance_it_believes():
    observer, run = cases.kalman(), cases.filtered()
    found = innovations.statistics("innovation", run, 1, 0.0, 20, None, observer)
    assert found.believed
    assert found.deviations[0] == pytest.approx(np.sqrt(1.0025))
    low, high = scipy.stats.chi2.ppf([1e-4, 1 - 1e-4], 201) / 201
    assert low < np.mean((found.values / found.deviations) ** 2) < high
    figure = plotting.innovation(run, observer=observer, lags=20)
    sequence, correlation, _, squares = figure.axes
    assert "as believed" in sequence.get_title(loc="left")
    assert correlation.get_title(loc="left").startswith(
        f"{np.count_nonzero(np.abs(found.correlation[1:]) > found.white)} of 20"
    )
    assert "95% of white noise" in lines(squares)


def test_fronts_and_comparisons_show_their_points():
    observer = HighGain(cases.PLANT, [3.0, 2.0], 6.0)
    given = [(1.0, 2.0, 0.0, False), (2.0, 3.0, 0.0, False), (1.5, 4.0, 1.0, True)]
    points = tuple(tuning.Point(r, {"noise": v}, w, observer, None, cases.region(), d) for r, v, w, d in given)
    (ax,) = plotting.front(tuning.Front(points, ((3.0, 2.5),), "1/s", 1.0)).axes
    np.testing.assert_array_equal(lines(ax)["weight 0"], [2.0, 3.0])
    filled = [tuple(scatter.get_facecolor()[0][:3]) == (1.0, 1.0, 1.0) for scatter in ax.collections]
    assert filled == [False, True]
    assert any(np.all(np.asarray(line.get_xdata()) == 3.0) for line in ax.lines)
    row = tuning.Row("a", 1, 2.0, 1.9, 2.1, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 8, 0)
    after = dataclasses.replace(row, observer="b", rmse=1.5, change=-0.25, change_low=-0.3, change_high=-0.2)
    (ax,) = plotting.comparison(tuning.Comparison((row, after), 0.0, 0.05, 8, 1)).axes
    assert [text.get_text() for text in ax.get_yticklabels()] == ["b"]
    assert ax.get_xlabel() == "RMSE / RMSE of a"
    marks = [line.get_xydata().tolist() for line in ax.lines if line.get_marker() == "o"]
    assert [[0.75, 0.0]] in marks


def test_pictures_stand_among_others():
    big = Figure(figsize=(12, 5), layout="constrained")
    left, right = big.subfigures(1, 2)
    assert plotting.estimate(cases.run(), figure=left) is big
    ax = right.subplots()
    assert plotting.poles([3.0, 2.0], ax=ax) is big
    assert len(left.axes) == 2
    assert ax.lines
    big.canvas.draw()


def test_a_notebook_shows_a_picture_without_pyplot():
    assert plotting.poles([3.0, 2.0])._repr_png_().startswith(b"\x89PNG")
    heavy = ["matplotlib.pyplot", "optax", "cvxpy", "plotly"]
    code = f"import sys, jaxobs; jaxobs.plotting.estimate; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


def test_lines_differ_in_a_grey_print():
    """Any two of a panel: in lightness by 15 of 100, or in their dashes; every colour is darker than a white page."""
    for count, ordered in ((6, False), (5, True), (8, True)):
        looks = [style.series(i, count, ordered=ordered) for i in range(count)]
        for i, one in enumerate(looks):
            assert style.lightness(one["color"]) < 75
            for other in looks[:i]:
                apart = abs(style.lightness(one["color"]) - style.lightness(other["color"])) > 15
                assert apart or one["linestyle"] != other["linestyle"]
    assert style.lightness("white") == pytest.approx(100)
    assert style.lightness("#808080") == pytest.approx(53.585, abs=1e-2)
    cells = [style.lightness(colour[:3]) for colour in style.mpl.colormaps[style.SEQUENTIAL](np.linspace(0, 1, 50))]
    assert np.all(np.diff(cells) > 0)


BAD = [
    (lambda: plotting.estimate(3), "estimate.run: given int without ts"),
    (lambda: plotting.estimate(cases.run(), states=[3]), "states: given 3; expected numbers from 1 to 2"),
    (lambda: plotting.estimate(cases.run(), names=["a"]), "names: given 1 names; expected 2 names"),
    (lambda: plotting.estimate(cases.run(), span=(5, 6)), "span: given"),
    (lambda: plotting.estimate(cases.run(), deviations=np.ones(3)), "deviations: given shape"),
    (lambda: plotting.estimate(cases.run(), observer=HighGain(cases.PLANT, [3.0, 2.0], 6.0)), "an observer with a covariance"),
    (lambda: plotting.estimate(cases.run(), observer=cases.kalman()), "the one that made the run"),
    (lambda: plotting.estimate(cases.study()), "no axis beside seed, time and state"),
    (lambda: plotting.estimate(cases.study()[["rmse"]]), "given a data set without x and xhat"),
    (lambda: plotting.estimate(cases.run(), figure=3), "figure: given int"),
    (lambda: plotting.peaking({}), "runs: given dict; expected {label: Trajectory}"),
    (lambda: plotting.peaking(cases.run(), scale="sqrt"), "scale: given 'sqrt'"),
    (lambda: plotting.noise_map(3), "ds: given int"),
    (lambda: plotting.noise_map(cases.study(), "rms"), "metric: given 'rms'; expected one of"),
    (lambda: plotting.noise_map(cases.study(), columns="seed"), "columns: given 'seed'"),
    (lambda: plotting.noise_map(cases.study().isel(q=0, gamma=0)), "two axes beside the seed"),
    (lambda: plotting.noise_curve(cases.study(), axis="alphas"), "axis: given 'alphas'; expected an axis of numbers: q, gamma"),
    (lambda: plotting.noise_curve(cases.study(), law=[1.0]), r"law: given shape \(1,\)"),
    (lambda: plotting.convergence(cases.study().isel(seed=[0])), "ds: given 1 seed"),
    (lambda: plotting.poles("abc"), "expected an observer or alphas"),
    (lambda: plotting.poles({"a": [3.0, 2.0], "b": DiscreteTracker(2, 0, 5.0, 0.01)}, plant=IntegratorChain(2)), "one kind"),
    (lambda: plotting.poles(DiscreteTracker(2, 0, 5.0, 0.01)), "plant: given None"),
    (lambda: plotting.proof_ladder([]), "rungs: given none"),
    (lambda: plotting.proof_ladder(cases.rungs(), at=-1.0), "at: given -1.0"),
    (lambda: plotting.certified_region(3), "certificate: given int; expected Regional or Corners"),
    (lambda: plotting.certified_region(cases.region(), states=(1, 1)), "two different numbers"),
    (lambda: plotting.innovation(cases.run(), lags=300), "310 or more"),
    (lambda: plotting.innovation(cases.batch()), "run: given 8 runs"),
    (lambda: plotting.innovation(cases.run(), variance=-1.0), "variance: given"),
    (lambda: plotting.comparison([]), "cases: given"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "message"), BAD, ids=[message[:40] for _, message in BAD])
def test_a_bad_argument_is_named(call, message, as_users_have_it):
    with pytest.raises(ValueError, match=f"^plotting.*{message}"):
        call()


def test_integral_observers_take_part():
    (ax,) = plotting.poles({"q = 2": IntegralHighGain(cases.PLANT, hurwitz.binomial(4), 6.0, q=2)}).axes
    assert any("q = 2: margin 6" in text.get_text() for text in ax.get_legend().get_texts())


@pytest.mark.slow
def test_a_real_study_is_drawn_as_the_drawn_one():
    """The layout of tests/picture_cases.study, made by jaxobs.study."""

    def make(q):
        return jaxobs.grid(IntegralHighGain(cases.PLANT, hurwitz.binomial(2 + q), 6.0, q=q), gamma=list(cases.GAMMAS))

    measured = {"peak": metrics.Peak(), "rmse": metrics.RMSE(after=1.0)}
    around = {"keys": jaxobs.Seeds(jax.random.key(0), 6), "noise": noise.Gaussian(0.05), "save": 20}
    ds = jaxobs.study(cases.PLANT, jaxobs.variants(make, q=[0, 1]), metrics=measured, **around, **cases.STARTS)
    like = cases.study()
    for name, variable in like.data_vars.items():
        assert (ds[name].dims, ds[name].shape) == (variable.dims, variable.shape)
        assert ds[name].attrs.get("units", "") in (variable.attrs.get("units", ""), "x")
    assert len(plotting.noise_map(ds).axes) == len(plotting.noise_curve(ds).axes) == 2
    (ax, _) = plotting.peaking(ds.isel(seed=0)).axes
    assert len(ax.get_legend().get_texts()) == 6
    plotting.convergence(ds.sel(gamma=8.0)).canvas.draw()
