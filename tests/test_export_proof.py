"""The proof that goes with exported code: which theorem covers exactly its numbers; and the walk as the code sees it."""

import dataclasses
import json
import subprocess

import jax.numpy as jnp
import numpy as np
import pytest
from exported import Compiled, compiled
from test_cli_start import run

from jaxobs import designs, hurwitz, observers, plants
from jaxobs._module import astype
from jaxobs.certificates import load
from jaxobs.datasets import shank_walk
from jaxobs.demo.walk import Entry, rate_of, row_of
from jaxobs.designs import Infeasible, corner_lmi
from jaxobs.designs.polytope import Polytope
from jaxobs.export import differences, export, prove, read_c, straight
from jaxobs.export.tick import Tick
from jaxobs.integrators import RK4, Euler, Exponential

DT = 1 / 120


def model(*parts):
    return Polytope(*(np.array(one, float) for one in parts))


SLOPE = model([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], [-1.2], [1.2], [[1, 0]])


def pendulum(q=0, dt=0.02, holds="innovation", integrator=None, gamma=6.0):
    observer = observers.IntegralHighGain(plants.Pendulum(), hurwitz.binomial(2 + q), gamma, q)
    return observers.Sampled(observer, integrator or RK4(), dt, holds)


@pytest.fixture(scope="module")
def held():
    """The pendulum without integrators, samples 0.02 s apart, and its certificate."""
    return pendulum(), prove(pendulum(), SLOPE, rate=0.5)


def covers(observer, certificate, tmp_path):
    return export(observer, tmp_path, certificate=certificate, kinds=("numpy",)).coverage


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_the_certificate_is_about_the_numbers_in_the_code(held, precision, tmp_path):
    made = export(
        pendulum(gamma=5.9), tmp_path, precision=precision, certificate=prove(pendulum(gamma=5.9), SLOPE), kinds=("c",)
    )
    stored, code = load(made.files["certificate"]), read_c(made.files["source"])
    assert made.coverage.covered
    assert stored.verify()
    assert stored.theorem == "sampled-tube"
    exact = np.array([11.8, 34.81], precision).astype(float)
    np.testing.assert_allclose(code.tables["gain"], exact, rtol=2 * np.finfo(precision).eps)
    np.testing.assert_array_equal(np.asarray(stored.gain)[:, 0], code.tables["gain"])
    np.testing.assert_array_equal(code.tables["gain"], code.tables["gain"].astype(precision))
    assert differences(code, stored, json.loads(made.files["certificate"].read_text())["sha256"]) == []


def test_behind_integrators_the_gain_is_certified_where_it_acts(tmp_path):
    """The innovation is held, the integrators are not: L is in the matrix a of the certificate."""
    observer = pendulum(q=1)
    made = export(observer, tmp_path, precision="float32", certificate=prove(observer, SLOPE, rate=0.2), kinds=("c",))
    stored = load(made.files["certificate"])
    assert made.coverage.covered
    np.testing.assert_array_equal(-np.asarray(stored.a)[:, 0], read_c(made.files["source"]).tables["gain"])
    wrong = designs.sampled_data(SLOPE.behind(1), np.asarray(observer.observer.gain())[:, None], delta=0.02)
    told = covers(observer, wrong, tmp_path)
    assert not told.covered
    assert "what this observer corrects by" in told.sentence


def test_held_behind_is_the_error_between_samples():
    """An oracle: the error of the observer itself over one period, from its flow, on a linear plant."""
    q, dt, gain = 2, 0.05, np.array([3.0, 4.0, 2.5, 1.0])
    chain = model([[0, 1], [0, 0]], np.zeros((2, 0)), np.zeros((0, 2)), [], [], [[1, 0]])
    error_model, held = designs.held_behind(chain, gain, q)
    inside = observers.IntegralHighGain(plants.IntegratorChain(2), gain, 1.0, q)
    observer = observers.Sampled(inside, RK4(substeps=50), dt, "innovation")
    x, z = np.array([0.3, -0.7]), np.array([0.2, -0.1, 0.5, 0.4])
    (after, _) = observer.step(
        jnp.asarray(0), (jnp.asarray(z), observer.init(jnp.zeros(2))[1]), jnp.zeros(0), jnp.asarray(x[:1])
    )
    ahead = np.array([x[0] + dt * x[1], x[1]])
    found = np.concatenate([after[:q], ahead - np.asarray(after[q:])])
    error, steps = np.concatenate([z[:q], x - z[q:]]), 4000
    seen, current = error_model.output @ error, error.copy()
    for _ in range(steps):  # e' = a e - gain output e(t_k), by the midpoint rule
        slope = error_model.a @ current - held @ seen
        current = current + dt / steps * (error_model.a @ (current + dt / steps / 2 * slope) - held @ seen)
    np.testing.assert_allclose(found, current, rtol=1e-6, atol=1e-8)


def test_which_theorem_covers_a_discretisation_is_said(held, tmp_path):
    observer, certificate = held
    continuous = corner_lmi.prove(SLOPE, np.asarray(observer.observer.gain())[:, None], rate=0.5)
    gain = 0.02 * np.asarray(observer.observer.gain())[:, None]
    euler = observers.StepLuenberger(plants.Discretised(plants.Pendulum(), Euler(), 0.02), gain)
    step = Polytope(np.eye(2) + 0.02 * SLOPE.a, 0.02 * SLOPE.b, SLOPE.c, SLOPE.lower, SLOPE.upper, SLOPE.output)
    said = {
        "no certificate": covers(observer, None, tmp_path),
        "sampled": covers(observer, certificate, tmp_path),
        "too long": covers(pendulum(dt=0.03), certificate, tmp_path),
        "held output": covers(pendulum(holds="output"), certificate, tmp_path),
        "continuous": covers(observer, continuous, tmp_path),
        "euler": covers(pendulum(integrator=Euler()), continuous, tmp_path),
        "euler model": covers(euler, prove(euler, step), tmp_path),
    }
    assert said["sampled"].covered
    assert "samples up to 0.02 s apart" in said["sampled"].sentence
    assert said["euler model"].covered
    assert "Euler of the plant over 0.02 s. It says nothing of the plant itself" in said["euler model"].sentence
    for name, words in {
        "no certificate": "came without a certificate",
        "too long": "its period is 0.03 s, and theorem 'sampled-tube' goes up to 0.02 s",
        "held output": "this code holds the measurement",
        "continuous": "theorem 'corners' is about continuous measurements",
        "euler": "The Euler model has one: StepLuenberger on Discretised",
    }.items():
        assert not said[name].covered
        assert said[name].sentence.startswith("No theorem covers this code")
        assert words in said[name].sentence


def test_no_theorem_covers_what_it_is_not_about(held, tmp_path):
    """A held measurement that enters f itself, and a theorem that has no model of the output."""
    injected = observers.OutputInjection(plants.Pendulum(b=0.0), np.asarray(held[0].observer.gain())[:, None])
    told = covers(observers.Sampled(injected, RK4(), 0.02, "innovation"), held[1], tmp_path)
    assert not told.covered
    assert "of OutputInjection jaxobs does not know" in told.sentence
    observer, certificate = designs.high_gain_lmi(plants.Pendulum(), bounds=[[-1.2, 1.2], [0.0, 0.0]])
    told = covers(observers.Sampled(observer, RK4(), 0.001, "innovation"), certificate, tmp_path)
    assert not told.covered
    assert "'hg-lmi' is about continuous measurements" in told.sentence


def test_a_factor_above_one_is_refused():
    with pytest.raises(ValueError, match=r"prove\.rate: given 1\.5"):
        prove(observers.DiscreteTracker(2, 0, 50.0, DT), rate=1.5)


def test_a_certificate_of_another_gain_is_refused(held, tmp_path):
    certificate = held[1]
    with pytest.raises(ValueError, match=r"export\.certificate: given gain = .*as the observer has it"):
        covers(pendulum(gamma=6.1), certificate, tmp_path)
    with pytest.raises(ValueError, match="a gain inside an exponential"):
        covers(pendulum(integrator=Exponential()), certificate, tmp_path)
    with pytest.raises(ValueError, match="a gain that is no constant"):
        covers(observers.DiscreteTracker(2, 0, 40.0, DT, 1.0), certificate, tmp_path)
    high_gain, found = designs.riccati(plants.Pendulum(), alphas=[2.0, 1.0], gamma=20.0, lipschitz=1.2)
    with pytest.raises(ValueError, match=r"export\.certificate: given theorem condition5; expected a theorem about one gain"):
        covers(observers.Sampled(high_gain, RK4(), 0.001), found, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_proof_without_room_for_rounding_is_no_longer_one(tmp_path):
    """The gain 0.3 leaves the factor 0.6; one that is 1e-9 less, as rounding might make it, leaves more than was proved."""
    chain = model([[0.9]], np.zeros((1, 0)), np.zeros((0, 1)), [], [], [[1]])
    loose = corner_lmi.prove(chain, np.array([[0.3]]), rate=0.7, step=True)
    tight = dataclasses.replace(loose, factor=0.6 + 1e-12)
    plant = plants.LinearStep([[0.9]], None, [[1.0]])
    assert tight.verify()
    assert covers(observers.StepLuenberger(plant, [[0.3]]), tight, tmp_path).covered
    rounded = observers.StepLuenberger(plant, [[0.3 - 1e-9]])
    assert covers(rounded, loose, tmp_path).covered
    with pytest.raises(Infeasible, match="not proved for the gain as the code has it"):
        export(rounded, tmp_path, certificate=tight)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("/* 12.0 */", "/* 12.1 */", "was changed after it was written"),
        ("0x1.8000000000000p+3", "0x1.8000000000001p+3", "gain in the code is"),
        ("sampled-tube sha256 ", "sampled-tube sha256 0", "names no certificate"),
    ],
)
def test_an_edited_file_is_noticed(held, old, new, words, tmp_path, monkeypatch, capsys):
    observer, certificate = held
    made = export(observer, tmp_path, name="pendulum", certificate=certificate, kinds=("c",))
    arguments = ["verify", str(made.files["certificate"]), "--against", str(made.files["source"])]
    assert run(monkeypatch, *arguments) == 0
    assert "has the certified gain" in capsys.readouterr().out
    text = made.files["source"].read_text()
    assert old in text
    made.files["source"].write_text(text.replace(old, new))
    assert run(monkeypatch, *arguments, "--json") == 1
    assert words in json.loads(capsys.readouterr().out)[0]["against"]


def test_the_tracker_in_c_has_the_row_of_python_on_the_walk(tmp_path):
    walk, n = shank_walk(), 2
    tracker = observers.DiscreteTracker(n, 0, 50.0, DT)
    entry = Entry("observer", "none", "tracker", "", 1, 0.0, rate_of(tracker))
    by_python = row_of(walk, entry, entry.filter(walk.angle))
    for precision, digits in (("float64", 1e-9), ("float32", 1e-4)):
        folder = tmp_path / precision
        export(tracker, folder, name="tracker", precision=precision, certificate=prove(tracker), kinds=("c",))
        controller = Compiled(folder, "tracker", straight(Tick(astype(tracker, np.dtype(precision)))))

        def rate(angle, controller=controller):
            controller.start([angle[0], 0.0])
            return np.array([controller.update((), [one])[1] for one in angle], float)

        by_c = row_of(walk, entry._replace(filter=rate), rate(walk.angle))
        for name in (
            "rmse",
            "rmse_low",
            "rmse_high",
            "rmse_train",
            "rmse_choose",
            "rmse_second_half",
            "delay_ms",
            "noise_gain",
        ):
            assert getattr(by_c, name) == pytest.approx(getattr(by_python, name), rel=digits), name


@pytest.mark.parametrize(
    ("name", "covered"),
    [
        ("tracker", True),
        ("pendulum", True),
        pytest.param("flexible_joint", True, marks=pytest.mark.slow),
        pytest.param("kalman", False, marks=pytest.mark.slow),
    ],
)
def test_every_example_is_exported_and_verified(name, covered, tmp_path, monkeypatch, capsys):
    assert run(monkeypatch, "export", f"export_{name}", "-o", str(tmp_path), "--json", "--kinds", "c") == 0
    assert json.loads(capsys.readouterr().out)["covered"] == covered
    rows = (tmp_path / f"{name}_vectors.csv").read_text()
    assert subprocess.run([compiled(tmp_path, name, program=True)], input=rows, text=True).returncode == 0
    if covered:
        files = str(tmp_path / f"{name}.certificate.json"), str(tmp_path / f"{name}.c")
        assert run(monkeypatch, "verify", files[0], "--against", files[1]) == 0


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        (["--set", "proof.rate=50.0"], 1, "not certified"),
        (["--set", "observer.holds=output"], 2, "a held innovation"),
        (["--set", "export.name=1"], 2, "config.export.name"),
        (["--set", "observer.nmae=Sampled"], 2, "nmae"),
        (["--certificate", "nowhere.json"], 2, "one of the two"),
    ],
)
def test_wrong_configs_are_named(changes, code, words, tmp_path, monkeypatch, capsys):
    assert run(monkeypatch, "export", "export_pendulum", "-o", str(tmp_path / "out"), *changes) == code
    assert words in capsys.readouterr().err.replace("\n", " ")
    assert not (tmp_path / "out").exists()
