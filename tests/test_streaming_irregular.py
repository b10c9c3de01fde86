"""IrregularRunner: the observer's flow over the times as they are."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from test_streaming import US, YS, high_gain, tracker

from jaxobs import hurwitz, observers, plants
from jaxobs.integrators import Exponential
from jaxobs.streaming import IrregularRunner


def test_irregular_samples_are_the_flow_between_them():
    """An oracle: scipy's integration of the observer's equations with the innovation held, over the times as they are."""
    plant, gain = plants.Pendulum(a=0.9, b=0.4), np.array([12.0, 36.0])
    observer = observers.Luenberger(plant, gain[:, None])
    ts = np.cumsum(np.random.default_rng(2).uniform(0.002, 0.05, 40)) + 1e6
    runner = IrregularRunner(observer, xhat0=[0.2, -0.1], longest_step=0.005)
    z, t, innovation, u = np.array([0.2, -0.1]), ts[0], np.zeros(1), np.zeros(1)
    for k in range(40):
        found = runner.update(ts[k], None if k == 11 else YS[k], US[k])
        if k:

            def flow(_, x, u=u, innovation=innovation):
                return np.asarray(plant.flow(0.0, jnp.asarray(x), jnp.asarray(u))) + gain * innovation

            z = scipy.integrate.solve_ivp(flow, (0, ts[k] - t), z, rtol=1e-10, atol=1e-12).y[:, -1]
        innovation = np.zeros(1) if k == 11 else YS[k] - z[:1]
        t, u = ts[k], US[k]
        np.testing.assert_allclose(found, z, rtol=1e-7, atol=1e-8)
    assert runner.counts == {"taken": 39, "lost": 1, "rejected": 0}
    assert runner._step._cache_size() == 1


def test_an_irregular_runner_ignores_what_is_not_later_and_goes_on_from_a_file(tmp_path):
    observer = observers.IntegralHighGain(plants.Pendulum(), hurwitz.binomial(3), 5.0, 1)
    ts = np.cumsum(np.random.default_rng(3).uniform(0.002, 0.05, 30))
    whole, first = (IrregularRunner(observer, xhat0=[0.0, 0.0], longest_step=0.01) for _ in range(2))
    for k in range(30):
        whole.update(ts[k], YS[k], US[k])
        if k < 15:
            first.update(ts[k], YS[k], US[k])
            first.update(ts[max(k - 1, 0)], 9.0, US[k])
    first.save(tmp_path / "state.json")
    second = IrregularRunner.restore(observer, tmp_path / "state.json")
    for k in range(15, 30):
        second.update(ts[k], YS[k], US[k])
    np.testing.assert_array_equal(second.xhat, whole.xhat)
    assert second.counts["rejected"] == 15


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"observer": tracker()}, r"IrregularRunner\.observer: given DiscreteTracker .*take Runner"),
        ({"integrator": Exponential()}, r"IrregularRunner\.integrator: given Exponential; expected one that takes steps"),
        ({"longest_step": 0.0}, r"IrregularRunner\.longest_step: given 0\.0"),
    ],
)
def test_bad_arguments_of_an_irregular_runner_are_named(change, message):
    given = {"observer": high_gain(), "xhat0": [0.0, 0.0], "longest_step": 0.01} | change
    with pytest.raises(ValueError, match=message):
        IrregularRunner(given.pop("observer"), **given)


def test_a_long_silence_is_refused():
    runner = IrregularRunner(high_gain(), xhat0=[0.0, 0.0], longest_step=0.01)
    runner.update(0.0, 0.1, 0.0)
    with pytest.raises(ValueError, match=r"IrregularRunner\.t: given 11\.0, 11 s after the last; expected at most 10\.0 s"):
        runner.update(11.0, 0.1, 0.0)
