"""The synthesis bench: its measures against closed forms, its short form here, the whole of it in the slow run."""

import json

import numpy as np
import pytest
import scipy.linalg

from jaxobs.bench import chain_table, frontier, frozen, growth, measures
from jaxobs.bench.dmvt_table import dmvt_rows, largest_joint_slope
from jaxobs.bench.least_gain import least_gain
from jaxobs.bench.rows import GainRow, Pair
from jaxobs.bench.run import SynthesisBench, run
from jaxobs.certificates import load
from jaxobs.designs._dynamics import stationary
from jaxobs.designs.polytope import Polytope
from jaxobs.report import bench_cli, bench_text

RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def bench():
    return run(short=True)


def without_channels(f: np.ndarray) -> Polytope:
    n = len(f)
    return Polytope(f, np.zeros((n, 0)), np.zeros((0, n)), np.zeros(0), np.zeros(0), np.eye(1, n))


def random_stable(n: int, *, step: bool = False) -> np.ndarray:
    f = RNG.normal(size=(n, n))
    values = np.linalg.eigvals(f)
    return f / (1.1 * np.abs(values).max()) if step else f - (0.3 + values.real.max()) * np.eye(n)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_covariance_is_the_kronecker_solution(n):
    """vec X = -(I (x) F + F (x) I)^-1 vec G G', and for steps vec X = (I - F (x) F)^-1 vec G G'."""
    g = RNG.normal(size=(n, 2))
    for step in (False, True):
        f, eye = random_stable(n, step=step), np.eye(n)
        operator = np.eye(n * n) - np.kron(f, f) if step else -(np.kron(eye, f) + np.kron(f, eye))
        expected = np.linalg.solve(operator, (g @ g.T).ravel()).reshape(n, n)
        np.testing.assert_allclose(stationary(f, g, step=step), expected, rtol=1e-9, atol=1e-12)


def test_covariance_scales_exactly_where_gains_spread_over_decades():
    """In the coordinates e_i / theta^i and the time theta t the high-gain error is that of theta = 1."""
    alphas, theta, n = np.array([5.0, 10, 10, 5, 1]), 4096.0, 5
    t = theta ** np.arange(1, n + 1)
    plain = stationary(np.eye(n, k=1) - np.outer(alphas, np.eye(n)[0]), -alphas[:, None])
    fast = stationary(np.eye(n, k=1) - np.outer(alphas * t, np.eye(n)[0]), -(alphas * t)[:, None])
    assert plain is not None
    np.testing.assert_allclose(fast, plain * np.outer(t, t) / theta, rtol=1e-9)


def test_noise_of_an_unstable_error_is_none_and_the_worst_infinite():
    model = without_channels(np.diag([0.5, -1.0]))
    assert measures.noise_at(model, np.zeros((2, 1)), np.zeros(0), np.eye(2), np.eye(1)) is None
    assert measures.worst_at_corners(model, np.zeros((2, 1)), np.eye(2), np.eye(2), np.eye(1)) == np.inf
    assert measures.peak(model, np.zeros((2, 1))) == np.inf


@pytest.mark.parametrize("k", [0.0, 5.0, 1e4])
def test_peak_of_a_jordan_block(k):
    """exp(F t) = e^-t [[1, k t], [0, 1]], whose norm is e^-t (s + sqrt(s^2 + 1)) with s = k t / 2."""
    t = np.linspace(0, 10, 400_001)
    expected = np.max(np.exp(-t) * (k * t / 2 + np.sqrt((k * t / 2) ** 2 + 1)))
    model = without_channels(np.array([[-1.0, k], [0.0, -1.0]]))
    assert measures.peak(model, np.zeros((2, 1))) == pytest.approx(expected, rel=1e-3)


def test_frozen_optimum_without_a_rate_is_the_kalman_filter():
    for n in (1, 2):
        problem = chain_table.chain(n, 2.0)
        model, (e, w, v) = problem.model, problem.factors
        rho = model.upper * (-1.0) ** np.arange(n)
        x = scipy.linalg.solve_continuous_are(model.at(rho).T, model.output.T, w @ w.T, v @ v.T)
        found = frozen.frozen_optimum(model, rho, 1e-6, e, w, v)
        assert found == pytest.approx(np.trace(x), rel=1e-6), n


def test_frozen_optimum_at_a_rate_has_a_closed_form_for_one_state():
    """e' = (a - l) e + w - l v has E e^2 = (1 + l^2) / 2 (l - a), smallest at l = max(a + rate, a + sqrt(a^2 + 1))."""
    model, one = without_channels(np.array([[0.5]])), np.eye(1)
    for rate in (0.2, 1.0, 3.0, 30.0):
        l = max(0.5 + rate, 0.5 + np.sqrt(1.25))
        found = frozen.frozen_optimum(model, np.zeros(0), rate, one, one, one)
        assert found == pytest.approx((1 + l**2) / (2 * (l - 0.5)), rel=1e-6), rate


def assert_sound(bench):
    """Nothing guaranteed lies below what is found at constant parameters; every certificate holds."""
    for pair in bench.pairs:
        for one in filter(None, (pair.theirs, pair.ours)):
            if one.level is not None:
                assert one.verdict == "verified", one
                assert one.rate > 0
                assert one.level >= max(one.frozen, one.nominal) * (1 - 1e-9)
                assert one.norm == pytest.approx(np.sqrt(np.sum(np.square(one.gain))))
                assert np.sqrt(np.sum(np.square(one.channels))) == pytest.approx(one.nominal)
        if pair.ours is not None:
            assert pair.ours.rate == pair.theirs.rate
    for one in bench.dmvt:
        assert one.verdict == "verified" or (one.method == "printed" and one.rate is None), one
        assert one.h2 is None or one.h2 >= one.frozen * (1 - 1e-9)
    for curve in bench.curves:
        assert curve.points
        assert curve.verdict == "verified"
        levels = [one.level for one in curve.points]
        assert levels == sorted(levels), "a faster rate cannot be quieter: the slower design starts from it"
        for one in curve.points:
            assert one.verdict == "verified"
            assert curve.floor * (1 - 1e-6) <= one.frozen <= one.level * (1 + 1e-6), (curve.n, one)
    assert all(one.verdict == "verified" for one in (*bench.growth, *bench.least))
    assert all(one.floor < one.norm for one in bench.least)


def assert_not_beaten(bench):
    """Ours wins or ties at equal proved rate."""
    assert [pair for pair in bench.pairs if pair.outcome == "loses"] == []
    for example in {(one.example, one.bound) for one in bench.dmvt}:
        rows = [one for one in bench.dmvt if (one.example, one.bound) == example]
        printed, ours = rows[0], rows[1:]
        assert printed.method == "printed"
        assert ours, example
        for name in ("h2", "l2", "frozen"):
            if printed.rate is not None and getattr(printed, name) is not None:
                assert min(getattr(one, name) for one in ours) <= getattr(printed, name) * 1.001, (example, name)


def test_short_form_is_sound_and_ours_is_not_beaten(bench):
    assert_sound(bench)
    assert_not_beaten(bench)


def assert_known_levels(bench, known):
    """Rates [1/s] and levels (energy form) of the printed gains at k_f = 1, by another program."""
    printed = {pair.theirs.method: pair.theirs for pair in bench.pairs if pair.theirs.problem == "k_f = 1"}
    for j0, rate, level in known:
        one = printed[f"printed j0 = {j0}"]
        assert one.rate == pytest.approx(rate, rel=0.01)
        assert one.level == pytest.approx(level, rel=1e-3)


def test_known_level_of_a_printed_gain(bench):
    assert_known_levels(bench, ((3, 0.4336, 98.54),))


def test_outcomes():
    def one(level):
        return GainRow("", "", ((1.0,),), 1.0, 1.0, level, 1.0, (1.0,), 1.0, 1.0, None, "verified")

    outcomes = [Pair(one(a), b if b is None else one(b)).outcome for a, b in ((2.0, 1.0), (2.0, 2.0), (2.0, 3.0), (2.0, None))]
    assert outcomes == ["wins", "ties", "loses", "loses"]
    assert Pair(one(None), None).outcome == "neither proved"


def test_tables_and_json(bench):
    for heading, header, cells in bench_text.tables(bench):
        assert heading
        assert cells
        assert all(len(row) == len(header) for row in cells), heading
    data = json.loads(json.dumps(bench_text.as_json(bench), allow_nan=False))
    assert len(data["frontier"]) == len(bench.curves)
    assert data["chain"][0]["ours"]["level"] == bench.pairs[0].ours.level
    assert "certificate" not in json.dumps(data)
    words = " ".join(bench_text.findings(bench))
    assert "loses 0" in words
    assert f"{sum(1 for _ in bench.certificates())} hold, 0 do not" in words


def test_figures_and_certificates_on_disk(bench, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench_cli, "run", lambda **options: bench)
    assert bench_cli.synthesis(figures=tmp_path / "figures", short=True, certificates=tmp_path / "proofs") == 0
    assert "guaranteed" in capsys.readouterr().out
    pictures = list((tmp_path / "figures").glob("*.png"))
    assert len(pictures) == 2
    assert all(one.stat().st_size > 10_000 for one in pictures)
    files, own = sorted((tmp_path / "proofs").glob("*.json")), dict(bench.certificates())
    assert {one.stem for one in files} == set(own)
    assert len(own) == sum(1 for _ in bench.certificates()), "two certificates of one name"
    assert load(files[0]) == own[files[0].stem]


@pytest.mark.slow
def test_whole_tables_win_or_tie_everywhere():
    """All gains and examples; of the frontier all curves at three of the rates; of the growth one size."""
    pairs = tuple(pair for k_f in chain_table.STRENGTHS for pair in chain_table.chain_pairs(k_f))
    curves = tuple(frontier.frontier(rates=(0.3, 3.0, 30.0)))
    grown = tuple(one for cover in growth.COVERS for one in growth.growth(cover, (4,)))
    bench = SynthesisBench(pairs, (), tuple(dmvt_rows()), curves, grown, {})
    for heading, _, cells in bench_text.tables(bench):
        print(heading, *(" | ".join(row) for row in cells), sep="\n")
    print(*bench_text.findings(bench), sep="\n")
    assert_sound(bench)
    assert_not_beaten(bench)
    assert_known_levels(bench, ((0, 24.93, 7.0747e6), (1, 3.059, 2754.1), (2, 1.074, 292.78), (3, 0.4336, 98.54)))
    assert {(curve.n, curve.k_f) for curve in bench.curves} == {(n, k_f) for n in (2, 3, 4, 5) for k_f in (1, 10)}


@pytest.mark.slow
def test_least_gains_reach_those_known():
    """|L| = 20.7, 1.19e4 and 4.7e8 were certified before, and the floors 0.687, 172 and 3.9e6 proved."""
    for k_f, known, floor in ((1, 20.7, 0.687), (10, 1.19e4, 172), (100, 4.7e8, 3.9e6)):
        found = least_gain(k_f)
        print(f"k_f = {k_f}: |L| = {found.norm:.6g} ({known:g} known), floor {found.floor:.6g}")
        assert found.norm <= known
        assert found.floor >= floor * 0.99


@pytest.mark.slow
def test_the_printed_flexible_joint_gain_holds_to_its_known_edge():
    assert largest_joint_slope() == pytest.approx(8.34, abs=0.02)


def test_growth_stops_at_the_budget():
    rows = list(growth.growth("corners", (2, 3), budget=0.0))
    assert [one.n for one in rows] == [2]
    assert growth.last_practical(rows, "corners", 0.0) is None
    assert growth.last_practical(rows, "corners", 1e9) == 2
