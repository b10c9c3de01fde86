"""`jaxobs study` as a user types it: the examples of the package, stores, parts and stops, and every way to go wrong."""

import importlib
import json
import os
import signal as signals_of_the_system
import subprocess
import sys
import tomllib

import jax
import numpy as np
import pytest
import xarray as xr
from study_tables import TINY

import jaxobs
from jaxobs import Seeds, cli, grid, integrators, metrics, noise, observers, plants, signals
from jaxobs.cli.examples import examples
from jaxobs.cli.study_config import study_config
from jaxobs.studies import open_study
from jaxobs.studies.groups import make_groups

command = importlib.import_module("jaxobs.cli.study")  # the package has the function of this name


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "tiny.toml"
    path.write_text(TINY, encoding="utf-8")
    return path


@pytest.fixture
def jaxobs_study(monkeypatch, capsys):
    """Runs the command; JAX has started long ago and stays as it is. Returns (exit code, standard output, standard error)."""
    monkeypatch.setattr(command, "set_up", lambda *_, **__: None)

    def run(*arguments, **settings):
        changes = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
        monkeypatch.setattr("sys.argv", ["jaxobs", "study", *map(str, arguments), *changes])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        out, err = capsys.readouterr()
        return stop.value.code, out, " ".join(err.split())

    return run


def by_hand():
    plant = plants.Pendulum()
    family = grid(observers.HighGain(plant, [2.0, 1.0], 2.0), gamma=[2.0, 4.0])
    return jaxobs.study(
        plant, family, chunk=6, ts=np.arange(11) * 0.02, x0=[[0.5, 0.0], [0.3, 0.1]],
        xhat0=[0.0, 0.0], metrics={"rmse": metrics.RMSE(0.1), "peak": metrics.Peak()}, keys=Seeds(jax.random.key(7), 3),
        signal=signals.Sine(0.5), noise=grid(noise.Gaussian(0.01), sigma=[0.01, 0.1]), integrator=integrators.Euler(),
    )  # fmt: skip


def test_a_config_is_the_study_written_by_hand(jaxobs_study, config, tmp_path):
    code, out, err = jaxobs_study(config, "--store", tmp_path / "s", "--chunk", "6")
    assert (code, err) == (0, "")
    ds = by_hand()
    xr.testing.assert_equal(open_study(tmp_path / "s").load(), ds)
    low, middle, high = np.quantile(ds.rmse.sel(gamma=4.0, sigma=0.1, x0=1, state=1), (0.1, 0.5, 0.9))
    assert f"{middle:.3g} [{low:.3g}, {high:.3g}]" in out
    assert "gamma 2 x sigma 2 x x0 2 x seed 3 = 24 lanes, 11 samples each, float64" in out
    assert "diverged: 0 of 24 lanes" in out
    assert "lane-steps/s" in out
    assert f"open_study({str(tmp_path / 's')!r})" in out.replace("\n", "")


def test_the_same_as_json_and_as_a_page(jaxobs_study, config, tmp_path):
    code, out, err = jaxobs_study(config, "--json", "--chunk", "6", "--report", tmp_path / "r.html")
    assert (code, err.replace(" ", "")) == (0, f"Report:{tmp_path / 'r.html'}".replace(" ", ""))
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "Study" in page
    assert "plotly" in page
    told, ds = json.loads(out), by_hand()
    assert told["axes"] == {"gamma": 2, "sigma": 2, "x0": 2, "seed": 3}
    assert (told["lanes"], told["computed"], told["diverged"], told["steps"], told["complete"]) == (24, 24, 0, 11, True)
    assert told["lane_steps_per_second"] > 0
    assert [row["at"] for row in told["rows"]] == [
        {"gamma": g, "sigma": s, "x0": i} for g in (2.0, 4.0) for s in (0.01, 0.1) for i in range(2)
    ]
    for row in told["rows"]:
        assert set(row["values"]) == {"rmse[0]", "rmse[1]", "peak[0]", "peak[1]"}
        expected = np.quantile(ds.peak.sel(row["at"]).isel(state=1), (0.1, 0.5, 0.9))
        np.testing.assert_allclose(row["values"]["peak[1]"], expected, rtol=1e-14)


def test_parts_then_resume(jaxobs_study, config, tmp_path):
    arguments = (config, "--store", tmp_path / "s", "--chunk", "6")
    code, out, _ = jaxobs_study(*arguments, "--part", "0/2")
    assert code == 0
    assert "computed so far: 12 of 24 lanes" in out
    assert "runs" in out
    code, out, _ = jaxobs_study(*arguments, "--json", "--part", "0/2")
    assert (code, json.loads(out)["complete"], json.loads(out)["lane_steps_per_second"]) == (0, False, None)
    assert jaxobs_study(*arguments, "--part", "1/2")[0] == 0
    code, out, _ = jaxobs_study(*arguments)
    assert code == 0
    assert "nothing was left to compute" in out
    xr.testing.assert_equal(open_study(tmp_path / "s").load(), by_hand())
    code, _, err = jaxobs_study(*arguments, "--seeds", "4")
    assert code == 2
    assert "holds another study" in err


@pytest.mark.parametrize("stored", [True, False])
def test_ctrl_c_says_how_to_go_on(monkeypatch, jaxobs_study, config, tmp_path, stored):
    arguments = (config, "--chunk", "6", *(("--store", tmp_path / "s") if stored else ()))
    with monkeypatch.context() as patch:
        pressed = command.contextlib.nullcontext(lambda now: os.kill(os.getpid(), signals_of_the_system.SIGINT))
        patch.setattr(command, "_bar", lambda: pressed)
        code, out, err = jaxobs_study(*arguments)
    assert code == 130
    assert "6 of 24 lanes are finished" in err
    assert ("To go on where it stopped: jaxobs study" in err) == stored
    assert ("With --store DIR the same command goes on" in err) != stored
    assert ("computed so far: 6 of 24" in out) != stored
    if stored:
        assert jaxobs_study(*arguments)[0] == 0
        xr.testing.assert_equal(open_study(tmp_path / "s").load(), by_hand())


def test_a_failure_under_way_has_its_own_code(monkeypatch, jaxobs_study, config, tmp_path):
    def full(*_):
        raise OSError("store: writing chunk 0 failed: No space left on device.")

    monkeypatch.setattr("jaxobs.studies.store.Store.write", full)
    code, _, err = jaxobs_study(config, "--store", tmp_path / "s", "--chunk", "6")
    assert code == 1
    assert "No space left on device" in err
    assert "What was finished is in the store" in err


def test_lanes_that_diverge_are_counted_and_left_out(jaxobs_study, config):
    code, out, _ = jaxobs_study(config, "--json", "--chunk", "6", **{"start.x0": "[[0.5, 0.0], [1e308, 1e308]]"})
    told = json.loads(out)
    assert (code, told["diverged"], told["computed"]) == (0, 12, 24)
    assert [(row["runs"], row["diverged"]) for row in told["rows"]] == [(3, 0), (3, 3)] * 4
    assert told["rows"][1]["values"]["rmse[0]"] is None
    assert told["rows"][0]["values"]["rmse[0]"][1] > 0


EXAMPLES = {
    "study_pendulum": (["q", "gamma", "sigma", "seed"], {"observer.q": "[0, 2]", "run.integrator": "Euler"}),
    "study_mismatch": (["observer", "gamma", "a", "x0", "seed"], {"run.integrator": "Euler"}),
    "study_chain": (["gamma", "sigma", "seed"], {}),
    "study_tracker": (["q", "mu", "sigma", "seed"], {"observer.q": "[1]", "run.integrator": "Euler"}),
}


def test_every_example_is_run():
    assert set(EXAMPLES) == set(examples("study"))
    assert not set(EXAMPLES) & set(examples("certify"))


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_runs(jaxobs_study, name):
    axes, changes = EXAMPLES[name]
    code, out, _ = jaxobs_study(name, "--seeds", "2", "--json", **{"time.end": 0.3, "metrics.rmse.after": 0.1}, **changes)
    told = json.loads(out)
    assert (code, list(told["axes"])) == (0, axes)
    values = [float(one) for row in told["rows"] for found in row["values"].values() for one in found]
    assert not np.isnan(values).any()
    assert told["diverged"] == 0


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_fits_together(name):
    """All checks of the study on the whole example, without a run."""
    plant, families, arguments = study_config(tomllib.loads(examples("study")[name])).study()
    _, groups = make_groups(plant, families, **arguments)
    assert [*groups[0].label, *(axis.name for axis in groups[0].axes)] == EXAMPLES[name][0]


WRONG = [
    ({"plnat": "1"}, "plnat: given 'plnat'; expected one of plant,", "Did you mean 'plant'?"),
    ({"plant.name": "Pendulm"}, "config.plant.name: given 'Pendulm'", "Did you mean 'Pendulum'?"),
    ({"plant.mass": 1.0}, "config.plant.mass: given 'mass'; expected one of a, b, period"),
    ({"plant.a": "'1'"}, "config.plant.a: given '1'; expected a number, or several of them in a list"),
    ({"plant": "1"}, "config.plant.name: given 1; expected the name of a plant"),
    ({"plant.a": "[1.0, 1.2]"}, "config.observer.model.a: given nothing", "nominal = ..."),
    ({"plant.a": "[1.0, 1.0]", "observer.model.a": 1}, "config.plant.a: given [1.0, 1.0]; expected values, each once"),
    ({"plant.name": "IntegratorChain"}, "config.plant.n: given nothing; expected a whole number, or several in a list"),
    ({"plant.name": "SineChain", "plant.n": "[2, 2]"}, "config.plant.n: given [2, 2]; expected each number once"),
    ({"plant.name": "SineChain", "plant.n": "2.0"}, "config.plant.n: given 2.0; expected a whole number"),
    ({"observer.name": "HighGian"}, "config.observer.name", "Did you mean 'HighGain'?"),
    ({"observer.gama": 1}, "config.observer.gama", "Did you mean 'gamma'?"),
    ({"observer.gamma": "[]"}, "config.observer.gamma: given []; expected a number"),
    ({"observer.gamma": "{first = 1, last = 2}"}, "config.observer.gamma.count: given nothing"),
    ({"observer.gamma": "{first = 1, last = 2, count = 0}"}, "config.observer.gamma.count: given 0"),
    ({"observer.gamma": "{first = -1, last = 2, count = 3, spacing = 'log'}"}, "config.observer.gamma.spacing", "one sign"),
    ({"observer.gamma": "{first = 1, lsat = 2}"}, "config.observer.gamma.lsat", "Did you mean 'last'?"),
    ({"observer.gamma": "{first = 1, last = 2, count = 3, spacing = 'lin'}"}, "config.observer.gamma.spacing", "'linear'"),
    ({"observer.alphas": "'binomal'"}, "config.observer.alphas: given 'binomal'; expected a list of numbers"),
    ({"observer.alphas": "[[1.0, 2.0], [1.0]]"}, "config.observer.alphas: given [[1.0, 2.0], [1.0]]"),
    ({"observer.alphas": "1.0"}, "config.observer.alphas: given 1.0; expected a list of numbers"),
    ({"observer.model.name": "Lorenz"}, "config.observer.model.name: given 'Lorenz'"),
    ({"observer.model.c": 1.0}, "config.observer.model.c: given 'c'; expected one of a, b"),
    ({"observer.model": "1"}, "config.observer.model: given 1; expected a table"),
    ({"observers.b.name": "HighGain"}, "config.observer: given both; expected [observer] or [observers.LABEL]"),
    ({"signal.amplitude": "true"}, "config.signal.amplitude: given True; expected a number"),
    ({"signal.order": "[0, 1]"}, "config.signal.order: given [0, 1]; expected a whole number", "same for all runs"),
    ({"noise.sigma": "[[0.1]]"}, "config.noise.sigma: given [[0.1]]; expected a number"),
    ({"noise": "[]"}, "config.noise.parts: given (); expected at least one noise"),
    ({"noise": '[{name = "Gaussian"}]'}, "config.noise.parts.0.sigma: given nothing; expected a number"),
    ({"disturbance": "'Gausian'"}, "config.disturbance.name", "Did you mean 'Gaussian'?"),
    ({"time.end": "'1'"}, "config.time.end: given '1'; expected a number"),
    ({"time.end": -1}, "config.time.end: given -1.0; expected a time after the start"),
    ({"time.samples": 3}, "config.time.dt: given 0.02 beside time.samples"),
    ({"time.dt": 0.03}, "config.time.dt: given 0.03", "divides 0.2 s"),
    ({"time.dt": -0.1}, "config.time.dt: given -0.1; expected a step between 0 and 0.2 s"),
    ({"time": "{end = 1.0}"}, "config.time.dt: given nothing"),
    ({"time": "{end = 1.0, samples = 1}"}, "config.time.samples: given 1"),
    ({"start.x": "[1.0]"}, "start.x: given 'x'; expected one of x0, xhat0"),
    ({"start": "{}"}, "config.start.x0: given nothing"),
    ({"start.x0": "[[1.0, 0.0], [1.0]]"}, "config.start.x0: given [[1.0, 0.0], [1.0]]"),
    ({"start.xhat0": "'a'"}, "config.start.xhat0: given 'a'"),
    ({"start.x0": "[1.0]"}, "config.start.x0: given shape (1,)"),
    ({"metrics.rmse": "'RSME'"}, "config.metrics.rmse.kind: given 'RSME'", "Did you mean 'RMSE'?"),
    ({"metrics.rmse.after": "[1.0]"}, "config.metrics.rmse.after: given [1.0]; expected a number", "same for all runs"),
    ({"metrics.settle.kind": "SettlingTime"}, "config.metrics.settle.tolerance: given nothing"),
    ({"metrics": "'RMSE'"}, "config.metrics: given 'RMSE'; expected a table"),
    ({"metrics.gamma": "'Peak'"}, "config.metrics: given the name 'gamma'"),
    ({"run.integrator": "RK5"}, "config.run.integrator.name: given 'RK5'", "Did you mean 'RK4'?"),
    ({"run.integrator": "{name = 'RK4', substeps = 0}"}, "config.run.integrator.substeps: given 0"),
    ({"run.integrator": "Exponential", "time.dt": "'a'"}, "config.time.dt: given 'a'"),
    ({"run.seeds": 0}, "config.run.seeds: given 0"),
    ({"run.seeds": 1.5}, "config.run.seeds: given 1.5; expected a whole number"),
    ({"run.save": 0}, "config.run.save: given 0"),
    ({"run.precision": "float16"}, "config.run.precision: given 'float16'; expected one of float64, float32"),
    ({"run.sead": 1}, "config.run.sead", "Did you mean 'seeds'?"),
    ({"observer.gamma": "[2.0, -1.0]"}, "config.observer.gamma: given -1.0; expected a positive number"),
    ({"observer.alphas": "[-2.0, 1.0]"}, "config.observer.alphas", "root"),
    ({"observer.alphas": "[2.0, 1.0, 1.0]"}, "config.observer.alphas: given shape (3,)"),
    ({"noise.sigma": "-0.1"}, "config.noise.sigma: given -0.1"),
    ({"observer.gamma.x": "1"}, "--set observer.gamma.x: given [2.0, 4.0]; expected a table at observer.gamma"),
    ({"observer.gamma": "[1.0"}, "--set observer.gamma: given '[1.0'; expected a value as in TOML"),
]


@pytest.mark.parametrize(("changes", "words"), [(changes, words) for changes, *words in WRONG], ids=lambda one: str(one)[:60])
def test_a_wrong_config_is_named_by_its_key(as_users_have_it, jaxobs_study, config, changes, words):
    code, out, err = jaxobs_study(config, **changes)
    assert (code, out) == (2, "")
    assert not [word for word in words if word not in err], err


def test_wrong_options_are_named(jaxobs_study, config, tmp_path):
    for arguments, words in (
        (("--part", "2/2", "--store", tmp_path / "s"), "--part: given '2/2'; expected I/N with 0 <= I < N"),
        (("--part", "0/2"), "--store: given nothing"),
        (("--rows", "0"), "--rows: given 0"),
        (("--chunk", "0"), "--chunk: given 0"),
        (("--set", "seeds"), "--set seeds: given 'seeds'; expected KEY=VALUE"),
        (("--store", config), "is a file; expected a directory"),
    ):
        code, _, err = jaxobs_study(config, *arguments)
        assert code == 2
        assert words in err
    code, _, err = jaxobs_study("nonsuch")
    assert code == 2
    assert all(name in err for name in EXAMPLES)


def test_help_can_be_read(jaxobs_study):
    code, out, _ = jaxobs_study("--help")
    assert code == 0
    assert all(option in out for option in ("--store", "--part", "--seeds", "--set", "--json", "--devices", "--precision"))
    assert len(out.splitlines()) < 60


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_process_of_its_own_uses_all_cores(config, tmp_path, precision):
    arguments = [config, "--json", "--store", tmp_path / "s", "--precision", precision, "--devices", "2"]
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    done = subprocess.run(
        [sys.executable, "-m", "jaxobs", "study", *map(str, arguments)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    told = json.loads(done.stdout)
    assert done.stderr == ""
    assert (told["precision"], told["devices"], told["complete"]) == (precision, 2, True)
    assert open_study(tmp_path / "s").rmse.dtype == precision
    assert list((tmp_path / "cache" / "jaxobs").iterdir())
    if precision == "float64":
        xr.testing.assert_allclose(open_study(tmp_path / "s").load(), by_hand(), rtol=1e-12)
