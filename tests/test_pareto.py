"""Fronts: every point proved at its own rate, the same optimum as one search, dominated points told apart."""

import functools

import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import linalg
from jaxobs.designs import Infeasible, corner_lmi, lpv_model, slope_entries
from jaxobs.observers import HighGain
from jaxobs.plants import Pendulum
from jaxobs.tuning import LogQ, Quadratic, pareto, tune

pytestmark = pytest.mark.usefixtures("hardly_optimised")

PLANT, CHART = Pendulum(), LogQ()
MODEL = lpv_model(PLANT, slope_entries([[-1.0, 0.0]], [[1.0, 0.0]]))
START = CHART.encode([3.0, 2.0])
RATES = (0.5, 1.0, 3.0)


def make(theta):
    return HighGain(PLANT, CHART.decode(theta), 1.0)


def noise(observer, key):
    f = jnp.eye(2, k=1).at[:, 0].add(-observer.alphas)
    return jnp.sqrt(linalg.lyapunov(f, jnp.outer(observer.alphas, observer.alphas) + jnp.diag(jnp.asarray([0.0, 0.5])))[1, 1])


def size(observer, key):
    return jnp.sum(observer.alphas**2)


@functools.cache
def front():
    return pareto(
        make, {"noise": noise, "size": size}, START, certify=Quadratic(MODEL), rates=RATES, weights=(0.0, 0.5), steps=60
    )


def chosen(rate, weight):
    (point,) = (one for one in front().points if (one.rate, one.weight) == (rate, weight))
    return point


def test_every_point_is_proved_at_its_own_rate():
    assert not front().missing
    assert [one.rate for one in front().points] == sorted(RATES * 2)
    for one in front().points:
        assert one.certificate.verify()
        assert one.certificate.rate == one.rate
        assert np.array_equal(np.asarray(one.certificate.gain)[:, 0], np.asarray(one.observer.gain()))
        largest = corner_lmi.largest_rate(MODEL, np.asarray(one.observer.gain())[:, None], rtol=1e-7)
        assert largest >= one.rate * (1 - 1e-6)


def test_a_faster_rate_costs_noise_and_a_weight_moves_the_other_loss():
    lone = [one.values["noise"] for one in front().points if one.weight == 0.0]
    assert np.all(np.diff(lone) > 0)
    for rate in RATES:
        plain, weighted = (chosen(rate, w) for w in (0.0, 0.5))
        assert plain.values["noise"] <= weighted.values["noise"] * (1 + 1e-3)
        assert weighted.values["size"] <= plain.values["size"] * (1 + 1e-3)


@pytest.mark.slow
def test_one_point_is_what_tune_finds():
    found = tune(make, noise, START, certify=Quadratic(MODEL), rate=RATES[1], price=False)
    assert chosen(RATES[1], 0.0).values["noise"] == pytest.approx(found.loss, rel=1e-3)


def test_dominated_points_and_text():
    rows = [(-one.rate, one.values["noise"], one.values["size"]) for one in front().points]
    for one, row in zip(front().points, rows, strict=True):
        better = [other for other in rows if np.all(np.array(other) <= row) and other != row]
        assert one.is_dominated == bool(better)
    assert str(front()).splitlines()[0].split() == ["rate", "1/s", "noise", "size"]


@pytest.mark.slow
def test_a_rate_that_cannot_be_proved_is_listed():
    def fixed(theta):
        return HighGain(PLANT, jnp.stack([jnp.ones(()), jnp.exp(theta)]), 1.0)

    def loss(observer, key):
        return jnp.sum(observer.alphas**2)

    found = pareto(fixed, {"size": loss}, jnp.asarray(0.5), certify=Quadratic(MODEL), rates=[0.1, 2.0], steps=20)
    ((rate, reached),) = found.missing
    assert rate == 2.0
    assert 0.1 < reached < 0.5
    assert len(found.points) == 1
    with pytest.raises(Infeasible, match="The nearest that was reached"):
        pareto(fixed, {"size": loss}, jnp.asarray(0.5), certify=Quadratic(MODEL), rates=[2.0], steps=20)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"losses": {}}, r"pareto.losses: given nothing"),
        ({"rates": []}, r"pareto.rates: given \[\]"),
        ({"rates": [0.1, -1.0]}, r"tune.rate: given -1.0"),
        ({"weights": [-1.0]}, r"pareto.weights: given \[-1.0\]"),
        ({"steps": 0}, r"pareto.steps: given 0"),
    ],
)
def test_bad_input_is_named(change, match):
    asked = {"losses": {"noise": noise}, "theta0": START, "certify": Quadratic(MODEL), "rates": [0.1]} | change
    with pytest.raises(ValueError, match=match):
        pareto(make, asked.pop("losses"), asked.pop("theta0"), **asked)
