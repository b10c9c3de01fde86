"""Records in and runs out: pandas, xarray, python-control, diffrax's meters; each against the package's own numbers."""

import math

import control
import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import jaxobs
from jaxobs import interop
from jaxobs.observers import HighGain, IntegralHighGain, Luenberger, Sampled, StepLuenberger
from jaxobs.plants import Linear, LinearStep, Pendulum

TS = np.arange(0.0, 2.0, 0.01)
SIGNAL = np.sin(3 * TS) + 0.01 * np.cos(50 * TS)
A, B, C = [[0.0, 1.0], [-2.0, -0.3]], [[0.0], [1.0]], [[1.0, 0.0]]


@pytest.fixture(scope="module")
def derivatives():
    return jaxobs.differentiate(TS, SIGNAL, mu=20.0)


def days(ts):
    return pd.Timestamp("2026-11-22", tz="Europe/Berlin") + pd.to_timedelta(ts, unit="s")


@pytest.mark.parametrize(
    "record",
    [
        pd.Series(SIGNAL, index=TS),
        pd.Series(SIGNAL, index=pd.DatetimeIndex(days(TS))),
        pd.Series(SIGNAL, index=pd.to_timedelta(TS, unit="s")),
        xr.DataArray(SIGNAL, dims="t", coords={"t": TS}),
    ],
    ids=["seconds", "dates", "durations", "xarray"],
)
def test_a_record_that_carries_its_times(record, derivatives):
    found = jaxobs.differentiate(record, mu=20.0)
    np.testing.assert_allclose(found.xhat, derivatives.xhat, atol=1e-9)
    np.testing.assert_allclose(found.ts, TS, atol=1e-12)


def test_observe_takes_frames_and_lost_samples():
    observer = HighGain(Pendulum(), [3.0, 2.0], 4.0)
    y = np.where(np.arange(len(TS)) % 7 == 3, np.nan, np.sin(TS))
    plain = jaxobs.observe(observer, TS, y, 0.1 * np.cos(TS)[:, None], xhat0=[0.0, 0.0])
    frame = pd.DataFrame({"angle": y, "torque": 0.1 * np.cos(TS)}, index=TS)
    given = jaxobs.observe(observer, frame[["angle"]], us=frame["torque"], xhat0=[0.0, 0.0])
    assert np.array_equal(given.xhat, plain.xhat)
    assert not given.valid[3, 0]


def test_columns_of_one_table_are_times_and_samples(derivatives):
    """df["time"] beside df["y"] are the times themselves, whatever counts the rows."""
    table = pd.DataFrame({"time": TS, "y": SIGNAL})
    found = jaxobs.differentiate(table["time"], table["y"], mu=20.0)
    np.testing.assert_array_equal(found.xhat, derivatives.xhat)
    np.testing.assert_array_equal(found.ts, TS)


@pytest.mark.parametrize(
    ("ts", "y", "us", "message"),
    [
        (TS, None, None, r"observe\.ys: given None"),
        (pd.Series(SIGNAL, index=[str(t) for t in TS]), None, None, r"observe\.ts: given an index of"),
        (xr.DataArray(SIGNAL, dims="t"), None, None, "a record without times"),
        (pd.Series(SIGNAL), None, None, "a record without times"),
        (pd.Series(SIGNAL, index=TS), None, pd.Series(SIGNAL, index=TS + 1), r"observe\.us: given a record with another index"),
        (pd.Series(TS), pd.Series(SIGNAL, index=TS), None, r"observe\.ys: given a record with another index"),
    ],
)
def test_records_that_do_not_fit_are_refused(ts, y, us, message):
    with pytest.raises(ValueError, match=message):
        jaxobs.observe(HighGain(Pendulum(), [3.0, 2.0], 4.0), ts, y, us, xhat0=[0.0, 0.0])


def test_runs_become_data_sets(derivatives):
    ds = interop.to_dataset(derivatives, time=days(TS).tz_convert(None).to_numpy())
    assert ds.xhat.dims == ("time", "order")
    assert ds.order.values.tolist() == [0, 1]
    assert ds.attrs["mu"] == 20.0
    np.testing.assert_array_equal(ds.xhat.sel(order=1), derivatives.xhat[:, 1])
    observer = HighGain(Pendulum(), [3.0, 2.0], 4.0)
    world = {"x0": [1.0, 0.0], "xhat0": [0.0, 0.0], "ts": TS[:50], "noise": jaxobs.noise.Gaussian(0.1)}
    world["signal"] = jaxobs.signals.Sine(0.5)
    runs = jax.vmap(lambda key: jaxobs.simulate(Pendulum(), observer, key=key, **world))(jax.random.split(jax.random.key(0), 3))
    ds = interop.to_dataset(runs, batch=("seed",))
    assert ds.x.dims == ("seed", "time", "state")
    assert ds.u.dims == ("seed", "time", "input")
    assert ds.time.attrs["units"] == "s"
    np.testing.assert_array_equal(ds.xhat.isel(seed=1).sel(state=1), runs.xhat[1, :, 1])
    with pytest.raises(ValueError, match=r"to_dataset\.batch: given 0 names for 1"):
        interop.to_dataset(runs)


def test_linear_systems_of_python_control_both_ways():
    system = control.ss(A, B, C, 0)
    plant = interop.from_control(system)
    assert isinstance(plant, Linear)
    back = interop.to_control(plant)
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(back, name), getattr(system, name))
    observer = Luenberger(plant, [[3.0], [2.0]])
    world = {"x0": [1.0, -1.0], "xhat0": [0.0, 0.0], "ts": TS, "signal": jaxobs.signals.Sine(0.7, 2.0)}
    run = jaxobs.simulate(plant, observer, **world)
    # python-control's own integration of the plant, with the same input; between its samples the input is linear.
    theirs = control.forced_response(system, TS, np.asarray(run.u)[:, 0], X0=[1.0, -1.0], return_x=True)
    np.testing.assert_allclose(run.x.T, theirs.states, atol=2e-5)
    joint = interop.to_control(observer)
    np.testing.assert_allclose(joint.A, np.array(A) - [[3.0, 0.0], [2.0, 0.0]])
    np.testing.assert_allclose(joint.B, np.hstack([B, [[3.0], [2.0]]]))
    assert joint.input_labels == ["u[0]", "y[0]"]


def test_discrete_systems_and_transfer_functions():
    step = interop.from_control(control.ss([[0.5]], [[1.0]], [[2.0]], 0, 0.1))
    assert isinstance(step, LinearStep)
    assert interop.to_control(step, dt=0.1).dt == 0.1
    assert interop.to_control(step).dt is True
    plant = interop.from_control(control.tf([1.0, 2.0], [1.0, 3.0, 5.0]))
    back = control.ss2tf(interop.to_control(plant))
    w = np.geomspace(0.1, 10, 5)
    np.testing.assert_allclose(back(1j * w), (1j * w + 2) / ((1j * w) ** 2 + 3j * w + 5), rtol=1e-10)
    assert interop.to_control(StepLuenberger(step, [[0.1]]), dt=0.1).A[0, 0] == pytest.approx(0.3)


def test_a_nonlinear_observer_is_linearised_with_its_whole_state():
    observer = IntegralHighGain(Pendulum(), [3.0, 3.0, 1.0], 4.0, q=1)
    found = interop.to_control(observer)
    # Behind one integrator the error has the poles of alphas at gamma, moved by the slope of sin at 0, which is 1.
    scaled = [1.0, 3.0 * 4, 3.0 * 16 - 1.0, 1.0 * 64 - 3.0 * 4]
    np.testing.assert_allclose(np.sort_complex(found.poles()), np.sort_complex(np.roots(scaled)), rtol=1e-9)
    sampled = interop.to_control(Sampled(HighGain(Pendulum(), [3.0, 2.0], 4.0), jaxobs.integrators.RK4(), 0.01))
    assert sampled.dt == 0.01
    flow = interop.to_control(HighGain(Pendulum(), [3.0, 2.0], 4.0))
    steps = [np.linalg.matrix_power(0.01 * flow.A, k) / math.factorial(k) for k in range(5)]  # what RK4 makes of e^{A dt}
    np.testing.assert_allclose(sampled.A, sum(steps), rtol=1e-12)


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (control.ss([[0.0]], [[1.0]], [[1.0]], [[1.0]]), "D = "),
        (np.eye(2), "expected a StateSpace or a TransferFunction"),
    ],
)
def test_what_is_no_plant_here_is_refused(system, message):
    with pytest.raises(ValueError, match=message):
        interop.from_control(system)


class Counting(diffrax.AbstractProgressMeter):
    """Counts in its state, and keeps what it was told last."""

    def init(self):
        return jnp.zeros((2,))

    def step(self, state, progress):
        return jnp.stack([state[0] + 1, jnp.asarray(progress, state.dtype)])

    def close(self, state):
        jax.debug.callback(CLOSED.append, state)


CLOSED: list = []


def test_progress_meters_of_diffrax_follow_every_loop():
    CLOSED.clear()
    observer = HighGain(Pendulum(), [3.0, 2.0], 4.0)
    world = {"x0": [1.0, 0.0], "xhat0": [0.0, 0.0], "ts": TS[:40], "signal": jaxobs.signals.Sine(0.5)}
    plain = jaxobs.simulate(Pendulum(), observer, **world)
    run = jaxobs.simulate(Pendulum(), observer, **world, progress_meter=Counting())
    metrics = {"rmse": jaxobs.metrics.RMSE()}
    jaxobs.score(Pendulum(), observer, metrics=metrics, **world, progress_meter=Counting())
    jaxobs.observe(observer, TS[:40], SIGNAL[:40], np.zeros((40, 1)), xhat0=[0.0, 0.0], progress_meter=Counting())
    jaxobs.study(Pendulum(), observer, metrics=metrics, keys=jaxobs.Seeds(jax.random.key(0), 3), **world, progress=Counting())
    jax.effects_barrier()
    assert np.array_equal(run.xhat, plain.xhat)
    assert [float(state[1]) for state in CLOSED] == [1.0] * 4
    assert [float(state[0]) for state in CLOSED[:3]] == [40.0] * 3


def test_everything_works_inside_the_users_own_transformations():
    """One estimate by a scan over `step` that a user writes, under jit, vmap and grad, as `observe` makes it."""
    ys, us = jnp.asarray(SIGNAL[:30])[:, None], jnp.zeros((30, 1))

    def last(gamma, ys):
        observer = Sampled(HighGain(Pendulum(), [3.0, 2.0], gamma), jaxobs.integrators.RK4(), 0.01)

        def body(z, sample):
            k, u, y = sample
            return observer.step(k, z, u, y), observer.estimate(k, z, u, y)

        return jax.lax.scan(body, observer.init(jnp.zeros(2)), (jnp.arange(30), us, ys))[1][-1]

    def by_observe(gamma, ys):
        observer = Sampled(HighGain(Pendulum(), [3.0, 2.0], gamma), jaxobs.integrators.RK4(), 0.01)
        return jaxobs.observe(observer, TS[:30], ys, us, xhat0=jnp.zeros(2)).xhat[-1]

    gammas = jnp.array([3.0, 4.0])
    batch = jax.jit(jax.vmap(last, in_axes=(0, None)))(gammas, ys)
    np.testing.assert_allclose(batch, jax.vmap(by_observe, in_axes=(0, None))(gammas, ys), rtol=1e-12)
    slope = jax.grad(lambda gamma: by_observe(gamma, ys)[1])(gammas[0])
    ends = [float(last(gammas[0] + h, ys)[1]) for h in (-1e-5, 1e-5)]
    assert float(slope) == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-6)
