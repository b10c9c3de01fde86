"""Runner and IrregularRunner: `observe` one sample at a time, and what happens to samples that do not come as they should."""

import gc
import json
import resource
import tracemalloc

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxobs
from jaxobs import Runner, observers, plants
from jaxobs.integrators import RK4, Euler
from jaxobs.streaming import IrregularRunner

DT, T = 0.01, 60
RNG = np.random.default_rng(0)
TS, US = 5.0 + DT * np.arange(T), 0.3 * RNG.normal(size=(T, 1))
YS = 0.3 * RNG.normal(size=(T, 1))
BACKENDS = ["jax", "numpy"]
SOLVED = observers.PulledBack(observers.HighGain(plants.NormalChain(plants.Lienard(1.0), np.zeros(2)), [2.0, 1.0], 5.0))


def high_gain(dtype=np.float64, gamma=6.0):
    return jaxobs.astype(observers.HighGain(plants.Pendulum(), [2.0, 1.0], gamma), dtype)


def tracker(dtype=np.float64):
    return jaxobs.astype(observers.DiscreteTracker(2, 1, 20.0, DT, 0.5), dtype)


def fed(runner, order=None, ys=YS, ts=TS):
    """Samples in this order; the estimate after each."""
    u = US if runner.observer.m else np.zeros((T, 0))
    return np.array([runner.update(ts[k], ys[k], u[k]) for k in (range(T) if order is None else order)])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("make", "digits"),
    [(high_gain, 1e-12), (lambda: high_gain(np.float32), 2e-6), (tracker, 1e-11)],
    ids=["flow", "float", "step"],
)
def test_sample_by_sample_is_observe(make, digits, backend):
    ys = YS.copy()
    ys[7:10], ys[30] = np.nan, np.inf
    runner = Runner(make(), DT, xhat0=[0.1, 0.0], backend=backend)
    us = US if runner.observer.m else None
    expected = jaxobs.observe(make(), TS - TS[0], ys, us, xhat0=[0.1, 0.0]).xhat
    found = fed(runner, ys=ys)
    assert found.dtype == expected.dtype
    np.testing.assert_allclose(found, expected, rtol=digits, atol=digits)
    assert runner.counts == {"taken": 56, "lost": 4, "bridged": 0, "late": 0, "repeated": 0, "rejected": 0}
    assert (runner.k, runner.t) == (T - 1, pytest.approx(TS[-1]))


def test_the_held_innovation_is_that_of_observe():
    ys = YS.copy()
    ys[7:10] = np.nan
    runner = Runner(high_gain(), DT, xhat0=[0.0, 0.0], hold_innovation=True, backend="numpy")
    expected = jaxobs.observe(high_gain(), TS - TS[0], ys, US, xhat0=[0.0, 0.0], hold_innovation=True).xhat
    np.testing.assert_allclose(fed(runner, ys=ys), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_gap_is_bridged_as_lost_samples_with_the_last_input(backend):
    kept = [*range(20), *range(24, T)]
    runner = Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend=backend)
    found = fed(runner, kept)
    ys, us = YS.copy(), US.copy()
    ys[20:24], us[20:24] = np.nan, US[19]
    expected = jaxobs.observe(high_gain(), TS - TS[0], ys, us, xhat0=[0.0, 0.0]).xhat
    np.testing.assert_allclose(found, np.asarray(expected)[kept], rtol=1e-12, atol=1e-12)
    assert (runner.counts["bridged"], runner.counts["taken"]) == (4, 56)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("order", "late"), [([10, 12, 11, 13], 1), ([10, 13, 12, 11], 2), ([10, 14, 11, 12, 13], 3)])
def test_late_samples_are_put_in_their_place_to_the_bit(backend, order, late):
    in_time, mixed = (Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend=backend, rewind=6) for _ in range(2))
    fed(in_time)
    fed(mixed, [*range(10), *order, *range(max(order) + 1, T)])
    np.testing.assert_array_equal(mixed.xhat, in_time.xhat)
    assert (mixed.counts["late"], mixed.counts["rejected"]) == (late, 0)


def test_without_rewind_late_samples_are_ignored_and_counted():
    runner, without = (Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend="numpy") for _ in range(2))
    fed(runner, [*range(10), 12, 11, 11, *range(13, T)])
    fed(without, [*range(10), 12, *range(13, T)])
    np.testing.assert_array_equal(runner.xhat, without.xhat)
    assert (runner.counts["rejected"], runner.counts["late"]) == (2, 0)


def test_a_sample_too_old_is_ignored_though_rewind_is_on():
    runner = Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend="numpy", rewind=3)
    fed(runner, [*range(10), *range(12, 20), 10])
    assert (runner.counts["rejected"], runner.counts["late"]) == (1, 0)


def test_a_repeated_sample_is_ignored_and_one_that_was_lost_may_still_come():
    runner, once = (Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend="numpy") for _ in range(2))
    for k in range(20):
        if k == 15:
            runner.update(TS[k], None, US[k])
        runner.update(TS[k], YS[k], US[k])
        runner.update(TS[k] + 0.2 * DT, 9.0, US[k])
        once.update(TS[k], YS[k], US[k])
    np.testing.assert_array_equal(runner.xhat, once.xhat)
    assert (runner.counts["repeated"], runner.counts["late"]) == (20, 1)


def test_jitter_and_a_clock_that_drifts_do_no_harm():
    """The period is 1.003 dt, six samples' worth over the run, and every sample is up to a fifth of one off."""
    ts = 1e9 + 1.003 * DT * np.arange(2000) + DT * np.random.default_rng(1).uniform(-0.2, 0.2, 2000)
    runner = Runner(tracker(), DT, xhat0=[0.0, 0.0], backend="numpy")
    for t in ts:
        runner.update(t, 0.1)
    assert runner.counts == {"taken": 2000, "lost": 0, "bridged": 0, "late": 0, "repeated": 0, "rejected": 0}


@pytest.mark.parametrize("backend", BACKENDS)
def test_saved_and_restored_it_goes_on_to_the_bit(backend, tmp_path):
    order = [*range(10), 12, 11, *range(13, 30)]
    whole = Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend=backend, rewind=4)
    fed(whole, [*order, 32, 31, 30, *range(33, T)])
    first = Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend=backend, rewind=4)
    fed(first, [*order, 32, 31])
    first.save(tmp_path / "state.json")
    second = Runner.restore(high_gain(), tmp_path / "state.json")
    fed(second, [30, *range(33, T)])
    np.testing.assert_array_equal(second.xhat, whole.xhat)
    assert (second.counts, second.k, second.t) == (whole.counts, whole.k, whole.t)
    assert (tmp_path / "state.json").stat().st_size < 20_000
    assert [path.name for path in tmp_path.iterdir()] == ["state.json"]


def test_a_state_that_is_not_finite_survives_the_file(tmp_path):
    runner = Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend="numpy")
    runner._state = (np.float64(np.nan), np.float64(-np.inf))
    runner.save(tmp_path / "state.json")
    np.testing.assert_array_equal(Runner.restore(high_gain(), tmp_path / "state.json")._state, [np.nan, -np.inf])


def test_a_wrong_state_is_refused_and_what_differs_is_named(tmp_path):
    path = tmp_path / "state.json"
    Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend="numpy").save(path)
    with pytest.raises(ValueError, match=r"given observer\.gamma = 6\.1 \(float64\); expected 6\.0 \(float64\)"):
        Runner.restore(high_gain(gamma=6.1), path)
    with pytest.raises(ValueError, match=r"given observer\.model\.a = .* \(float32\); expected"):
        Runner.restore(high_gain(np.float32), path)
    with pytest.raises(ValueError, match=r"another observer: given jaxobs\.observers\.discrete_tracker\.DiscreteTracker"):
        Runner.restore(tracker(), path)
    with pytest.raises(ValueError, match=r"another observer: given .*Euler.*expected .*RK4"):
        Runner.restore(high_gain(), path, integrator=Euler())
    with pytest.raises(ValueError, match="given the state of a Runner; expected that of a IrregularRunner"):
        IrregularRunner.restore(high_gain(), path)
    text = path.read_text()
    path.write_text(text.replace('"taken": 0', '"taken": 7'))
    with pytest.raises(ValueError, match="do not match their SHA-256"):
        Runner.restore(high_gain(), path)
    path.write_text(text.replace("jaxobs-runner/1", "jaxobs-runner/9"))
    with pytest.raises(ValueError, match=r"given the format 'jaxobs-runner/9'; expected 'jaxobs-runner/1'"):
        Runner.restore(high_gain(), path)
    for wrong in ("", "{", "[1]", json.dumps({"format": 3})):
        path.write_text(wrong)
        with pytest.raises(ValueError, match=r"state\.json: given (text that is not JSON|the format)"):
            Runner.restore(high_gain(), path)


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dt": 0.0}, r"Runner\.dt: given 0\.0; expected a positive number"),
        ({"dt": "fast"}, r"Runner\.dt: given 'fast'"),
        ({"backend": "c"}, r"Runner\.backend: given 'c'; expected 'jax' or 'numpy'"),
        ({"rewind": -1}, r"Runner\.rewind: given -1"),
        ({"xhat0": [0.0]}, r"Runner\.xhat0: given shape \(1,\)"),
        ({"observer": (high_gain(), None)}, r"Runner\.observer: given tuple .*give the first"),
        (
            {"observer": tracker(), "dt": 0.02},
            r"Runner\.ts: given samples 0\.02 s apart; expected DiscreteTracker\.dt = 0\.01 s",
        ),
        ({"observer": tracker(), "integrator": RK4()}, r"Runner\.integrator: given RK4; expected none for a step observer"),
        ({"observer": SOLVED, "backend": "numpy"}, "uses 'lu'"),
    ],
)
def test_bad_arguments_are_named(change, message):
    given = {"observer": high_gain(), "dt": DT, "xhat0": [0.0, 0.0]} | change
    with pytest.raises(ValueError, match=message):
        Runner(given.pop("observer"), given.pop("dt"), **given)


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("sample", "message"),
    [
        ((1e308, 0.1, 0.0), r"Runner\.t: given 1e\+308 after a gap of .*Call restart"),
        ((None, 0.1, 0.0), r"Runner\.t: given None; expected a finite number of seconds"),
        ((0.0, [[1.0], [2.0, 3.0]], 0.0), r"Runner\.y: given \[\[1\.0\], \[2\.0, 3\.0\]\]; expected numbers"),
        ((np.nan, 0.1, 0.0), r"Runner\.t: given nan; expected a finite number of seconds"),
        ((np.datetime64("2026-01-01"), 0.1, 0.0), r"Runner\.t: given .*For dates: t\.timestamp\(\)"),
        ((0.0, [0.1, 0.2], 0.0), r"Runner\.y: given shape \(2,\); expected \(1,\)"),
        ((0.0, "much", 0.0), r"Runner\.y: given dtype <U4; expected real numbers"),
        ((0.0, 1j, 0.0), r"Runner\.y: given dtype complex128"),
        ((0.0, 0.1), r"Runner\.u: given None; expected \(1,\)"),
        ((0.0, 0.1, np.nan), r"Runner\.u: given \[nan\]; expected finite inputs"),
        ((1e6, 0.1, 0.0), r"Runner\.t: given 1000000\.0 after a gap of .*expected at most 10000\. Call restart"),
    ],
)
def test_bad_samples_are_named_and_change_nothing(sample, message):
    runner = Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend="numpy")
    runner.update(0.0, 0.2, 0.1)
    before = runner.xhat.copy(), runner.k, dict(runner.counts)
    with pytest.raises(ValueError, match=message):
        runner.update(*sample)
    assert (runner.k, runner.counts) == before[1:]
    np.testing.assert_array_equal(runner.xhat, before[0])
    runner.restart([0.5, 0.0])
    assert (runner.k, runner.counts["taken"]) == (-1, 0)


def fed_much(backend, count, look):
    """What `look` sees after a fifth of the samples, and after all."""
    runner, seen = Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend=backend, rewind=5), []
    for k in range(count):
        runner.update(DT * k, None if k % 7 == 0 else 0.1, 0.0)
        if k in (count // 5, count - 1):
            gc.collect()
            seen.append(look())
    return seen


@pytest.mark.parametrize("backend", BACKENDS)
def test_memory_does_not_grow(backend):
    """Bytes that Python holds, and JAX arrays that live."""
    tracemalloc.start()
    before, after = fed_much(backend, 1_000, lambda: (tracemalloc.get_traced_memory()[0], len(jax.live_arrays())))
    tracemalloc.stop()
    assert after[0] - before[0] < 20_000
    assert after[1] <= before[1]


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_the_caller_holds_is_not_the_state(backend):
    start = np.zeros(2)
    runner, other = (Runner(high_gain(), DT, xhat0=start, backend=backend) for _ in range(2))
    start[:] = 9.0
    np.testing.assert_array_equal(runner.xhat, [0.0, 0.0])
    for k, t in enumerate((np.array(0.0), jnp.asarray(DT), np.float64(2 * DT))):  # a time may be an array of no axes
        np.testing.assert_array_equal(runner.update(t, YS[k], US[k]), other.update(float(t), YS[k], US[k]))
    with pytest.raises(ValueError, match="read-only"):
        runner.xhat[0] = 9.0
    runner.update(-1e308, 0.1, 0.0)
    assert runner.counts["rejected"] == 1


def test_the_number_of_samples_may_be_any():
    """Steps are given 2^31 - 1 at most, and the count goes on: nothing ends after 24 days at 1 kHz."""
    runner = Runner(high_gain(), DT, xhat0=[0.0, 0.0], backend="numpy")
    runner.update(0.0, 0.1, 0.0)
    runner.k = 2**31 - 2
    for i in range(1, 4):
        assert np.isfinite(runner.update(DT * i, 0.1, 0.0)).all()
    assert runner.k == 2**31 + 1


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_memory_does_not_grow_over_a_million_samples(backend):
    """The most that the process ever had: 800,000 samples more, and not 8 bytes each, less than the smallest object takes."""
    before, after = fed_much(backend, 1_000_000, lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    assert after - before < 6_400  # kB


def test_nothing_is_compiled_again():
    runner = Runner(high_gain(), DT, xhat0=[0.0, 0.0])
    fed(runner, [*range(10), 12, 11, *range(13, T)])
    assert runner._step._cache_size() == 1
