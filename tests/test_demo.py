"""The demo: a small fraction of it here, the whole of it in the slow run."""

import json
import re
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.signal

from jaxobs.demo import pendulum, walk, walk_candidates, walk_references
from jaxobs.report import demo_figures, demo_text
from jaxobs.report.page import page

TONES = (50.0, 30.0, 22.0)
FEW = ("fading memory n = 2 (tracker q = 0)", "Luenberger, chain n = 2, free gains")


@pytest.fixture(scope="module")
def studies():
    with pytest.MonkeyPatch.context() as patch:
        few = [c for c in walk_candidates.candidates(TONES) if c.name in FEW]
        print(
            f"{len(few)} of {len(walk_candidates.candidates(TONES))} candidates, a tenth of the steps; 8 x 16 of 64 x 256 lanes"
        )
        patch.setattr(walk, "candidates", lambda tones: few)
        return walk.study_walk(quick=True), pendulum.study_pendulum(quick=True)


def test_rows_are_measured_on_their_blocks(studies):
    study, _ = studies
    for row, rate in zip(study.rows, study.rates, strict=True):
        error = rate - study.walk.rate
        assert row.rmse == pytest.approx(np.sqrt(np.mean(error[2634:] ** 2)))
        assert row.rmse_choose == pytest.approx(np.sqrt(np.mean(error[1756:2634] ** 2)))
        assert row.rmse_second_half == pytest.approx(np.sqrt(np.mean(error[1756:] ** 2)))
        assert row.rmse_low < row.rmse < row.rmse_high
    assert study.chosen.rmse_choose == min(row.rmse_choose for row in study.rows if row.kind == "observer")


def test_known_figures(studies):
    rows = {(row.name, row.tuned): row for row in studies[0].rows}
    assert rows["Savitzky–Golay (off-line)", "gyroscope"].rmse_second_half < 0.2  # 0.185 was known
    difference = rows["backward difference", "none"]
    y = studies[0].walk.angle
    assert difference.noise_gain == pytest.approx(120 * np.sqrt(2), rel=0.1)
    assert np.allclose(studies[0].rates[0][1:], np.diff(y) * 120, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("make", [lambda y, r: walk_references.butterworth(2, 10.0, 1 / 120), None])
def test_references_are_causal(make):
    """All but the off-line row: a later sample never changes an earlier estimate."""
    data = walk.shank_walk()
    if make is None:
        filters = [
            f for f in walk_references.references(data.angle, data.rate, 1 / 120, walk.TRAIN) if "off-line" not in f.name
        ]
    else:
        filters = [make(data.angle, data.rate)]
    changed = data.angle.copy()
    changed[2000:] += 1.0
    for reference in filters:
        assert np.array_equal(reference.filter(changed)[:2000], reference.filter(data.angle)[:2000])
        assert not np.allclose(reference.filter(changed)[2000:2010], reference.filter(data.angle)[2000:2010])


@pytest.mark.parametrize("candidate", walk_candidates.candidates(TONES), ids=lambda c: c.name)
def test_candidates_start_as_working_observers(candidate):
    """Every start is a valid observer of the angle, and the free numbers are counted right."""
    start = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), candidate.starts)
    assert candidate.make(start).p == 1
    assert candidate.free == sum(np.size(leaf) for leaf in jax.tree.leaves(start))


def test_delay_and_bootstrap():
    t = np.arange(2000) / 120
    truth = np.sin(5 * t)
    assert walk.delay(np.sin(5 * (t - 0.02)), truth) == pytest.approx(0.02, abs=1 / 120 / 20)
    assert np.isnan(walk.delay(np.sin(5 * (t - 0.2)), truth))  # beyond its range
    low, high = walk.block_bootstrap(np.random.default_rng(1).normal(size=4000), 1)
    assert low < 1 < high  # the error of white noise: 1 +- 2/sqrt(8000)
    assert high - low == pytest.approx(4 / np.sqrt(8000), rel=0.2)


def test_what_the_demo_takes_from_the_training_block():
    """The stride by the oracle of peaks, and the lines of the magnetometer's spectrum that stand out."""
    data = walk.shank_walk()
    troughs = scipy.signal.find_peaks(-data.rate[walk.TRAIN], height=3, distance=100)[0]
    assert walk.stride(data.rate[walk.TRAIN]) == pytest.approx(np.median(np.diff(troughs)), abs=2)
    assert walk.tones(data.angle[walk.TRAIN]) == pytest.approx(TONES)


def test_paired_change(studies):
    """Against itself a row changes by nothing, exactly; intervals hold the middle."""
    study = studies[0]
    assert walk.paired_change(study, study.rows[0], study.rows[0]) == (0, 0, 0)
    middle, low, high = walk.paired_change(study, study.rows[-1], study.rows[0])
    assert low < middle < high < 0


def test_pendulum(studies):
    study = studies[1]
    assert study.verdict.holds
    printed = {"lambda_min(P^-1/2 Q P^-1/2)": 3.5620, "2 sqrt((P^-1)_nn lambda_max(P))": 2.2713}
    for name, value in printed.items():
        assert study.numbers[name] == pytest.approx(value, abs=5e-5)
    for sweep, c in zip(study.sweeps, (2 / 3, 1 / 4, 1 / 16, 1 / 32), strict=True):
        assert sweep.c == pytest.approx(c)
        middle = np.abs(sweep.gammas - 11).argmin()  # 1 << gamma << 1 / T_s
        assert np.median(sweep.rmse[middle]) == pytest.approx(sweep.law()[middle], rel=0.1)


def test_report_is_one_page_without_a_network(studies, tmp_path):
    pictures = demo_figures.draw(*studies, tmp_path)
    sections = [
        (
            "walk",
            demo_text.walk_findings(studies[0]) if len(studies[0].rows) > 20 else ["few"],
            demo_text.walk_table(studies[0]),
            pictures,
        ),
        ("pendulum", demo_text.pendulum_findings(studies[1]), demo_text.pendulum_table(studies[1]), []),
    ]
    text = page("title <&>", sections)
    assert "title &lt;&amp;&gt;" in text
    assert text.count("data:image/png;base64,") == len(pictures) == 4
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    assert all(path.stat().st_size > 10_000 for path, _ in pictures)


def test_json_rows_have_name_parameters_and_rmse(studies):
    data = json.loads(json.dumps(demo_text.as_json(*studies, {})))
    for row in data["walk"] + data["pendulum"]["sweeps"]:
        assert {"name", "parameters", "rmse"} <= set(row)


@pytest.mark.slow
def test_the_whole_demo(tmp_path):
    """The figures known before, and the bar to clear: an observer below 0.344 rad/s on the whole second half."""
    command = [sys.executable, "-m", "jaxobs", "demo", "--json", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    data = json.loads(done.stdout)
    half = {(row["name"], row["tuned"]): row["rmse_second_half"] for row in data["walk"]}
    assert half["fading memory n = 2 (tracker q = 0)", "gyroscope"] == pytest.approx(0.405, abs=2e-3)
    assert half["fading memory n = 3 (tracker q = 0)", "gyroscope"] == pytest.approx(0.385, abs=2e-3)
    assert half["Luenberger, chain n = 2, free gains", "gyroscope"] == pytest.approx(0.344, abs=2e-3)
    chosen = [row for row in data["walk"] if row["name"] == data["chosen"]]
    assert min(row["rmse_second_half"] for row in chosen) < 0.26
    assert len(data["pendulum"]["sweeps"]) == 4 * 64
    page_text = (tmp_path / "demo.html").read_text()
    assert "What did it" in page_text
    print({"seconds": data["seconds"], "chosen": data["chosen"]})
