"""What a newcomer types first: help, init, plants, observers, and a plant of one's own in a file."""

import json
import pickle
import tomllib

import jax.numpy as jnp
import numpy as np
import pytest

import jaxobs
from jaxobs import cli
from jaxobs.cli.examples import command_of, everything, parse
from jaxobs.cli.parts import Reader, catalogue
from jaxobs.plants import AbstractPlant, Pendulum
from jaxobs.studies.config import describe

CLASS = '''
import jax.numpy as jnp
from jaxobs import Scalar, param
from jaxobs.plants import AbstractChain

class Mine(AbstractChain):
    """x1' = x2, x2' = -k sin(x1) + u, y = x1."""

    k: Scalar = param(default=2.0)
    n = 2
    m = 1

    def phi(self, x, u):
        return -self.k * jnp.sin(x[0]) + u[0]
'''
OBJECT = """
from jaxobs.plants import from_function

def f(x, u, parameters):
    return [x[1], -parameters["k"] * x[0] + u[0]]

def h(x, u, parameters):
    return x[:1]

spring = from_function(f, h, n=2, m=1, p=1, parameters={"k": 3.0})
"""


def run(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["jaxobs", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def plant_of(table, **more):
    return Reader(**more).part(AbstractPlant, "a plant", table, "plant").build({}, {})


def test_help_names_every_command_in_a_line_and_the_exit_codes(monkeypatch, capsys):
    assert run(monkeypatch, "--help") == 0
    text = capsys.readouterr().out
    assert all(f"• {name}" in text for name in cli.COMMANDS)
    assert "130 stopped" in text
    assert len(text.splitlines()) <= 40


@pytest.mark.parametrize("name", list(cli.COMMANDS))
def test_every_command_has_json_and_no_negated_flags(name, monkeypatch, capsys):
    assert run(monkeypatch, name, "--help") == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "--json" in text
    assert "--no-json" not in text


def test_version_and_unknown_commands(monkeypatch, capsys):
    assert run(monkeypatch, "--version") == 0
    assert capsys.readouterr().out.strip() == jaxobs.__version__
    assert run(monkeypatch, "simulate") == 2
    assert "Available subcommands" in capsys.readouterr().err


def test_init_writes_what_runs_and_never_over_a_file(monkeypatch, capsys, here):
    assert run(monkeypatch, "init", "--json") == 0
    assert set(json.loads(capsys.readouterr().out)) == set(everything())
    assert run(monkeypatch, "init", "study_pendulum") == 0
    assert "jaxobs study study_pendulum.toml" in capsys.readouterr().out
    assert parse(here / "study_pendulum.toml", "study") == tomllib.loads(everything()["study_pendulum"])
    (here / "study_pendulum.toml").write_text("mine")
    assert run(monkeypatch, "init", "study_pendulum") == 2
    assert (here / "study_pendulum.toml").read_text() == "mine"
    assert run(monkeypatch, "init", "study_pendulum", "--force") == 0
    assert (here / "study_pendulum.toml").read_text() == everything()["study_pendulum"]
    assert run(monkeypatch, "init", "study_pendulm") == 2
    assert "Did you mean 'study_pendulum'?" in " ".join(capsys.readouterr().err.split())


def test_the_plant_of_init_is_one(monkeypatch, capsys, here):
    assert run(monkeypatch, "init", "plant", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told == {"file": "my_plant.py", "run": "jaxobs design my_plant.py"}
    plant = plant_of({"name": "my_plant.py:MyPlant", "w": 2.0})
    assert float(plant.phi(jnp.array([0.5, 0.0]), jnp.array([0.0]))) == pytest.approx(-4 * np.sin(0.5))
    assert command_of("plant") == "design"


@pytest.mark.parametrize("what", ["plants", "observers"])
def test_catalogues_list_every_class_with_what_it_says(what, monkeypatch, capsys):
    assert run(monkeypatch, what, "--json") == 0
    lines = json.loads(capsys.readouterr().out)
    base = AbstractPlant if what == "plants" else jaxobs.observers.Observer
    assert set(lines) == set(catalogue(base))
    assert all(lines.values())


def test_a_plant_in_full(monkeypatch, capsys):
    assert run(monkeypatch, "plants", "Pendulum") == 0
    text = capsys.readouterr().out
    assert "x2' = a sin(x1) + u cos(x1) - b x2" in text
    assert "chain of integrators" in text
    assert run(monkeypatch, "plants", "Pendulm") == 2
    assert "Did you mean 'Pendulum'?" in " ".join(capsys.readouterr().err.split())
    assert run(monkeypatch, "observers", "HighGain", "--json") == 0
    assert "alphas" in json.loads(capsys.readouterr().out)["parameters"]


def test_a_class_of_ones_own_takes_parameters_and_axes(here):
    (here / "classy.py").write_text(CLASS)
    assert float(plant_of({"name": "classy.py", "k": 5.0}).k) == 5.0
    part = Reader(numbers=True).part(AbstractPlant, "a plant", {"name": "classy.py:Mine", "k": [1.0, 2.0]}, "plant")
    family = part.family({}, {}, np.dtype(float))
    assert family.names == ("k",)
    again = pickle.loads(pickle.dumps(plant_of({"name": "classy.py:Mine"})))
    assert float(again.k) == 2.0


def test_a_file_runs_once_until_it_is_edited(here):
    """The plant and the model that is made like it are of one class, which pickles by its name."""
    (here / "once.py").write_text(CLASS)
    first, second = plant_of({"name": "once.py"}), plant_of({"name": "once.py:Mine"})
    assert type(first) is type(second)
    pickle.loads(pickle.dumps(first))
    (here / "once.py").write_text(CLASS.replace("2.0", "4.0"))
    assert float(plant_of({"name": "once.py"}).k) == 4.0


def test_an_object_of_ones_own_keeps_its_fields(here):
    (here / "springy.py").write_text(OBJECT)
    plant = plant_of({"name": "springy.py:spring"})
    np.testing.assert_allclose(plant.flow(jnp.zeros(()), jnp.array([1.0, 2.0]), jnp.array([0.5])), [2.0, -2.5])


def test_a_plant_beside_its_config_is_found_from_anywhere(here, monkeypatch):
    folder = here / "study"
    folder.mkdir()
    (folder / "besides.py").write_text(CLASS)
    (folder / "c.toml").write_text('[plant]\nname = "besides.py:Mine"\n')
    tables = parse(folder / "c.toml", "certify")
    assert float(plant_of(tables["plant"]).k) == 2.0


@pytest.mark.parametrize(
    ("text", "spec", "message"),
    [
        (None, "nowhere.py:Mine", "a file that exists"),
        ("x = 1\n", "empty.py", "a file with a plant in it"),
        ("import jax\nx = 1 / 0\n", "broken.py", "ZeroDivisionError in line 2"),
        (CLASS, "named.py:Mien", "Did you mean 'Mine'?"),
        (CLASS + "\nother = Mine(3.0)\n", "two.py", "the name of one of its plants, Mine, other"),
        (CLASS, "json.py", "that of no other module"),
    ],
)
def test_files_that_do_not_fit_are_refused_by_name(text, spec, message, here):
    if text is not None:
        (here / spec.partition(":")[0]).write_text(text)
    with pytest.raises(ValueError, match=r"^config\.plant\.name") as refusal:
        plant_of({"name": spec})
    assert message in str(refusal.value)


def test_a_study_of_ones_own_plant_knows_when_its_code_changed(here):
    """The same fields, another phi: another study, for a store to refuse."""
    seen = []
    for factor in ("1.0", "2.0"):
        (here / "kept.py").write_text(CLASS.replace("jnp.sin", f"{factor} * jnp.sin"))
        seen.append(describe(plant_of({"name": "kept.py:Mine"})))
    assert seen[0] != seen[1]
    assert seen[0]["class"] == "kept.Mine"
    assert describe(Pendulum())["class"] == "jaxobs.plants.pendulum.Pendulum"
