"""The claims of the five papers: every verdict follows from its evidence, every statement of the print has its row."""

import importlib
import json
import math

import pytest

from jaxobs import cli, papers
from jaxobs.papers.claims import OURS, Bound, Claim, Point, Statement, Value, half_digit
from jaxobs.report import papers_text


@pytest.mark.parametrize(
    ("kind", "printed", "evidence", "verdict"),
    [
        ("value", "3.5620", Value(3.56203820), "reproduced"),
        ("value", "3.5620", Value(3.5621), "slip"),
        ("value", "31.72", Value(31.715), "reproduced"),
        ("value", "1.3e6", Value(1.34e6), "reproduced"),
        ("value", "2", Value(math.nan), "open"),
        ("bound", "1.5", Bound(1.118), "conservative"),
        ("bound", "1.12", Bound(1.118), "reproduced"),
        ("bound", "1.0", Bound(1.118), "false as stated"),
        ("bound", "1.0", Bound(1.118, "lower"), "conservative"),
        ("bound", "1.2", Bound(1.118, "lower"), "false as stated"),
        ("feasible", "0.0915", Point(True, 0.0918934), "conservative"),
        ("feasible", "X", Point(True), "reproduced"),
        ("feasible", "X", Point(False), "false as stated"),
        ("identity", "A = B", Statement(True, 0.0), "reproduced"),
        ("universal", "for all x", Statement(False, "x = 2"), "false as stated"),
        ("universal", "for all x", Statement(None), "open"),
    ],
)
def test_the_verdict_follows_from_kind_and_evidence(kind, printed, evidence, verdict):
    row = Claim("000", "c", kind, printed, lambda: evidence).check()
    assert row.verdict == verdict
    assert row.seconds >= 0
    scanned = Claim("000", "c", kind, printed, lambda: evidence, scan=True).check()
    assert scanned.verdict == ("scan?" if verdict in ("slip", "false as stated") else verdict)


def test_rows_of_ours_are_counted_apart():
    rows = [
        Claim("000", name, "identity", printed, lambda: Statement(True)).check() for name, printed in (("a", "x"), ("b", OURS))
    ]
    assert papers_text.count(rows) == "1 claims: 1 reproduced; and 1 rows of ours"


def test_half_a_unit_of_the_last_digit():
    assert half_digit("0.0915") == (0.0915, pytest.approx(0.00005))
    assert half_digit("144") == (144.0, 0.5)
    assert half_digit("1.30e6") == (1.3e6, pytest.approx(5e3))
    with pytest.raises(ValueError, match="expected a plain number"):
        half_digit("about 3")
    with pytest.raises(ValueError, match="expected a finite number"):
        half_digit("NaN")


def test_evidence_of_another_kind_is_refused():
    with pytest.raises(TypeError, match="given Value for a claim of kind bound"):
        Claim("000", "c", "bound", "1", lambda: Value(1.0)).check()


def test_a_claim_has_one_name():
    paper = papers.Paper("000", "t")
    paper.claim("a", "value", "1")(lambda: Value(1.0))
    with pytest.raises(ValueError, match="twice"):
        paper.claim("a", "value", "2")(lambda: Value(2.0))


def test_an_unknown_paper_is_refused():
    with pytest.raises(ValueError, match="paper: given '005'; expected one of 000"):
        papers.load("005")


@pytest.mark.parametrize("number", papers.PAPERS)
def test_every_statement_of_the_print_has_its_rows(number):
    coverage = importlib.import_module(f"statements.p{number}").COVERAGE
    names = {claim.name for claim in papers.load(number).claims}
    reached = {name for rows in coverage.values() if rows != "definition" for name in rows}
    assert all(rows == "definition" or len(rows) > 0 for rows in coverage.values())
    assert not sorted(reached - names), "no such claims"
    assert not sorted(names - reached), "claims that belong to no statement of the print"


@pytest.mark.parametrize("number", papers.PAPERS)
def test_the_short_form_settles_every_row(number):
    rows = list(papers.reproduce(number, short=True))
    assert rows
    for row in rows:
        assert row.verdict == "reproduced" or row.why, f"{row.claim}: {row.verdict} without a reason"
        assert row.verdict != "slip" or isinstance(row.ours, float)
    json.dumps([row.__dict__ for row in rows])


@pytest.mark.slow
def test_the_whole_run_by_the_command_line(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("sys.argv", ["jaxobs", "reproduce", "--json", "--figures", str(tmp_path)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 0
    rows = json.loads(capsys.readouterr().out)
    assert list(rows[0]) == ["paper", "claim", "kind", "printed", "ours", "verdict", "why", "seconds"]
    assert {row["paper"] for row in rows} == set(papers.PAPERS)
    assert sum(len(papers.load(number).claims) for number in papers.PAPERS) == len(rows)
    assert all(row["verdict"] == "reproduced" or row["why"] for row in rows)
    assert sum(row["seconds"] for row in rows) < 600, "it is meant to take minutes"
    modules = [importlib.import_module(f"jaxobs.papers.p{number}") for number in papers.PAPERS]
    assert len(list(tmp_path.glob("*.png"))) == sum(len(module.PICTURES) for module in modules)
