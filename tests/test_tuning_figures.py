"""The pictures of a search: what stands on the axes is what the history holds."""

import dataclasses

import matplotlib.image
import numpy as np
import pytest

from jaxobs import observers, plants
from jaxobs.certificates import Corners
from jaxobs.cli.tune_record import RecordRow
from jaxobs.plotting import comparison, history
from jaxobs.tuning import History, Tuned

CERTIFIED = object.__new__(Corners)  # empty: the picture asks only whether there is one


def tuned(starts=2, stages=3, each=4, certified=True):
    rng, steps = np.random.default_rng(0), stages * each
    loss = np.exp(-0.1 * np.arange(steps)) + 0.05 * rng.random((starts, steps))
    good = np.ones((starts, steps), bool)
    good[0, 5] = False
    loss[0, 5] = np.nan
    depth = np.where(certified, loss, np.nan)
    theta = {"['alphas']": np.cumsum(rng.normal(size=(starts, steps, 2)), axis=1), "['gamma']": rng.random((starts, steps))}
    weight = np.repeat(0.1 ** np.arange(stages), each)
    lane = np.full((starts, steps), -1)
    path = History(loss, depth, weight, loss, good, lane, theta, 24, 1.0, 0.5)
    observer = observers.HighGain(plants.Pendulum(), [3.0, 2.0], 6.0)
    more = {"loss": 0.4, "first_loss": 1.0, "free_loss": 0.35, "rate": 2.0, "unit": "1/s", "start": 1}
    return Tuned(observer, CERTIFIED if certified else None, path, theta={}, **more)


def lines(ax):
    return {line.get_label(): np.asarray(line.get_ydata(), float) for line in ax.lines}


def test_a_history_shows_every_step(tmp_path):
    found = tuned()
    figure = history(found, title="case")
    loss, barrier, slope, theta = figure.axes
    drawn = lines(loss)
    np.testing.assert_array_equal(drawn["least so far"], np.min(found.history.best, axis=0))
    np.testing.assert_array_equal(drawn["start 1"], found.history.loss[1])
    assert np.isnan(drawn["from the gain before"][5])
    assert drawn["proved: 0.4"][0] == 0.4
    assert drawn["without the proof: 0.35"][0] == 0.35
    assert np.isfinite(drawn["from the gain before"]).sum() == 11
    assert len(barrier.lines) == len(slope.lines) == 2
    path = found.history.theta["['alphas']"][1, :, 1]
    np.testing.assert_allclose(lines(theta)["alphas[1]"], path - path[0])
    assert {label for label in lines(theta) if not label.startswith("_")} == {"alphas[0]", "alphas[1]", "gamma"}
    assert [text.get_text() for text in loss.texts] == ["weight 1", "weight 0.1", "weight 0.01"]
    assert len(slope.patches) == 1  # the middle one of three stages
    figure.savefig(tmp_path / "history.png")
    picture = matplotlib.image.imread(tmp_path / "history.png")
    assert picture.shape[0] > 800
    assert np.std(picture[..., :3]) > 0.05


def test_a_search_without_a_proof_says_so():
    found = dataclasses.replace(tuned(starts=1, certified=False), free_loss=None)
    loss, barrier, *_ = history(found).axes
    assert not [label for label in lines(loss) if label.startswith(("proved", "without", "start"))]
    assert [text.get_text() for text in barrier.texts] == ["none: nothing is proved"]


def row(rmse, change=0.0, floor=None):
    return RecordRow("x", 2, rmse, 0.95 * rmse, 1.05 * rmse, change, change - 0.02, change + 0.03, floor)


def test_a_comparison_is_relative_to_the_gain_before(tmp_path):
    cases = [("a", row(2.0), row(1.5, -0.25, 0.5)), ("b", row(1.0), row(1.1, 0.1))]
    figure = comparison(cases)
    (ax,) = figure.axes
    points = sorted(tuple(line.get_xydata()[0]) for line in ax.lines if line.get_marker() == "o" and len(line.get_xdata()))
    assert points == [(pytest.approx(0.75), 1.0), (pytest.approx(1.1), 0.0)]
    floors = [tuple(line.get_xydata()[0]) for line in ax.lines if line.get_marker() == "|" and len(line.get_xdata())]
    assert (0.25, 1.0) in [(round(x, 12), y) for x, y in floors]
    bars = [segment for bar in ax.collections for segment in bar.get_segments()]
    np.testing.assert_allclose(sorted(bar[:, 0].tolist() for bar in bars), [[0.73, 0.78], [1.08, 1.13]])
    assert [label.get_text() for label in ax.get_yticklabels()] == ["a", "b"]
    assert "x2: 2 to 1.5" in [text.get_text() for text in ax.texts]
    figure.savefig(tmp_path / "comparison.png")
    assert (tmp_path / "comparison.png").stat().st_size > 5000
