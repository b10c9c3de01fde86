"""`jaxobs differentiate`: CSV in, CSV and picture out."""

import json

import numpy as np
import pandas as pd
import pytest
from test_cli_start import run

import jaxobs

TS = np.arange(0.0, 3.0, 0.01)
Y = np.sin(3 * TS)


@pytest.fixture
def record(tmp_path):
    table = pd.DataFrame({"time": TS, "angle": Y, "other": TS**2})
    table.loc[[40, 41], "angle"] = np.nan
    table.to_csv(tmp_path / "walk.csv", index=False)
    return tmp_path / "walk.csv"


def test_it_writes_what_the_function_returns_and_a_picture(record, monkeypatch, capsys, tmp_path):
    options = ["--column", "angle", "--order", "2", "--mu", "20", "--figure", str(tmp_path / "d.png"), "--json"]
    assert run(monkeypatch, "differentiate", str(record), *options) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["samples"], told["lost"], told["mu"], told["mu_from"]) == (300, 2, 20.0, "given")
    table = pd.read_csv(told["file"])
    assert table.columns.tolist() == ["time", "angle", "angle'", "angle''"]
    lost = np.where(np.isin(np.arange(300), [40, 41]), np.nan, Y)
    expected = jaxobs.differentiate(TS, lost, order=2, mu=20.0).xhat
    np.testing.assert_allclose(table.to_numpy()[:, 1:], expected, rtol=1e-12, atol=1e-12)
    assert np.sqrt(np.mean((table["angle'"][100:] - 3 * np.cos(3 * TS[100:])) ** 2)) < 0.1
    assert (tmp_path / "d.png").read_bytes().startswith(b"\x89PNG")


def test_dates_are_times_and_stay_dates(monkeypatch, capsys, tmp_path):
    when = pd.date_range("2026-11-22", periods=300, freq="10ms")
    pd.DataFrame({"when": when, "angle": Y}).to_csv(tmp_path / "dates.csv", index=False)
    assert run(monkeypatch, "differentiate", str(tmp_path / "dates.csv"), "--mu", "20", "-o", str(tmp_path / "o.csv")) == 0
    assert "one every 0.01 s" in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "o.csv", parse_dates=["when"])
    assert table["when"].tolist() == when.tolist()


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (None, [], "No such file"),
        ("", [], "a header"),
        ("t\n1\n", [], "a time and a signal"),
        ("t,y,z\n0,1,2\n1,2,3\n", [], "expected one of y, z"),
        ("t,y\n0,1\n1,2\n", ["--column", "w"], "--column: given 'w'"),
        ("t,y\n0,1\n1,two\n", [], "'two' in row 2 of 'y'"),
        ("t,y\nnoon,1\nlater,2\n", [], "seconds or dates"),
        ("t,y\n0,1\n1,2\n", [], "more than"),
        ("t,y\n" + "".join(f"{k % 9},1\n" for k in range(30)), [], "increasing times"),
    ],
)
def test_records_that_do_not_fit_are_refused(text, options, message, monkeypatch, capsys, tmp_path):
    path = tmp_path / "r.csv"
    if text is not None:
        path.write_text(text)
    assert run(monkeypatch, "differentiate", str(path), *options) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.glob("*.derivatives.csv")) == []
