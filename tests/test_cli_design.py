"""`jaxobs design` and `jaxobs audit`, and the survey behind the first."""

import json

import numpy as np
import pytest
import scipy.linalg
from test_cli_start import CLASS, run

from jaxobs import designs
from jaxobs.certificates import load
from jaxobs.cli.design import bounds
from jaxobs.plants import Linear, Lorenz, Pendulum


@pytest.fixture(scope="module")
def found():
    return designs.survey(Pendulum(b=0.5), ([-2.0, -np.inf], [2.0, np.inf]), inputs=([-0.5], [0.5]), rate=1.5)


def test_all_candidates_prove_the_same_rate_and_are_ranked_by_noise(found):
    names = [one.name for one in found.candidates]
    assert set(names) == {"high_gain", "high_gain_lmi", "lpv_lmi", "synthesize"}
    assert found.best is found.candidates[0]
    levels = [one.level for one in found.candidates]
    assert levels == sorted(levels)
    for one in found.candidates:
        assert one.certificate.verify()
        assert one.certificate.rate == 1.5
        np.testing.assert_array_equal(one.certificate.gain, one.gain)


def test_levels_bound_what_white_noise_leaves_at_constant_slopes(found):
    """An oracle of the guaranteed level: the Lyapunov equation at slopes within the bounds."""
    w, v = found.process, found.noise
    for one in found.candidates:
        for slope in np.linspace(-1.118, 1.118, 5):
            closed = np.array([[0.0, 1.0], [slope, -0.5]]) - one.gain @ np.array([[1.0, 0.0]])
            assert np.max(np.linalg.eigvals(closed).real) < -1.5
            noise = w @ w.T + one.gain @ v @ v.T @ one.gain.T
            assert np.trace(scipy.linalg.solve_continuous_lyapunov(closed, -noise)) <= one.level


def test_the_proof_of_the_bounds_travels(found, tmp_path):
    found.travelling(found.best.certificate).to_json(tmp_path / "c.json")
    assert "bounds" in json.loads((tmp_path / "c.json").read_text())
    assert load(tmp_path / "c.json").verify()


def test_a_plant_that_cannot_be_observed_gets_the_proof_of_it():
    found = designs.survey(Linear([[1.0, 0.0], [0.0, 2.0]], None, [[1.0, 0.0]]), ([-1.0] * 2, [1.0] * 2))
    assert found.best is None
    assert found.absence.verify()
    assert all(one.certificate is None and one.observer is None and one.reason and one.change for one in found.candidates)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"within": ([0.0], [1.0])}, r"survey\.within"),
        ({"within": ([-np.inf] * 2, [np.inf] * 2)}, "nothing bounds"),
        ({"rate": -1.0}, r"survey\.rate"),
    ],
)
def test_surveys_that_do_not_fit_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        designs.survey(Pendulum(), **({"within": ([-1.0] * 2, [1.0] * 2), "inputs": None} | options))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x1", "expected NAME=LOW:HIGH"),
        ("x3=0:1", "expected x1 to x2"),
        ("v1=0:1", "expected NAME=LOW:HIGH"),
        ("x1=0:one", "expected two numbers"),
        ("x1=1:0", "expected LOW <= HIGH"),
        ("u1=0:1", "no u"),
    ],
)
def test_intervals_on_the_command_line(text, message):
    with pytest.raises(ValueError, match=message):
        bounds((text,), 2, 0)
    (low, high), _ = bounds(("x2=-1e3:inf",), 2, 0)
    assert (low.tolist(), high.tolist()) == ([-np.inf, -1000.0], [np.inf, np.inf])


def test_design_writes_certificates_of_a_plant_of_ones_own(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.py").write_text(CLASS)
    assert run(monkeypatch, "design", "swing.py:Mine", "--rate", "1.0", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert "chain of integrators" in told["form"]
    assert told["best"] == told["designs"][0]["design"]
    for row in told["designs"]:
        assert load(row["certificate"]).verify()
        np.testing.assert_array_equal(load(row["certificate"]).gain, row["gain"])
    # Of a state that nothing bounds cos is bounded by its own range, which the stand-alone check knows too.
    assert run(monkeypatch, "verify", told["designs"][0]["certificate"]) == 0
    assert run(monkeypatch, "design", "Duffing") == 2
    assert "--within" in " ".join(capsys.readouterr().err.split())


def test_design_says_that_nothing_can_be_done_and_why(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    text = "from jaxobs.plants import Linear\nblind = Linear([[1.0, 0.0], [0.0, 2.0]], None, [[1.0, 0.0]])\n"
    (tmp_path / "blind.py").write_text(text)
    assert run(monkeypatch, "design", "blind.py") == 1
    out = " ".join(capsys.readouterr().out.split())
    assert "not certified" in out
    assert "no constant gain can do it" in out
    assert load(tmp_path / "designs" / "absence.json").verify()


@pytest.mark.parametrize(
    ("name", "code", "verdict"),
    [
        ("audit_pendulum", 0, "certified"),
        ("audit_switching", 1, "unstable under switching (proved)"),
        ("given_gain", 0, "certified"),
    ],
)
def test_audit(name, code, verdict, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, "audit", name, "--json") == code
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == verdict
    assert load(tmp_path / "audit.json").verify()
    assert load(tmp_path / "audit.json").claim == told["claim"]


def test_audit_of_a_gain_that_is_unstable_at_a_constant_slope(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, "audit", "audit_pendulum", "--set", "audit.gain=[[1.0],[1.0]]") == 1
    out = " ".join(capsys.readouterr().out.split())
    assert "unstable at corner 1 (exact)" in out
    assert run(monkeypatch, "audit", "audit_pendulum", "--set", "audit.gian=1.0") == 2
    assert "Did you mean 'gain'?" in " ".join(capsys.readouterr().err.split())
    assert run(monkeypatch, "audit", "study_pendulum") == 2


def test_another_plant_in_the_place_of_that_of_a_config(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swung.py").write_text(CLASS)
    assert run(monkeypatch, "audit", "audit_pendulum", "--plant", "swung.py:Mine", "--json") == 0
    assert json.loads(capsys.readouterr().out)["certified"]
    assert run(monkeypatch, "certify", "pendulum", "--plant", "swung.py:Mine", "--set", "design.lipschitz=2.0") == 1
    assert run(monkeypatch, "certify", "pendulum", "--plant", "swung.py:Mine", "--set", "design.gamma=9.0") == 0


@pytest.mark.slow
def test_the_survey_of_a_plant_that_is_no_chain():
    found = designs.survey(Lorenz(), ([-20.0, -25.0, 0.0], [20.0, 25.0, 50.0]), rate=1.0)
    assert [one.name for one in found.candidates if one.certificate is not None]
    assert "high_gain" not in [one.name for one in found.candidates]
