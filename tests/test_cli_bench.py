"""`jaxobs bench studies`: what the examples cost here."""

import importlib
import json

from study_tables import TINY
from test_cli_start import run

study = importlib.import_module("jaxobs.cli.study")


def test_the_table_counts_what_it_timed(monkeypatch, capsys):
    monkeypatch.setattr("jaxobs.cli.examples.examples", lambda command: {f"{command}_tiny": TINY})
    monkeypatch.setattr(study, "set_up", lambda *_, **__: None)
    assert run(monkeypatch, "bench", "studies", "--json") == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["study"], row["precision"], row["lanes"], row["steps"]) == ("study_tiny", "float64", 24, 11)
    assert 0 < row["ns a lane-step"] < 1e9 * row["first result [s]"]
    assert row["peak memory [MB]"] > 0


def test_options_of_the_other_table_are_refused(monkeypatch, capsys, tmp_path):
    assert run(monkeypatch, "bench", "studies", "--figures", str(tmp_path)) == 2
    assert "--figures: given" in " ".join(capsys.readouterr().err.split())
