"""`jaxobs certify` and `jaxobs verify` as a user types them: every example of the package, every way to go wrong."""

import dataclasses
import json
import tomllib
from pathlib import Path

import pytest

from jaxobs import cli
from jaxobs.certificates import load
from jaxobs.certificates.checker import digest
from jaxobs.cli.examples import examples
from jaxobs.cli.methods import METHODS

SLOW = {"analysis", "flexible_joint", "lorenz", "pendulum_box", "pendulum_s_lemma", "synthesis"}


def run(monkeypatch, *arguments) -> int:
    monkeypatch.setattr("sys.argv", ["jaxobs", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code


@pytest.fixture
def config(tmp_path):
    def write(text: str):
        path = tmp_path / "config.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


PENDULUM = '[plant]\nname = "Pendulum"\n'
RICCATI = PENDULUM + '[design]\nmethod = "riccati"\nalphas = [3.0, 2.0]\ngamma = 6.0\nlipschitz = 1.5\n'
SLOPE = PENDULUM + '[design]\nmethod = "s_lemma"\nalphas = [3, 2]\n'
GIVEN = examples("certify")["given_gain"]


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in examples("certify")])
def test_every_example_is_proved(monkeypatch, capsys, tmp_path, name):
    assert run(monkeypatch, "certify", name, "-o", tmp_path / "c.json") == 0
    out = capsys.readouterr().out
    assert "holds for the stored model and bounds" in out
    assert out.count("assumes:") == len(load(tmp_path / "c.json").assumptions)
    assert load(tmp_path / "c.json").verify()


def test_the_file_says_what_the_config_asked_for(monkeypatch, tmp_path, config):
    assert run(monkeypatch, "certify", config(RICCATI), "-o", tmp_path / "c.json") == 0
    certificate = load(tmp_path / "c.json")
    assert (certificate.alphas, certificate.gamma, certificate.lipschitz) == ((3.0, 2.0), 6.0, 1.5)


def test_json_of_both_commands(monkeypatch, capsys, tmp_path, config):
    assert run(monkeypatch, "certify", config(GIVEN), "-o", tmp_path / "c.json", "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert run(monkeypatch, "verify", tmp_path / "c.json", "--json") == 0
    assert json.loads(capsys.readouterr().out) == [made]
    assert made["holds"]
    assert made["claim"] == load(tmp_path / "c.json").claim


def test_infeasible_says_why_and_what_to_change(monkeypatch, capsys, tmp_path, config):
    weak = config(RICCATI.replace("gamma = 6.0", "gamma = 1.0"))
    assert run(monkeypatch, "certify", weak, "-o", tmp_path / "c.json") == 1
    out = capsys.readouterr().out
    assert "not certified:" in out
    assert "to change:" in out
    assert "unstable" not in out
    assert not (tmp_path / "c.json").exists()
    assert run(monkeypatch, "certify", weak, "-o", tmp_path / "c.json", "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert told["holds"] is False
    assert told["reason"]
    assert told["change"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["design.method", "the name of a design"]),
        ("[design", ["config.toml"]),
        ("[desing]\n", ["desing", "Did you mean 'design'?"]),
        (PENDULUM + '[design]\nmethod = "ricatti"\n', ["design.method", "Did you mean 'riccati'?"]),
        (PENDULUM + '[design]\nmethod = "riccati"\n', ["design.lipschitz: given nothing; expected a number"]),
        (RICCATI.replace("1.5", '"1.5"'), ["design.lipschitz: given '1.5'; expected a number"]),
        (RICCATI.replace("1.5", "true"), ["design.lipschitz: given True; expected a number"]),
        (RICCATI.replace("[3.0, 2.0]", "3.0"), ["design.alphas: given 3.0; expected a list of numbers"]),
        (RICCATI.replace("[3.0, 2.0]", '["3", 2]'), ["design.alphas", "expected a list of numbers"]),
        (RICCATI + "q = 1.0\n", ["design.q: given 1.0; expected a whole number"]),
        (RICCATI + "gama = 1.0\n", ["design.gama", "Did you mean 'gamma'?"]),
        (RICCATI.replace("lipschitz = 1.5", "lipschitz = -1.5"), ["lipschitz", "expected a positive number"]),
        (RICCATI.replace("Pendulum", "Pendulm"), ["plant.name", "Did you mean 'Pendulum'?"]),
        (RICCATI.replace('name = "Pendulum"', "a = 1.0"), ["plant.name", "the name of a plant"]),
        (RICCATI.replace('"Pendulum"', '"Pendulum"\nmass = 1.0'), ["plant.mass", "expected one of a, b, period"]),
        (RICCATI.replace('"Pendulum"', '"Pendulum"\na = "1"'), ["plant.a: given '1'"]),
        (RICCATI.replace('"Pendulum"', '"IntegratorChain"'), ["plant.n: given nothing"]),
        (RICCATI.replace('"Pendulum"', '"Pendulum"\nperiod = "1"'), ["plant.period", "a number"]),
        (RICCATI.replace(PENDULUM, ""), ["plant: given nothing"]),
        (PENDULUM + '[design]\nmethod = "lpv_lmi"\n', ["bounds: given nothing"]),
        (PENDULUM + '[bounds]\nlower = [1.0]\nupper = [[1.0]]\n[design]\nmethod = "lpv_lmi"\n', ["bounds.lower", "rows"]),
        (SLOPE, ["design.slope: given nothing; expected a table"]),
        (
            PENDULUM + '[design]\nmethod = "s_lemma"\nalphas = [3, 2]\nslope = 1.0\n',
            ["design.slope: given 1.0; expected a table"],
        ),
        (SLOPE + "slope = {}\n", ["design.slope.lipschitz"]),
        (GIVEN.replace("[1.0]\n", "[-1.0]\n"), ["lower[0] = -0.5 > upper[0] = -1"]),
        (GIVEN.replace("[[4.0], [5.0]]", "[[4.0], [5.0, 1.0]]"), ["design.gain", "all of one length"]),
        (GIVEN.replace("[[4.0], [5.0]]", "[[4.0, 5.0]]"), ["gain", "transposed"]),
    ],
)
def test_a_wrong_config_is_named_by_its_key(monkeypatch, capsys, tmp_path, config, text, words):
    assert run(monkeypatch, "certify", config(text), "-o", tmp_path / "c.json") == 2
    told = " ".join(capsys.readouterr().err.split())
    assert not [word for word in words if word not in told], told
    assert not (tmp_path / "c.json").exists()


def test_a_missing_config_names_the_examples(monkeypatch, capsys, tmp_path):
    assert run(monkeypatch, "certify", "nonsuch", "-o", tmp_path / "c.json") == 2
    told = capsys.readouterr().err
    assert all(name in told for name in examples("certify"))


def test_the_examples_show_different_methods():
    shown = {tomllib.loads(text)["design"]["method"] for text in examples("certify").values()}
    assert len(shown) >= 5
    assert shown <= set(METHODS)


def test_verify_takes_several_files_and_the_worst_decides(monkeypatch, capsys, tmp_path, config):
    good, bad, none = tmp_path / "good.json", tmp_path / "bad.json", tmp_path / "none.json"
    run(monkeypatch, "certify", config(RICCATI), "-o", good)
    dataclasses.replace(load(good), lipschitz=2.0).to_json(bad)
    none.write_text("{}")
    capsys.readouterr()
    assert run(monkeypatch, "verify", good, good) == 0
    assert capsys.readouterr().out.count("holds for the stored model and bounds") == 2
    assert run(monkeypatch, "verify", good, bad) == 1
    assert "not certified" in capsys.readouterr().out
    assert run(monkeypatch, "verify", good, bad, none) == 2
    assert run(monkeypatch, "verify", none, "--json") == 2
    captured = capsys.readouterr()
    assert "jaxobs-cert/1" in captured.err
    assert "jaxobs-cert/1" in json.loads(captured.out[captured.out.index("[\n") :])[0]["error"]


def test_bounds_that_travel_are_checked_too(monkeypatch, capsys, tmp_path):
    stored = Path(__file__).parent.parent / "notebooks" / "certificates" / "proved_bounds.json"
    assert run(monkeypatch, "verify", stored) == 0
    assert "the bounds hold for these formulas" in capsys.readouterr().out
    data = json.loads(stored.read_text(encoding="utf-8"))
    data["bounds"]["upper"][0] = (40.0).hex()  # angles, and so slopes, that the bisection does not cover
    data["bounds"]["upper"][2] = (5.0).hex()
    data["sha256"] = digest(data)
    (tmp_path / "c.json").write_text(json.dumps(data), encoding="utf-8")
    assert run(monkeypatch, "verify", tmp_path / "c.json") == 1
    assert "bounds not proved" in capsys.readouterr().out


def test_a_search_without_result_decides_nothing(monkeypatch, capsys, tmp_path, config):
    asked = GIVEN[: GIVEN.index("[design]")] + '[design]\nmethod = "undetectable"\n'
    assert run(monkeypatch, "certify", config(asked), "-o", tmp_path / "c.json", "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert "decides nothing" in told["reason"]
    assert told["margin"] is None


def test_bench_offers_the_synthesis_tables(monkeypatch, capsys):
    assert run(monkeypatch, "bench", "--help") == 0
    assert "synthesis" in capsys.readouterr().out
