"""Studies against the slow loop of `jaxobs.score` over their lanes, and against themselves, cut in other ways."""

import itertools
import os
import signal as signals_of_the_system

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from cases import CASES, DT, build

import jaxobs
from jaxobs import Seeds, grid, integrators, metrics, noise, observers, plants, signals, study, variants
from jaxobs._module import float_leaves
from jaxobs.metrics import RMSE
from jaxobs.studies.family import leaf_names

TS = np.linspace(0, 1, 21)
GAMMAS, AS, SIGMAS = [2.0, 3.0], [0.5, 1.2], [0.05, 0.1]
X0, XHAT0 = [[0.5, 0.0], [-0.2, 0.3]], [0.1, 0.0]
KEY = jax.random.key(3)
PLANT = plants.Pendulum()
OBSERVER = observers.HighGain(PLANT, [1.5, 1.0], 3.0)
OTHER = observers.HighGain(PLANT, [2.0, 1.0], 3.0)
SOURCE = noise.Sum((noise.Gaussian(0.1), noise.Dropout(0.2)))


class Valid(metrics.AbstractMetric):
    """A metric of a user's own that says nothing of its axes: how often the output was there, and the last innovation."""

    def init(self, n, p, dtype):
        return jnp.zeros((), jnp.int32), jnp.zeros((p,), dtype)

    def update(self, state, moment):
        return state[0] + jnp.all(moment.valid).astype(jnp.int32), moment.innovation

    def result(self, state):
        return {"count": state[0], "last": state[1]}


METRICS = {"rmse": RMSE(0.3), "valid": Valid()}
RUN = {"ts": TS, "signal": signals.Sine(0.3, 2.0), "disturbance": noise.Bias(0.2), "hold_innovation": True}
RUN |= {"integrator": integrators.Euler()}  # half the time to compile


@pytest.fixture(scope="module")
def full():
    """Everything at once: labels, gains, the true plant's parameter, noise level, starts and seeds; trajectories kept."""
    families = {"one": grid(OBSERVER, gamma=GAMMAS), "two": grid(OTHER, gamma=GAMMAS)}
    return study(
        grid(PLANT, a=AS), families, noise=grid(SOURCE, **{"parts.0.sigma": SIGMAS}), x0=X0, xhat0=XHAT0, keys=Seeds(KEY, 2),
        metrics=METRICS, save=4, **RUN,
    )  # fmt: skip


def lanes():
    """(where a lane is in `full`, its plant, observer, noise, x0 and key)."""
    for name, gamma, a, sigma, i, s in itertools.product(("one", "two"), GAMMAS, AS, SIGMAS, range(2), range(2)):
        observer = eqx.tree_at(lambda o: o.gamma, {"one": OBSERVER, "two": OTHER}[name], jnp.asarray(gamma))
        plant = eqx.tree_at(lambda p: p.a, PLANT, jnp.asarray(a))
        source = eqx.tree_at(lambda n: n.parts[0].sigma, SOURCE, jnp.asarray(sigma))
        at = {"observer": name, "gamma": gamma, "a": a, "parts.0.sigma": sigma, "x0": i, "seed": s}
        yield at, plant, observer, {"noise": source, "x0": X0[i], "key": jax.random.fold_in(KEY, s)}


def close(actual, desired):
    np.testing.assert_allclose(actual, desired, rtol=1e-12, atol=1e-14)


def test_every_lane_is_that_of_simulate(full):
    np.testing.assert_allclose(full.time, TS[::4], rtol=1e-15)
    for at, plant, observer, rest in lanes():
        run, lane = jaxobs.simulate(plant, observer, xhat0=XHAT0, **RUN, **rest), full.sel(at)
        close(lane["rmse"], np.sqrt(np.mean((run.xhat - run.x)[TS >= 0.3] ** 2, axis=0)))
        close(lane["valid.last"], run.innovation[-1])
        assert 0 < int(lane["valid.count"]) == int(run.valid.sum()) < len(TS)
        assert float(lane["diverged_at"]) == np.inf
        close(lane["x"], run.x[::4])
        close(lane["xhat"], run.xhat[::4])


def test_the_data_set_names_everything(full):
    lead = ("observer", "gamma", "a", "parts.0.sigma", "x0", "seed")
    assert {name: full[name].dims for name in full.data_vars} == {
        "diverged_at": lead,
        "rmse": (*lead, "state"),
        "valid.count": lead,
        "valid.last": (*lead, "valid.last_0"),
        "x": (*lead, "time", "state"),
        "xhat": (*lead, "time", "state"),
    }
    assert list(full.observer.values) == ["one", "two"]
    np.testing.assert_array_equal(full.gamma, GAMMAS)
    np.testing.assert_array_equal(full.x0_value, X0)
    units = {"rmse": "x", "diverged_at": "s", "valid.count": "unknown", "x": "x", "time": "s"}
    assert {name: full[name].attrs["units"] for name in units} == units
    assert full.rmse.attrs["metric"] == "RMSE(after=0.3)"
    assert (full.attrs["precision"], full.attrs["backend"], full.attrs["complete"]) == ("float64", "cpu", True)
    assert {"jaxobs", "jax", "numpy", "format", "created", "config", "fingerprint", "devices"} <= set(full.attrs)


SMALL = {"ts": TS, "metrics": {"rmse": RMSE()}, "x0": [[0.5, 0.0], [1e308, 1e308]], "xhat0": [0, 0]}
SMALL |= {"noise": noise.Gaussian(0.1), "keys": Seeds(KEY, 4), "integrator": integrators.Euler()}
FAMILY = grid(OBSERVER, gamma=[2.0, 3.0, 5.0])


def small(**given):
    return study(PLANT, FAMILY, **(SMALL | given))


@pytest.fixture(scope="module")
def whole():
    return small()


def test_a_lane_that_diverges_is_data(whole):
    """x0 = 1e308 overflows at once; what stands beside it is what it is alone."""
    assert np.all(np.isfinite(whole.diverged_at.sel(x0=1)))
    assert not np.any(np.isfinite(whole.rmse.sel(x0=1)))
    assert np.all(whole.diverged_at.sel(x0=0) == np.inf)
    np.testing.assert_array_equal(small(x0=[[0.5, 0.0], [0.4, 0.0]]).rmse.sel(x0=0), whole.rmse.sel(x0=0))


@pytest.mark.parametrize("cut", [{"chunk": 5}, {"chunk": 1}, {"budget": 12_000}, {"chunk": 13, "tile": 16}], ids=str)
def test_no_cut_changes_a_bit(whole, cut):
    xr.testing.assert_identical(small(**cut).drop_attrs(), whole.drop_attrs())


def test_parts_make_the_whole(whole):
    parts = [small(part=(i, 3), chunk=2) for i in range(3)]
    done = [part.diverged_at.notnull() for part in parts]
    assert all(0 < one.sum() < one.size and not part.attrs["complete"] for one, part in zip(done, parts, strict=True))
    assert (sum(one.astype(int) for one in done) == 1).all()
    for name in ("rmse", "diverged_at"):
        taken = [np.where(part.diverged_at.notnull().values.T, part[name].values.T, 0) for part in parts]
        np.testing.assert_array_equal(sum(taken).T, whole[name])


def test_a_seed_is_the_same_noise_for_every_gain_and_number_of_seeds(whole):
    """Also with keys that are stored, typed or of the old style."""
    typed = jax.vmap(jax.random.fold_in, in_axes=(None, 0))(KEY, jnp.arange(1))
    for keys in (typed, jax.random.key_data(typed)):
        alone = study(PLANT, grid(OBSERVER, gamma=[5.0]), **(SMALL | {"keys": keys}))
        xr.testing.assert_equal(alone, whole.isel(gamma=[2], seed=[0]))


def test_an_observer_alone_without_keys_is_one_lane():
    ds = study(PLANT, OBSERVER, ts=TS, metrics={"rmse": RMSE()}, x0=[0.5, 0.0], xhat0=[0, 0], integrator=integrators.Euler())
    assert (ds.rmse.dims, ds.diverged_at.dims) == (("state",), ())
    run = {"x0": [0.5, 0.0], "xhat0": [0, 0], "integrator": integrators.Euler()}
    close(ds.rmse, jaxobs.score(PLANT, OBSERVER, metrics={"rmse": RMSE()}, ts=TS, **run)["rmse"])


def chain(n):
    plant = plants.SineChain(0.9, n)
    return plant, grid(observers.HighGain(plant, [*[2.0, 1.5, 1.0][: n - 1], 0.3], 2.0), gamma=[1.5, 2.0])


def test_variants_of_different_order_are_filled_up():
    run = {"ts": TS, "metrics": {"rmse": RMSE()}, "integrator": integrators.Euler(), "xhat0": np.zeros}
    ds = study(None, variants(chain, n=[2, 3]), x0=lambda n: [[0.1] * n, [0.2] * n], **run)
    assert ds.rmse.dims == ("n", "gamma", "x0", "state")
    assert ds.rmse.shape == (2, 2, 2, 3)
    assert ds.x0_value.dims == ("n", "x0", "state")
    assert np.isnan(ds.rmse.sel(n=2, state=2)).all()
    assert np.isfinite(ds.rmse.sel(n=3)).all()
    plant, family = chain(2)
    expected = jaxobs.score(plant, family.member(jnp.asarray(2.0)), x0=[0.2, 0.2], **(run | {"xhat0": np.zeros(2)}))["rmse"]
    close(ds.rmse.sel(n=2, gamma=2.0, x0=1, state=[0, 1]), expected)


def test_progress_counts_lanes():
    seen = []
    small(chunk=8, progress=seen.append)
    assert [one.done for one in seen] == [8, 16, 24]
    assert all(one.total == 24 and one.rate > 0 and one.left >= 0 for one in seen)
    assert seen[-1].left == 0


def test_a_bar_when_asked_and_silence_otherwise(capfd):
    small()
    assert capfd.readouterr() == ("", "")
    small(progress=True)
    out, err = capfd.readouterr()
    assert out == ""
    assert "24/24 lanes" in err
    assert "lane-steps/s" in err


class Interrupter:
    """Presses Ctrl-C so often when so many lanes are done."""

    def __init__(self, done, times):
        self.done, self.times, self.last = done, times, None

    def __call__(self, now):
        self.last = now
        if now.done == self.done:
            for _ in range(self.times):
                os.kill(os.getpid(), signals_of_the_system.SIGINT)


@pytest.mark.parametrize(("times", "finished"), [(1, 16), (2, 8)])
def test_ctrl_c_stops_after_the_chunk_and_twice_at_once(whole, times, finished, capsys):
    before = signals_of_the_system.getsignal(signals_of_the_system.SIGINT)
    with pytest.raises(KeyboardInterrupt) as caught:
        small(chunk=8, progress=Interrupter(16, times))
    assert signals_of_the_system.getsignal(signals_of_the_system.SIGINT) is before
    assert "Ctrl-C again stops at once" in capsys.readouterr().err
    partial = caught.value.dataset
    assert int(partial.diverged_at.notnull().sum()) == finished
    assert not partial.attrs["complete"]
    np.testing.assert_array_equal(partial.rmse.isel(gamma=0), whole.rmse.isel(gamma=0))
    assert any(f"{finished} of 24 lanes" in note and "`dataset`" in note for note in caught.value.__notes__)


def test_ctrl_c_with_a_store_goes_on_where_it_stopped(whole, tmp_path):
    with pytest.raises(KeyboardInterrupt) as caught:
        small(chunk=8, progress=Interrupter(8, 1), store=tmp_path / "study")
    assert any("8 of 24 lanes" in note and "the same call goes on" in note for note in caught.value.__notes__)
    seen = []
    again = small(store=tmp_path / "study", progress=seen.append)
    assert [one.done for one in seen] == [16, 24]
    xr.testing.assert_identical(again.load().drop_attrs(), whole.drop_attrs())
    assert again.attrs.keys() == whole.attrs.keys()
    np.testing.assert_array_equal(small(store=tmp_path / "study", progress=pytest.fail).rmse, whole.rmse)


OBSERVERS = [
    label for label in CASES if isinstance(build(label), observers.AbstractFlowObserver | observers.AbstractStepObserver)
]
NOISES = [label for label in CASES if isinstance(build(label), noise.AbstractNoise)]


def plant_for(observer):
    """The observer's own model, or any plant of its sizes."""
    own = getattr(observer, "model", None) or getattr(getattr(observer, "observer", None), "model", None)
    if isinstance(own, plants.AbstractPlant):
        return own
    every = [plants.IntegratorChain(1), *(build(label) for label in CASES)]
    fits = [one for one in every if isinstance(one, plants.AbstractFlowPlant) and (one.n, one.m, one.p) == sizes(observer)]
    return fits[0]


def sizes(observer):
    return observer.n, observer.m, observer.p


@pytest.mark.slow
@pytest.mark.parametrize("label", OBSERVERS)
def test_every_observer_under_every_noise_and_integrator(label):
    """Observers in turn meet all kinds of noise, disturbance, integrators, and both rules for lost samples."""
    i, observer = OBSERVERS.index(label), build(label)
    plant = plant_for(observer)
    flows = isinstance(plant, plants.AbstractFlowPlant) or isinstance(observer, observers.AbstractFlowObserver)
    ways = ["RK4", "Euler", "Adaptive", *(["Exponential"] if hasattr(observer, "split") else [])]
    run = {
        "metrics": {"rmse": RMSE(0.2), "ratio": metrics.Consistency(0.5)},
        "ts": np.arange(11) * DT,
        "x0": 0.1 * np.arange(1, observer.n + 1),
        "xhat0": np.full(observer.n, 0.05),
        "signal": [None, signals.Sine(0.3, 2.0), build("Held")][observer.m],
        "noise": build(NOISES[i % len(NOISES)]),
        "disturbance": noise.Gaussian(0.1) if i % 2 else None,
        "integrator": build(ways[i // 2 % len(ways)]) if flows else None,
        "hold_innovation": i % 3 == 0,
    }
    name = next(name for name in leaf_names(observer) if not name.endswith("dt"))
    leaf = next(leaf for one, leaf in zip(leaf_names(observer), float_leaves(observer), strict=True) if one == name)
    family = grid(observer, **{name: np.stack([leaf, 1.01 * leaf])})
    keys = jax.random.split(KEY, 3)
    ds = study(plant, family, keys=keys, **run)
    # Adaptive steps at a tolerance of 1e-10 follow the rounding of their error estimate.
    rounding = 1e-8 if isinstance(run["integrator"], integrators.Adaptive) else 1e-11
    for i, s in itertools.product(range(2), range(3)):
        expected = jaxobs.score(plant, family.member(family.values[0][i]), key=keys[s], **run)
        lane = ds.isel({name: i, "seed": s})
        for metric in run["metrics"]:
            np.testing.assert_allclose(lane[metric], expected[metric], rtol=rounding, atol=1e-13)
        assert float(lane["diverged_at"]) == float(expected["diverged_at"])


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_any_cut_in_both_precisions(dtype):
    """Every lane of a study with several leaves, by itself and in other company."""
    plant, observer = jaxobs.astype((PLANT, OBSERVER), dtype)
    family = grid(observer, gamma=np.linspace(2, 5, 7), **{"model.a": np.asarray(AS)})
    given = {"ts": np.linspace(0, 2, 101), "metrics": {"rmse": RMSE(1.0), "white": metrics.Whiteness(3)}, "x0": X0}
    given |= {"xhat0": [0.0, 0.0], "keys": Seeds(KEY, 9), "noise": jaxobs.astype(SOURCE, dtype), "save": 7}
    given["metrics"] = jaxobs.astype(given["metrics"], dtype)
    whole = study(plant, family, **given)
    assert whole.rmse.dtype == dtype
    for cut in ({"tile": 1, "chunk": 13}, {"tile": 33, "chunk": 100}, {"budget": 200_000}, {"tile": 16, "part": (0, 1)}):
        xr.testing.assert_identical(study(plant, family, **given, **cut).drop_attrs(), whole.drop_attrs())
