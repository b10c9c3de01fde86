"""Comparisons against runs by hand, closed forms, bootstrap and coverage; bandwidths against quadrature; what is refused."""

import dataclasses
import json

import jax
import numpy as np
import pytest
import scipy.integrate
import scipy.stats
from oracles import floors as oracle

import jaxobs
from jaxobs.integrators import RK4, Euler
from jaxobs.noise import Gaussian
from jaxobs.observers import CurrentLuenberger, DiscreteKalman, HighGain, IntegralHighGain, Luenberger, Sampled
from jaxobs.plants import Discretised, IntegratorChain, Pendulum
from jaxobs.tuning._linearised import passband
from jaxobs.tuning._paired import relative_change, root_mean_square
from jaxobs.tuning.comparison import Comparison, compare

pytestmark = pytest.mark.usefixtures("hardly_optimised")

PLANT, DT = Pendulum(), 0.02
OBSERVERS = {"paper": Luenberger(PLANT, [[12.0], [32.0]]), "slower": Luenberger(PLANT, [[6.0], [8.0]])}
AROUND = {
    "ts": DT * np.arange(250), "x0": [1.0, 0.0], "xhat0": [0.0, 0.0], "keys": jaxobs.Seeds(jax.random.key(2), 8),
    "noise": Gaussian(0.1), "disturbance": Gaussian(2.0), "signal": jaxobs.signals.Sine(0.5), "after": 3.0,
}  # fmt: skip


@pytest.fixture(scope="module")
def mismatched():
    plants = [PLANT, Pendulum(1.3)]
    return compare(OBSERVERS, plants, certified={"paper": 2.5, "slower": "none"}, floor=[0.01, 0.1], **AROUND)


def transient(gain, ts):
    """e (T, 2) of the pendulum and its observer without noise, by SciPy."""

    def flow(t, both):
        x, z = both[:2], both[2:]
        u, innovation = 0.5 * np.sin(t), x[0] - z[0]
        own = [[one[1], np.sin(one[0]) + u * np.cos(one[0])] for one in (x, z)]
        return np.concatenate([own[0], own[1] + gain * innovation])

    found = scipy.integrate.solve_ivp(flow, (0, ts[-1]), [1.0, 0, 0, 0], t_eval=ts, method="DOP853", rtol=1e-9, atol=1e-12).y
    return (found[2:] - found[:2]).T


def test_rows_are_the_runs_of_a_study(mismatched):
    """The same seeds run one by one: root mean squares over seeds and plants, settling and peak of a run without noise, and
    its ISE by SciPy."""
    around = {name: AROUND[name] for name in ("ts", "x0", "xhat0", "signal")}
    assert [(row.observer, row.state) for row in mismatched.rows] == [("paper", 1), ("paper", 2), ("slower", 1), ("slower", 2)]
    assert (mismatched.seeds, mismatched.plants) == (8, 2)
    squares = {}
    for name, observer in OBSERVERS.items():
        for a in (1.0, 1.3):
            for seed in range(8):
                run = jaxobs.simulate(
                    Pendulum(a), observer, key=AROUND["keys"][seed], noise=Gaussian(0.1), disturbance=Gaussian(2.0), **around
                )
                squares[name, a, seed] = np.mean(np.asarray(run.xhat - run.x)[150:] ** 2, axis=0)
    for row in mismatched.rows:
        mean = np.mean([v[row.state - 1] for (name, _, _), v in squares.items() if name == row.observer])
        assert row.rmse == pytest.approx(np.sqrt(mean), rel=1e-9)
        first = mismatched.row("paper", row.state)
        assert row.change == pytest.approx(row.rmse / first.rmse - 1, abs=1e-12)
        assert row.rmse_low < row.rmse < row.rmse_high
        assert (row.lanes, row.diverged) == (16, 0)
        run = jaxobs.simulate(PLANT, OBSERVERS[row.observer], **around)
        error, ts = np.abs(np.asarray(run.xhat - run.x))[:, row.state - 1], AROUND["ts"]
        assert row.peak == pytest.approx(np.max(error), rel=1e-9)
        fine = DT / 8 * np.arange(8 * 249 + 1)
        square = transient(np.asarray(OBSERVERS[row.observer].gain[:, 0]), fine)[:, row.state - 1] ** 2
        assert row.squared_error == pytest.approx(np.trapezoid(square, fine), rel=2e-3)
        last = ts[np.nonzero(error > 0.05 * row.peak)[0][-1]]
        assert last <= row.settling_time <= last + DT
    assert mismatched.row("paper", 2).change_low == mismatched.row("paper", 2).change_high == 0


def test_pairing_narrows_the_interval(mismatched):
    row, first = mismatched.row("slower", 2), mismatched.row("paper", 2)
    paired = np.log1p(row.change_high) - np.log1p(row.change_low)
    apart = np.hypot(np.log(row.rmse_high / row.rmse_low), np.log(first.rmse_high / first.rmse_low))
    assert 0 < paired < apart


def test_table_and_plain_data(mismatched):
    text = str(mismatched)
    lines = text.splitlines()
    assert lines[0].split()[:3] == ["observer", "x_i", "RMSE"]
    assert lines[0].endswith("certified")
    assert "diverged" not in lines[0]
    assert lines[1].endswith("2.5")
    assert lines[4].endswith("none")
    assert "8 seeds and 2 plants or starts" in text
    data = json.loads(json.dumps(mismatched.to_dict(), allow_nan=False))
    assert data["rows"][2]["observer"] == "slower"
    assert data["rows"][0]["floor"] == 0.01
    assert data["rows"][3]["rmse"] == mismatched.rows[3].rmse
    row = dataclasses.replace(
        mismatched.rows[0], settling_time=np.inf, bandwidth=np.nan, floor=None, certified=None, diverged=3
    )
    one = Comparison((row,), 3.0, 0.05, 8, 1)
    assert one.to_dict()["rows"][0]["settling_time"] == "inf"
    assert one.to_dict()["rows"][0]["bandwidth"] is None
    assert "3/16" in str(one)
    assert "floor" not in str(one)
    assert "left out" in str(one)
    with pytest.raises(ValueError, match="observer: given 'fast'"):
        mismatched.row("fast", 1)
    with pytest.raises(ValueError, match="Name both"):
        mismatched.row("paper")


@pytest.mark.slow
def test_a_grid_of_plants_is_the_list_of_them(mismatched):
    found = compare(OBSERVERS, jaxobs.grid(PLANT, a=[1.0, 1.3]), state=2, **AROUND)
    assert [row.state for row in found.rows] == [2, 2]
    for row in found.rows:
        expected = mismatched.row(row.observer, 2)
        assert row.rmse == pytest.approx(expected.rmse, rel=1e-6)
        assert (row.change_low, row.change_high) == pytest.approx((expected.change_low, expected.change_high), rel=1e-4)
        assert row.settling_time == pytest.approx(expected.settling_time, rel=1e-6)


def test_a_diverged_run_is_counted_and_left_out():
    """An unstable gain overflows under every seed: the other row and the table stand."""
    bad = Luenberger(PLANT, [[12.0], [-4e4]])  # e^{194 t}: infinite in float64 after 4 s
    around = AROUND | {"x0": [0.0, 0.0], "signal": jaxobs.signals.Sine(0.0), "after": 1.0, "state": 1}
    found = compare({"good": OBSERVERS["paper"], "bad": bad}, PLANT, **around)
    good_row, bad_row = found.rows
    assert np.isfinite([good_row.rmse, good_row.rmse_low, good_row.rmse_high]).all()
    assert (good_row.diverged, bad_row.diverged, bad_row.lanes) == (0, 8, 8)
    assert np.isnan([bad_row.rmse, bad_row.change, bad_row.bandwidth]).all()
    assert bad_row.fastest_pole == pytest.approx(max(abs(np.roots([1, 12, -4e4 - 1]))))
    assert bad_row.settling_time == 0, "from no error the run without noise has none"
    assert "8/8" in str(found)


def test_intervals_are_those_of_the_bootstrap():
    rng = np.random.default_rng(0)
    first = rng.chisquare(20, 200)
    second = 0.5 * first * rng.lognormal(0, 0.2, 200)
    found, changed = root_mean_square(first), relative_change(second, first)
    again = scipy.stats.bootstrap((first,), lambda m: np.sqrt(np.mean(m)), vectorized=False, rng=1, n_resamples=2000)
    assert (found.low, found.high) == pytest.approx(tuple(again.confidence_interval), rel=5e-3)

    def change(a, b):
        return np.sqrt(np.mean(a) / np.mean(b)) - 1

    again = scipy.stats.bootstrap((second, first), change, paired=True, vectorized=False, rng=1, n_resamples=2000)
    assert (changed.low, changed.high) == pytest.approx(tuple(again.confidence_interval), abs=5e-3)
    assert changed.high - changed.low < 0.05


@pytest.mark.parametrize("seeds", [5, pytest.param(20, marks=pytest.mark.slow)])
def test_intervals_cover_in_95_of_100_cases(seeds):
    """Mean squares of 30 independent errors a seed: the share of intervals that hold the truth."""
    rng = np.random.default_rng(1)
    common, own = rng.normal(size=(2, 2000, seeds, 30))
    first = np.mean(common**2, axis=2)
    second = np.mean((0.6 * common + 0.4 * own) ** 2, axis=2)
    truth = np.sqrt(0.6**2 + 0.4**2)
    single, pair = [root_mean_square(m) for m in first], [relative_change(*both) for both in zip(second, first, strict=True)]
    assert np.mean([one.low <= 1 <= one.high for one in single]) == pytest.approx(0.95, abs=0.012)
    assert np.mean([one.low <= truth - 1 <= one.high for one in pair]) == pytest.approx(0.95, abs=0.012)


def test_few_and_no_seeds():
    assert np.isnan(root_mean_square(np.zeros(0))).all()
    assert root_mean_square(np.array([4.0]))[0] == 2
    assert np.isnan(root_mean_square(np.array([4.0]))[1:]).all()
    assert root_mean_square(np.zeros(3)) == (0, 0, 0)
    assert np.isnan(relative_change(np.ones(3), np.zeros(3))).all()


def test_bandwidths_of_flow_observers():
    """Two integrators, gains (3, 2) g: T = (3 g s + 2 g^2) / (s^2 + 3 g s + 2 g^2), poles g and 2 g; one integrator more."""
    plant, g = IntegratorChain(2), 5.0
    x, u = np.zeros(2), np.zeros(0)
    found = passband(HighGain(plant, [3.0, 2.0], g), plant, jax.numpy.asarray(x), jax.numpy.asarray(u), DT)

    def response(w):
        return (3 * g * 1j * w + 2 * g**2) / (-(w**2) + 3 * g * 1j * w + 2 * g**2)

    assert found.fastest_pole == pytest.approx(2 * g)
    assert abs(response(found.bandwidth)) == pytest.approx(np.sqrt(0.5), rel=1e-9)
    assert found.noise_bandwidth == pytest.approx(oracle.noise_bandwidth(response), rel=1e-6)
    more = passband(IntegralHighGain(plant, [3.0, 3.0, 1.0], g, 1), plant, jax.numpy.asarray(x), jax.numpy.asarray(u), DT)

    def filtered(w):  # xhat_1 = (a_2 s + a_3) / (s^3 + a_1 s^2 + a_2 s + a_3) y
        s = 1j * w
        return (3 * g**2 * s + g**3) / (s**3 + 3 * g * s**2 + 3 * g**2 * s + g**3)

    assert abs(filtered(more.bandwidth)) == pytest.approx(np.sqrt(0.5), rel=1e-9)
    assert more.noise_bandwidth == pytest.approx(oracle.noise_bandwidth(filtered), rel=1e-6)
    assert more.fastest_pole == pytest.approx(g, rel=1e-4), "a triple pole, to the cube root of rounding"


def test_bandwidths_of_step_observers():
    """The current form with y in hand has T = C [(I - K C) (z I - F (I - K C))^-1 F K + K]; sampling keeps a slow filter."""
    plant, dt = IntegratorChain(2), 0.05
    model, gain = Discretised(plant, RK4(), dt), np.array([[0.3], [1.2]])
    x, u = jax.numpy.zeros(2), jax.numpy.zeros(0)
    found = passband(CurrentLuenberger(model, gain), plant, x, u, dt)
    f, c = np.array([[1, dt], [0, 1.0]]), np.eye(1, 2)
    keep = np.eye(2) - gain @ c

    def response(w):  # xhat = keep z + K y,  z+ = F xhat
        z = np.exp(1j * w * dt)
        return (c @ (keep @ np.linalg.solve(z * np.eye(2) - f @ keep, f @ gain) + gain))[0, 0]

    assert abs(response(found.bandwidth)) == pytest.approx(np.sqrt(0.5), rel=1e-9)
    assert found.noise_bandwidth == pytest.approx(oracle.noise_bandwidth(response, np.pi / dt), rel=1e-6)
    assert found.fastest_pole == pytest.approx(np.max(np.abs(np.log(np.linalg.eigvals(f @ keep)))) / dt)
    slow = HighGain(plant, [3.0, 2.0], 1.0)
    through, direct = (passband(one, plant, x, u, 0.01) for one in (Sampled(slow, RK4(), 0.01), slow))
    assert through == pytest.approx(direct, rel=0.02)


@pytest.mark.slow
def test_what_has_no_passband():
    plant, u = Pendulum(), jax.numpy.zeros(1)
    moving = DiscreteKalman(Discretised(plant, Euler(), DT), [[1.0]], [[0.01]], np.eye(2))
    assert np.isnan(passband(moving, plant, jax.numpy.zeros(2), u, DT)).all()
    unstable = passband(Luenberger(plant, [[1.0], [0.5]]), plant, jax.numpy.zeros(2), u, DT)
    assert np.isnan(unstable[:2]).all()
    assert np.isfinite(unstable.fastest_pole)


def test_bad_arguments_are_named(as_users_have_it):
    for name, value, message in (
        ("observers", {}, "observers: given none"),
        ("observers", OBSERVERS["paper"], "observers: given Luenberger"),
        ("observers", {"a": jaxobs.grid(OBSERVERS["paper"], gain=np.ones((1, 2, 1)))}, r"observers\['a'\]: given Family"),
        ("plant", [], "plant: given none"),
        ("plant", OBSERVERS["paper"], "plant: given Luenberger"),
        ("state", 0, "state: given 0; expected numbers from 1 to 2"),
        ("state", [1, 1], r"state: given \[1, 1\]"),
        ("band", 0.0, "band: given 0.0"),
        ("after", 9.0, "after: given 9.0; expected at most 4.98 s"),
        ("floor", [1.0], "floor: given 1 numbers; expected 2"),
        ("certified", {"other": 1.0}, "certified: given 'other'"),
        ("keys", None, "key"),
    ):
        with pytest.raises(ValueError, match=message):
            compare(**({"observers": OBSERVERS, "plant": PLANT} | AROUND | {name: value}))
