"""The page: one file with everything inside, that says what the data say."""

import json
import re
import shutil
import subprocess

import equinox as eqx
import jax
import numpy as np
import picture_cases as cases
import plotly.graph_objects as go
import pytest

from jaxobs import plotting, report
from jaxobs.observers import HighGain
from jaxobs.report import explorer
from jaxobs.report.page import STYLE, Chart, Section, as_json, page
from jaxobs.tuning import Front, Point
from tests.test_tuning_figures import tuned

pytestmark = pytest.mark.usefixtures("hardly_optimised")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A report of every kind of thing, as (path, text)."""
    observer = HighGain(cases.PLANT, [3.0, 2.0], 6.0)
    points = tuple(Point(float(k), {"noise": k + 1.0}, 0.0, observer, None, cases.region(), False) for k in (1, 2))
    front = Front(points, ((3.0, 2.5),), "1/s", 1.0)
    things = [
        {"Noise": cases.study(), "A run": cases.run()}, cases.batch(), cases.rungs(), {"Search": tuned(certified=False)}, front,
        cases.region(), plotting.poles([3.0, 2.0]), go.Figure(go.Scatter(y=[1, 2])), "A <b>sentence</b> & </script>",
    ]  # fmt: skip
    path = report.write(tmp_path_factory.mktemp("page") / "deep" / "report.html", *things, title="All <of> it")
    return path, path.read_text(encoding="utf-8")


def charts(text):
    """The data of the charts, in their order."""
    found = re.findall(r'<script type="application/json" id="chart-\d+">(.*?)</script>', text, re.DOTALL)
    return [json.loads(one) for one in found]


def test_nothing_is_loaded_from_anywhere(written):
    path, text = written
    outside = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    resources = re.findall(r'<(?:script|link|img|iframe|source|video)\b[^>]*?\b(?:src|href)="([^"]*)"', text)
    assert resources
    assert all(one.startswith("data:") for one in resources)
    assert not re.search(r"@import|url\(", STYLE)
    assert not re.search(r"https?://", outside)
    assert text.count("plotly.js v") == 1
    assert 4.5e6 < path.stat().st_size < 6e6


def test_what_was_given_cannot_become_markup(written):
    _, text = written
    assert "<h1>All &lt;of&gt; it</h1>" in text
    assert "A &lt;b&gt;sentence&lt;/b&gt; &amp; &lt;/script&gt;" in text
    assert len(charts(text)) == len(re.findall(r'class="chart"', text))
    odd = Chart(as_json({"name": "</script><script>alert(1)</script>", "value": [1.0, float("nan"), float("inf")]}), "x")
    found = page("t", [Section("h", charts=[odd])])
    assert charts(found) == [{"name": "</script><script>alert(1)</script>", "value": [1.0, None, None]}]


def test_a_study_on_the_page_is_the_data_set(written):
    data = charts(written[1])[0]
    ds = cases.study()
    assert [(axis["name"], axis["labels"], axis["values"]) for axis in data["axes"]] == [
        ("q", ["0", "1"], [0.0, 1.0]), ("gamma", ["2", "4", "8"], [2.0, 4.0, 8.0]),
    ]  # fmt: skip
    assert (data["across"], data["lines"], data["seeds"]) == (1, 0, 6)
    assert [metric["name"] for metric in data["metrics"]] == ["rmse", "peak"]
    rmse = data["metrics"][0]
    expected = ds["rmse"].quantile([0.05, 0.5, 0.95], "seed").transpose("quantile", "q", "gamma", "state").values
    np.testing.assert_allclose(np.reshape(rmse["quantiles"], (3, 2, 3, 2)), expected, rtol=5e-5)  # five digits
    assert rmse["parts"] == ["x1", "x2"]


def test_the_table_of_a_study_has_its_medians(written):
    _, text = written
    median = cases.study()["rmse"].median("seed").sel(q=1, gamma=4.0, state=1).item()
    row = next(row for row in re.findall(r"<tr>(.*?)</tr>", text) if re.match(r"<td>1</td><td>4</td>", row))
    assert re.findall(r"<td>(.*?)</td>", row)[3].startswith(f"{median:.4g} [")
    assert "36 runs, of which none diverged" in text
    assert "&lt;/script&gt;&lt;b&gt;" in text  # the configuration, in full


def test_large_studies_are_thinned_and_the_page_says_so():
    ds = cases.study().isel(gamma=np.arange(4000) % 3, seed=np.arange(60) % 6)[["rmse", "diverged_at", "x"]].copy(deep=True)
    ds = ds.assign_coords(gamma=np.linspace(100.0, 101.0, 4000))
    ds.diverged_at[0, 1, :] = 0.5  # at a gamma that may not be shown
    found = explorer.explorer(ds)
    assert (found.computed, found.diverged) == (2 * 4000 * 60, 60)
    assert f"The table has {explorer.ROWS} of" in " ".join(found.notes)
    data = json.loads(found.chart.data)
    sizes = [len(axis["labels"]) for axis in data["axes"]]
    assert all(len(set(axis["labels"])) == len(axis["labels"]) for axis in data["axes"])
    assert np.prod(sizes) <= explorer.POINTS
    assert any(note.startswith("Of 4000 values of gamma") for note in found.notes)
    assert len(found.points[1]) <= explorer.ROWS


def test_infinite_values_are_gaps_and_said():
    ds = cases.study()[["rmse", "diverged_at"]].copy(deep=True)
    ds.rmse[0, 0, 1:] = np.inf  # a metric that most runs never reach
    found = explorer.explorer(ds)
    assert "10 of 72 values of rmse are infinite" in " ".join(found.notes)
    (metric,) = json.loads(found.chart.data)["metrics"]
    assert metric["quantiles"][1][:2] == [None, None]
    assert None not in metric["quantiles"][1][2:]


def test_runs_that_all_diverged_are_shown_as_far_as_they_go():
    run = cases.run()
    lost = eqx.tree_at(lambda one: one.xhat, run, run.xhat.at[100:].set(np.nan))
    (section,) = report.sections(lost)
    assert "The run diverged." in section.paragraphs[0]
    two = jax.tree.map(lambda a, b: np.stack([a, b]), lost, eqx.tree_at(lambda one: one.x, lost, lost.x + 1.0))
    (section,) = report.sections(two)
    assert "2 runs, of which 2 diverged." in section.paragraphs[0]
    assert "error of the estimate" in section.charts[0].caption
    assert "error" in {trace["name"] for trace in json.loads(section.charts[0].data)["data"]}


def test_runs_on_the_page_have_slider_truth_and_errors(written):
    _, text = written
    data, layout = charts(text)[1]["data"], charts(text)[1]["layout"]
    names = {trace["name"] for trace in data}
    assert names == {"truth", "estimate", "measurement"}
    assert layout["xaxis2"]["rangeslider"]["visible"]
    assert len({trace["legendgroup"] for trace in data}) == 3
    assert sum(trace["showlegend"] for trace in data) == 3  # one entry toggles a line in both panels
    peak = np.max(np.abs(np.asarray(cases.run().xhat - cases.run().x)), axis=0)[1]
    assert f">{peak:.4g}</td>" in text
    assert "samples were lost" in text
    assert "5 to 95 % of 8 runs" in {trace["name"] for trace in charts(text)[2]["data"]}


def test_a_certificate_brings_claim_assumptions_verdict_and_margins(written):
    _, text = written
    certificate = cases.region()
    verdict = certificate.verify()
    plain = text.replace("&#x27;", "'").replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    assert certificate.claim in plain
    assert all(one in plain for one in certificate.assumptions)
    assert f"Verdict, in exact arithmetic: certified: {verdict.why}" in plain
    assert f"{verdict.margins['radius']:.6g}" in text
    assert certificate.to_dict()["sha256"] in text


def test_without_charts_the_page_is_small_and_has_no_script():
    text = page("t", [("heading", ["words"], (["a", "b"], [["one", "1.5"], ["two", "-2"]]), [])])
    assert len(text) < 10_000
    assert "<script" not in text
    assert '<th class="words">a</th><th>b</th>' in text


def test_a_footer_says_what_wrote_the_page(written):
    import jaxobs

    assert f"Written by jaxobs {jaxobs.__version__} with Python" in written[1]


def test_other_kinds_are_refused_by_name_and_can_be_added():
    with pytest.raises(ValueError, match=r"^report.write.things: given complex; expected a run"):
        report.sections(3j)
    with pytest.raises(ValueError, match=r"^report.write.things: given none"):
        report.write("nowhere.html")

    class Own:
        pass

    report.sections.register(Own, lambda thing, heading="": [Section(heading or "Own", ["said"])])
    assert report.sections({"Mine": Own()}) == [Section("Mine", ["said"])]


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")
@pytest.mark.parametrize(("width", "first"), [(1280, "curves"), (500, "curves"), (1280, "heat map")])
def test_a_browser_draws_every_chart_without_a_complaint(written, tmp_path, width, first):
    text, path = written[1], tmp_path / "page.html"
    views = '["curves", "heat map"], 0'
    assert text.count(views) == 1
    path.write_text(text.replace(views, views[:-1] + ("1" if first == "heat map" else "0")), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync"]
    options += [
        "--disable-component-update",
        "--enable-logging=stderr",
        f"--user-data-dir={tmp_path / 'browser'}",
        "--dump-dom",
    ]
    options += [f"--window-size={width},2400", "--virtual-time-budget=8000", "--host-resolver-rules=MAP * ~NOTFOUND"]
    done = subprocess.run([CHROMIUM, *options, path.as_uri()], capture_output=True, text=True, timeout=180)
    complaints = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert not complaints
    drawn = re.findall(r'<div class="chart js-plotly-plot"', done.stdout)
    assert len(drawn) == len(charts(text)) > 4
    least = cases.study()["rmse"].median("seed").sel(state=1).min().item()
    assert (f">{least:.3g}</text>" in done.stdout) == (first == "heat map")
    assert done.stdout.count("<select") == 7  # metric, of, as, across, lines; q and gamma
    wide = [float(w) for w in re.findall(r'<svg class="main-svg"[^>]*? width="([\d.]+)"', done.stdout)]
    assert wide
    assert max(wide) <= width
