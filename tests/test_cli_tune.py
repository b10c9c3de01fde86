"""`jaxobs tune` as a user types it: the examples of the package, one small case all the way, and every way to go wrong."""

import dataclasses
import importlib
import json
import tomllib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import jaxobs
from jaxobs import cli, observers, plants
from jaxobs.certificates import checker_bounds, load
from jaxobs.cli.examples import examples
from jaxobs.cli.tune_case import job, members
from jaxobs.cli.tune_config import tune_config
from jaxobs.cli.tune_floor import floor_of
from jaxobs.cli.tune_record import RecordedCase
from jaxobs.cli.tune_screen import finite, slug
from jaxobs.demo.walk import LAST, rms
from jaxobs.designs import Infeasible
from jaxobs.noise import Gaussian

command = importlib.import_module("jaxobs.cli.tune")  # the package has the function of this name

TINY = """
[plant]
name = "Pendulum"
a = { values = [0.9, 1.1], nominal = 1.0 }
[observer]
name = "HighGain"
alphas = [3.0, 2.0]
gamma = 6.0
[free]
alphas = "Affine"
[bounds]
lower = [[-1.12, 0.0]]
upper = [[1.12, 0.0]]
[certify]
kind = "quadratic"
[objective]
kind = "steady_noise"
state = 2
points = [[1.0, 0.0]]
[signal]
name = "Sine"
amplitude = 0.5
[noise]
name = "Gaussian"
sigma = 0.1
[disturbance]
name = "Gaussian"
sigma = 0.3
[time]
end = 0.5
dt = 0.01
[start]
x0 = [0.5, 0.0]
[check]
seeds = 3
after = 0.2
states = [2]
[search]
steps = 4
price = false
[run]
integrator = "Euler"
"""


def tables(**changes):
    """Those of TINY, with other values at dotted keys; None takes one out."""
    found = tomllib.loads(TINY)
    for key, value in changes.items():
        *path, last = key.split("__")
        place = found
        for name in path:
            place = place.setdefault(name, {})
        if value is None:
            del place[last]
        else:
            place[last] = value
    return found


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(TINY, encoding="utf-8")
    return path


@pytest.fixture
def jaxobs_tune(monkeypatch, capsys, tmp_path):
    """Runs the command; JAX has started long ago and stays as it is. Returns (exit code, standard output, standard error)."""
    monkeypatch.setattr(command, "set_up", lambda **_: None)

    def run(*arguments, **settings):
        changes = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
        where = () if "--out" in arguments else ("--out", tmp_path / "out")
        monkeypatch.setattr("sys.argv", ["jaxobs", "tune", *map(str, (*arguments, *where)), *changes])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        out, err = capsys.readouterr()
        return stop.value.code, out, " ".join(err.split())

    return run


@pytest.mark.slow
def test_one_case_all_the_way(jaxobs_tune, config, tmp_path):
    """The numbers in the JSON are those of the files, of the certificates and of a run of the same study by hand."""
    out = tmp_path / "all"
    code, said, err = jaxobs_tune(config, "--out", out)
    assert (code, err) == (0, "")
    told = json.loads((out / "tune.json").read_text())
    (case,) = told["cases"]
    assert (case["case"], case["unit"], case["proved_before"], case["state"]) == ("tiny", "1/s", True, 2)
    for when in ("before", "after"):
        certificate = load(case["files"][when])
        assert certificate.verify().holds
        assert certificate.rate == case["rate"]
        gain = np.array(case["numbers"]["alphas"][when]) * 6.0 ** np.arange(1, 3)
        np.testing.assert_allclose(np.array(certificate.gain)[:, 0], gain, rtol=1e-14)
    assert case["loss"]["after"] < case["loss"]["before"]
    assert case["loss"]["without_proof"] is None
    rows = {row["observer"]: row for row in case["comparison"]["rows"]}
    around = {"ts": 0.01 * np.arange(51), "x0": [0.5, 0.0], "xhat0": [0.0, 0.0], "signal": jaxobs.signals.Sine(0.5)}
    noises = {"noise": Gaussian(0.1), "disturbance": Gaussian(0.3), "integrator": jaxobs.integrators.Euler()}
    for when, row in rows.items():
        observer = observers.HighGain(plants.Pendulum(), case["numbers"]["alphas"][when], 6.0)
        ds = jaxobs.study(
            jaxobs.grid(plants.Pendulum(), a=[0.9, 1.1]), observer, metrics={"rmse": jaxobs.metrics.RMSE(0.2)},
            keys=jaxobs.Seeds(jax.random.key(1), 3), **around, **noises,
        )  # fmt: skip
        expected = np.sqrt(np.mean(np.asarray(ds.rmse.isel(state=1)) ** 2))
        assert row["rmse"] == pytest.approx(expected, rel=1e-9)
        still = jaxobs.simulate(plants.Pendulum(1.0), observer, integrator=noises["integrator"], **around)
        assert row["peak"] == pytest.approx(float(jnp.max(jnp.abs(still.xhat - still.x)[:, 1])), rel=1e-9)
    words = " ".join(said.split())
    assert f"proved in exact arithmetic of both gains: decay rate {case['rate']:.6g} 1/s, corners" in words
    assert "floor: none is known here" in words
    assert f"{rows['after']['change']:+.1%} [" in words
    assert all((out / name).stat().st_size > 1000 for name in ("tiny.history.png", "comparison.png"))
    assert str(out / "tiny.after.json") in said.replace("\n", "")


@pytest.mark.parametrize("name", examples("tune"))
def test_every_example_fits_together(name):
    """All that is read, built and checked before a search: charts, bounds, certifier, objective."""
    for config in tune_config(tomllib.loads(examples("tune")[name])):
        found = job(config, name)
        first = found.case.make(found.case.theta0)
        for leaf, theta in found.case.theta0.items():
            assert np.all(np.isfinite(np.asarray(theta))), leaf
        assert type(first) is type(found.config.observer.build({}, {"n": 5, "dt": 0.01}))


def test_examples_are_those_that_were_promised():
    names = {"tune_pendulum", "tune_chain", "tune_flexible_joint", "tune_discrete", "tune_duffing", "tune_walk"}
    assert set(examples("tune")) == names
    assert not names & (set(examples("certify")) | set(examples("study")))


def test_cases_are_tables_over_tables():
    cases = {"a": {"observer": {"gamma": 7.0}}, "b": {"observer": {"name": "Luenberger", "gain": [[1.0], [2.0]]}}}
    cases["b"]["free"] = {"gain": "Affine", "alphas": "Affine"}
    first, second = tune_config(tables() | {"cases": cases})
    assert (first.label, first.observer.fields["gamma"], first.observer.fields["alphas"]) == ("a", 7.0, [3.0, 2.0])
    assert (second.observer.kind, set(second.observer.fields)) == (observers.Luenberger, {"gain", "model"})
    assert set(second.free) == {"alphas", "gain"}
    labelled = tables() | {"observers": {"x": tables()["observer"]}}
    del labelled["observer"]
    assert [one.label for one in tune_config(labelled)] == ["x"]
    nested = tune_config(tables(free__model={"a": "Positive", "b": {"chart": "Box", "lower": -1.0, "upper": 1.0}}))[0]
    assert set(nested.free) == {"alphas", "model.a", "model.b"}


def test_quick_is_a_tenth():
    (one,) = tune_config(tables(check__seeds=200, search__steps=100), quick=True)
    assert (one.check.seeds, one.world.run.seeds, one.search.steps, one.objective.seeds) == (20, 20, 10, 3)


def test_the_objective_is_over_all_plants():
    """The root of the mean over plants and points of what Lyapunov equations in SciPy give, bias included."""
    found = job(tune_config(tables(objective__points=[[1.0, 0.0], [3.0, 0.0]]))[0], "")
    total = []
    for a in (0.9, 1.1):
        for x1 in (1.0, 3.0):
            dt = 0.01
            f = np.array([[-18.0, 1.0], [np.cos(x1) - 72.0, 0.0]])
            e = scipy.linalg.expm(np.block([[f, np.eye(2)], [np.zeros((2, 4))]]) * dt)
            b = e[:2, 2:] @ np.column_stack([np.array([18.0, 72.0]) * 0.1, [0.0, 0.3]])
            p = scipy.linalg.solve_discrete_lyapunov(e[:2, :2], b @ b.T)
            bias = -np.linalg.solve(f, [0.0, (1 - a) * np.sin(x1)])
            total.append(p[1, 1] + bias[1] ** 2)
    assert float(found.case.loss(found.case.make(found.case.theta0), None)) == pytest.approx(np.sqrt(np.mean(total)), rel=1e-8)


def test_the_convex_start_proves_the_rate():
    found = job(tune_config(tables(search__starts="h2"))[0], "")
    case, (note,) = found.prepare()
    assert "convex design" in note
    (start,) = case.starts
    assert case.certify.start(case.make(start), 0.0).rate > case.rate > 0
    assert case.rate == pytest.approx(0.999 * case.certify.start(case.make(case.theta0), 0.0).rate)


def test_bounds_travel_behind_integrators(tmp_path):
    """kind = "box": the file of an observer with q = 1 carries the proof of its bounds, for the checker without jaxobs."""
    observer = {"name": "IntegralHighGain", "alphas": [3.0, 3.0, 1.0], "gamma": 6.0, "q": 1}
    box = {"kind": "box", "lower": [[-0.5, -np.inf]], "upper": [[0.5, np.inf]], "inputs_lower": [-0.1], "inputs_upper": [0.1]}
    found = job(tune_config(tables(observer=observer, bounds=box | {"relax": 0.01}))[0], "")
    first, certify = found.case.make(found.case.theta0), found.case.certify
    start = certify.start(first, 2.0)
    travelling = found.finish(certify.prove(first, start.fixed, start.free, 2.0))
    travelling.to_json(tmp_path / "c.json")
    told = checker_bounds.check(json.loads((tmp_path / "c.json").read_text()))
    assert told["holds"], told["why"]
    assert load(tmp_path / "c.json").verify().holds


def test_floors_of_a_linear_plant_agree():
    """The Kalman filter and the posterior bound of two integrators, and a Riccati equation in SciPy."""
    plant, dt = plants.IntegratorChain(2), 0.05
    around = {"noise": Gaussian(0.1), "disturbance": Gaussian(2.0), "ts": dt * np.arange(200), "x0": [0.0, 0.0]}
    around |= {"signal": None, "integrator": None}
    kalman = floor_of("kalman", [plant], around, dt, 5.0)
    f, gamma = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[dt**2 / 2], [dt]])
    before = scipy.linalg.solve_discrete_are(f.T, np.array([[1.0], [0.0]]), 4.0 * gamma @ gamma.T, [[0.01]])
    after = before - before[:, :1] @ before[:1] / (before[0, 0] + 0.01)
    np.testing.assert_allclose(kalman, np.sqrt(np.diagonal(after)), rtol=1e-9)
    np.testing.assert_allclose(floor_of("posterior", [plant], around, dt, 5.0), kalman, rtol=2e-3)


def test_the_record_is_compared_on_its_last_block(monkeypatch):
    """Rows beside the samples of the gyroscope; the grids are searched on the training block alone."""
    recorded = RecordedCase(tune_config(tomllib.loads(examples("tune")["tune_walk"]))[0])
    monkeypatch.setattr("jaxobs.cli.tune_record.TRACKERS", ((2, 0),))
    monkeypatch.setattr("jaxobs.cli.tune_record.GRID", np.array([90.0, 130.0]))
    filters = {
        "before": observers.DiscreteTracker(2, 0, 130.0, recorded.dt),
        "after": observers.DiscreteTracker(2, 0, 90.0, recorded.dt),
    }
    assert recorded.dt == pytest.approx(1 / 120, rel=1e-4)
    found = recorded.check(filters)
    rates = {name: recorded.estimate(one) for name, one in filters.items()}
    assert [row.observer for row in found.rows[:2]] == ["before", "after"]
    for row in found.rows[:2]:
        assert row.rmse == pytest.approx(rms(rates[row.observer][LAST] - recorded.truth[LAST]), rel=1e-12)
        assert row.rmse_low < row.rmse < row.rmse_high
    train = slice(*recorded.train)
    best = min(rates, key=lambda name: rms((rates[name] - recorded.truth)[train]))
    assert "mu = 130" in found.rows[2].observer
    assert best == "before"
    assert found.rows[2].rmse == pytest.approx(found.rows[0].rmse, rel=1e-9)
    assert "samples 2634 to 3510, which no search has seen" in str(found)
    loss = float(recorded.loss()(filters["before"]))
    assert loss == pytest.approx(rms((rates["before"] - recorded.truth)[train]), rel=1e-9)


def test_what_is_not_proved_has_its_own_code(monkeypatch, jaxobs_tune, config):
    def no(case, *, progress):
        raise Infeasible("no start proves the rate 100 1/s", -95.0, "Ask for less.", best=5.0)

    monkeypatch.setattr("jaxobs.tuning.case.run", no)
    code, out, err = jaxobs_tune(config, "--json")
    assert code == 1
    assert "tiny: no gain is proved: no start proves the rate 100 1/s. The nearest feasible rate: 5. Ask for less." in err
    assert json.loads(out)["failed"] == [
        {"case": "tiny", "reason": "no start proves the rate 100 1/s", "change": "Ask for less.", "best": 5.0}
    ]


def test_ctrl_c_has_its_own_code(monkeypatch, jaxobs_tune, config):
    def pressed(case, *, progress):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxobs.tuning.case.run", pressed)
    code, _, err = jaxobs_tune(config)
    assert (code, err) == (130, "stopped: 0 of 1 cases are done")


WRONG = [
    ({"plnat": 1}, "plnat: given 'plnat'; expected one of plant,", "Did you mean 'plant'?"),
    ({"plant__name": "Pendulm"}, "config.plant.name: given 'Pendulm'", "Did you mean 'Pendulum'?"),
    ({"observer": None}, "config.observer: given {}"),
    ({"observers": {"x": {}}}, "config.observers: given observer and observers; expected one of them"),
    ({"cases": {}}, "config.cases: given {}; expected a table for each label"),
    ({"cases": {"x": {"fre": {}}}}, "config.cases.x.fre", "Did you mean 'free'?"),
    ({"free": {}}, "config.free: given {}; expected a chart for each free number"),
    ({"free__alphas": "LogP"}, "config.free.alphas.chart: given 'LogP'", "Did you mean 'LogQ'?"),
    ({"free__alphas": {"chart": "Box", "lower": 1.0}}, "config.free.alphas.lower: given 1.0, None; expected both bounds"),
    ({"free__alhpas": "Affine"}, "config.free.alhpas: given 'alhpas'; expected one of", "alphas"),
    ({"free__alphas": {"chart": "Affine", "scale": [1.0]}}, "config.free.alphas.scale: given 1 numbers; expected 2"),
    ({"observer__alphas": [-3.0, 2.0]}, "config.observer.alphas"),
    ({"observer__gamma": [5.0, 6.0]}, "config.observer.gamma: given several values of gamma; expected one"),
    ({"certify__kind": "quadratc"}, "config.certify.kind: given 'quadratc'", "Did you mean 'quadratic'?"),
    ({"certify__kind": "linear"}, "config.bounds: given a table; expected a table with certify.kind"),
    ({"bounds": None}, "config.bounds: given nothing; expected a table with certify.kind"),
    ({"certify__kind": "condition5", "bounds": None}, "config.certify.lipschitz: given None; expected a number"),
    ({"bounds__upper": [[1.12]]}, "slope_entries.upper"),
    ({"objective__kind": "recorded"}, "config.objective.kind: given 'recorded'; expected steady_noise or monte_carlo"),
    ({"objective__state": 3}, "config.objective.state: given 3; expected a number from 1 to 2"),
    ({"objective__weight": [1.0, 1.0]}, "config.objective.weight: given both; expected state or weight"),
    ({"objective__state": None, "objective__weight": [1.0]}, "config.objective.weight: given 1 numbers; expected 2"),
    ({"objective__kind": "monte_carlo", "objective__key": 1}, "config.check.key: given 1; expected another one"),
    ({"objective__points": [[0.0]]}, "SteadyNoise.points: given shape (1, 1)"),
    ({"noise": None}, "config.noise: given nothing; expected a table"),
    ({"noise": {"name": "Sinusoid", "amplitude": 0.1, "frequency": 1.0}}, "config.noise: given Sinusoid; expected Gaussian"),
    (
        {"disturbance": None, "plant__a": 1.0},
        "config.disturbance: given nothing; expected a disturbance, or a plant that differs",
    ),
    ({"check__seeds": 1}, "config.check.seeds: given 1; expected a whole number >= 2"),
    ({"check__flor": "none"}, "config.check.flor", "Did you mean 'floor'?"),
    ({"run__seeds": 3}, "config.run: given", "Seeds belong into [check]"),
    ({"record": {"data": "shank_walk"}}, "config.plant: given beside [record]"),
    ({"search__starts": "h3"}, "config.search.starts: given 'h3'; expected one of h2, none"),
    ({"time__dt": 0.3}, "config.time.dt: given 0.3"),
]


@pytest.mark.parametrize(("changes", "words"), [(changes, words) for changes, *words in WRONG], ids=lambda one: str(one)[:60])
def test_a_wrong_config_is_named_by_its_key(as_users_have_it, changes, words):
    with pytest.raises(ValueError, match=r".") as refused:
        job(tune_config(tables(**changes))[0], "")
    assert not [word for word in words if word not in str(refused.value)], str(refused.value)


def test_a_convex_start_needs_slopes(as_users_have_it):
    for changes in ({"certify__kind": "none", "bounds": None}, {"observer": STEP}):
        with pytest.raises(ValueError, match=r"config\.search\.starts: given 'h2'"):
            job(tune_config(tables(search__starts="h2", **changes | STEPS.get(len(changes), {})))[0], "")


STEP = {"name": "StepLuenberger", "gain": [[0.3], [0.9]], "model": {"name": "Pendulum", "period": 0.01}}
STEPS = {1: {"free": {"gain": "Affine"}}}


def test_wrong_commands_are_named(jaxobs_tune, config, tmp_path):
    code, out, err = jaxobs_tune()
    assert (code, out) == (2, "")
    assert "tune: given no config" in err
    assert "tune_pendulum" in err
    code, _, err = jaxobs_tune("nonsuch")
    assert code == 2
    assert "nonsuch: no such file; expected a TOML file or one of the examples" in err
    code, _, err = jaxobs_tune(config, **{"observer.gama": 1})
    assert code == 2
    assert f"{config}: config.observer.gama" in err
    code, _, err = jaxobs_tune(config, "--out", config)
    assert code == 2
    code, _, err = jaxobs_tune(config, **{"cases": '{ "k = 1" = { observer.gamma = -1.0 } }'})
    assert code == 2
    assert "It is about the case 'k = 1'." in err


def test_help_can_be_read(jaxobs_tune):
    code, out, _ = jaxobs_tune("--help")
    assert code == 0
    assert all(option in out for option in ("--all", "--out", "--json", "--quick", "--set"))
    assert len(out.splitlines()) < 60


def test_names_of_files_and_numbers_for_json():
    assert slug("chain, k_f = 10") == "chain_k_f10"
    assert slug("../a b") == "a_b"
    assert finite({"a": (np.inf, np.nan, np.float64(1.5)), "b": jnp.asarray(2.0)}) == {"a": ["inf", None, 1.5], "b": 2.0}


def test_members_of_a_family():
    found = members(jaxobs.grid(plants.Pendulum(), a=[0.9, 1.1], b=[0.0, 0.1]))
    assert [(float(one.a), float(one.b)) for one in found] == [(0.9, 0.0), (0.9, 0.1), (1.1, 0.0), (1.1, 0.1)]
    assert members(plants.Pendulum())[0].n == 2
    assert dataclasses.is_dataclass(found[0])
