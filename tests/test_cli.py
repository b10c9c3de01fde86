"""The command line as a user types it."""

import dataclasses

import jax.numpy as jnp
import pytest

import jaxobs
from jaxobs import cli
from jaxobs.certificates import AbstractCertificate, load


@pytest.fixture
def file(tmp_path):
    plant = jaxobs.plants.Pendulum()
    _, certificate = jaxobs.designs.riccati(plant, alphas=jnp.asarray([3.0, 2.0]), gamma=6.0, lipschitz=1.5)
    assert isinstance(certificate, AbstractCertificate)
    certificate.to_json(tmp_path / "c.json")
    return tmp_path / "c.json"


def run(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["jaxobs", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return stop.value.code


def test_verify(monkeypatch, capsys, file):
    assert run(monkeypatch, "verify", str(file)) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "holds" in out
    assert "assumes: phi is Lipschitz" in out


def test_verify_says_not_certified(monkeypatch, capsys, file):
    dataclasses.replace(load(file), lipschitz=2.0).to_json(file)
    assert run(monkeypatch, "verify", str(file)) == 1
    out = capsys.readouterr().out
    assert "not certified" in out
    assert "unstable" not in out


def test_verify_refuses_what_is_no_certificate(monkeypatch, capsys, tmp_path):
    (tmp_path / "x.json").write_text("{}")
    assert run(monkeypatch, "verify", str(tmp_path / "x.json")) == 2
    assert run(monkeypatch, "verify", str(tmp_path / "missing.json")) == 2
    assert "jaxobs-cert/1" in " ".join(capsys.readouterr().err.split())


def test_help_fits_a_page(monkeypatch, capsys):
    assert run(monkeypatch, "--help") == 0
    text = capsys.readouterr().out
    assert "demo" in text
    assert "verify" in text
    assert len(text.splitlines()) < 40
