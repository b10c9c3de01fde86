"""What the tables of `jaxobs study` come to: axes, parts, defaults; and the table that it prints."""

import copy
import tomllib

import numpy as np
import pytest
import xarray as xr
from study_tables import TINY

from jaxobs import observers, plants
from jaxobs.cli.override import override
from jaxobs.cli.study_config import study_config
from jaxobs.cli.study_table import summary


def built(*changes: str):
    return study_config(override(copy.deepcopy(tomllib.loads(TINY)), changes)).study()


def test_lists_of_one_name_in_plant_and_observer_are_one_axis():
    changes = ('plant={name="IntegratorChain", n=[2, 3]}', 'observer={name="Tracker", n=[2, 3], q=[0, 1], mu=[3.0, 4.0]}')
    plant, families, more = built(*changes, "start.x0=0.1")
    assert plant is None
    assert dict(families.axes) == {"n": [2, 3], "q": [0, 1]}
    made = {(point["n"], point["q"]): pair for point, pair in families}
    assert all((pair[0].n, pair[1].observer.n, pair[1].observer.q) == (n, n, q) for (n, q), pair in made.items())
    np.testing.assert_array_equal(more["x0"](3), [0.1, 0.1, 0.1])
    with pytest.raises(ValueError, match=r"config.observer.n: given \[2, 4\]; expected \[2, 3\], as plant.n has"):
        built(changes[0], changes[1].replace("n=[2, 3]", "n=[2, 4]"))


def test_an_observer_may_leave_out_what_plant_and_time_say():
    plant, family, _ = built('plant={name="SineChain", n=3, k_f=0.5}', 'observer={name="DiscreteTracker", q=1, mu=[3.0, 4.0]}')
    assert (plant.n, family.observer.n, float(family.observer.dt)) == (3, 3, 0.02)
    _, family, _ = built("observer.model.a={values=[0.9, 1.1]}", "plant.b=0.25", "observer.alphas=binomial")
    assert family.names == ("gamma", "model.a")
    assert float(family.observer.model.b) == 0.25
    np.testing.assert_array_equal(family.observer.alphas, [2.0, 1.0])
    _, family, _ = built("plant.a={values=[0.8, 1.2], nominal=1.1}")
    assert float(family.observer.model.a) == 1.1
    _, family, _ = built('observer={name="StepLuenberger", gain=[[0.1], [0.1]], model={period=0.02}}')
    assert type(family.model) is plants.Discretised
    assert float(family.model.dt) == 0.02


def test_vectors_parts_and_ranges_vary_too():
    gaussian = '{name="Gaussian", sigma={first=0.01, last=1.0, count=3, spacing="log"}}'
    *_, more = built(f'noise=[{gaussian}, {{name="Dropout", probability=0.1}}]')
    assert more["noise"].names == ("parts.0.sigma",)
    np.testing.assert_allclose(more["noise"].values[0], [0.01, 0.1, 1.0], rtol=1e-15)
    _, family, more = built("observer.alphas=[[2.0, 1.0], [1.5, 1.0]]", "run.precision=float32")
    assert family.names == ("alphas", "gamma")
    assert {one.dtype for one in family.values} | {more["metrics"]["rmse"].after.dtype} == {np.dtype(np.float32)}


def several(second: str):
    tables = tomllib.loads(TINY)
    del tables["observer"]
    first = 'name="HighGain", alphas="binomial", gamma=[2.0]'
    second = f'name="IntegralHighGain", alphas="binomial", {second}'
    return study_config(override(tables, (f"observers={{a={{{first}}}, b={{{second}}}}}",))).study()[1]


def test_observers_of_one_study_have_the_same_axes():
    kinds = {label: type(family.observer) for label, family in several("gamma=[2.0]").items()}
    assert kinds == {"a": observers.HighGain, "b": observers.IntegralHighGain}
    with pytest.raises(ValueError, match=r"config.observers.b.gamma: given one value; expected \[2.0\], as 'a'"):
        several("gamma=2.0")
    with pytest.raises(ValueError, match=r"config.observers.b.q: given \[0, 1\]; expected no list"):
        several("gamma=[2.0], q=[0, 1]")


def test_the_table_thins_out_and_says_so():
    shape = (7, 30, 4)
    rng = np.random.default_rng(0)
    runs, when = rng.normal(size=shape), np.full(shape, np.inf)
    runs[0, 0, 0], runs[-1, -1, -1], when[-1, -1, 0] = np.nan, np.inf, 0.5
    dims = ("gamma", "sigma", "seed")
    ds = xr.Dataset(
        {"time": (dims, runs), "diverged_at": (dims, when), "many": ((*dims, "lag"), np.zeros((*shape, 20)))},
        {"gamma": np.arange(7.0), "sigma": np.arange(30.0)},
    )
    found = summary(ds, 40)
    assert found["shown"] == {"gamma": [6, 7], "sigma": [6, 30]}
    assert len(found["rows"]) == 36
    assert found["left_out"] == {"many": 20}
    assert (found["diverged"], found["computed"], found["lanes"]) == (1, 840, 840)
    first, last = found["rows"][0], found["rows"][-1]
    assert (first["at"], last["at"]) == ({"gamma": 0.0, "sigma": 0.0}, {"gamma": 6.0, "sigma": 29.0})
    np.testing.assert_array_equal(first["values"]["time"], np.quantile(runs[0, 0, 1:], (0.1, 0.5, 0.9)))
    assert (last["diverged"], last["values"]["time"][2]) == (1, np.inf)
    assert len(summary(ds, 1000)["rows"]) == 210
