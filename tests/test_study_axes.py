"""What a study runs over, how it is cut, what it is called, and what is refused before anything is compiled."""

import functools
import itertools
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from study_cases import FAMILY, GIVEN, KEYS, OBSERVER, PLANT, groups

from jaxobs import Seeds, grid, integrators, metrics, noise, observers, plants, signals, variants
from jaxobs.studies import memory, tree_mean, tree_sum
from jaxobs.studies.axes import decimal
from jaxobs.studies.config import config, describe, fingerprint
from jaxobs.studies.dataset import block, frame
from jaxobs.studies.plan import block_of, make_plan, parts_of
from jaxobs.studies.progress import Stop


def names(*args, **given):
    return [axis.name for axis in groups(*args, **given)[1][0].axes]


def test_axes_have_an_order_and_their_own_names():
    given = {"noise": grid(noise.Gaussian(0.1), sigma=[0.1, 0.2]), "keys": KEYS, "x0": [[0.5, 0.0]], "xhat0": [[0, 0], [1, 0]]}
    families = grid(OBSERVER, gamma=[2.0, 3.0], **{"model.a": [0.5, 1.0]})
    found = names(grid(PLANT, a=[0.5, 1.2]), families, **given)
    assert found == ["gamma", "model.a", "a", "sigma", "x0", "xhat0", "seed"]


def test_names_that_are_taken_say_whose_they_are():
    wave, source = signals.Sine(0.5, 2.0), noise.Sinusoid(0.5, 3.0)
    given = {"noise": grid(source, amplitude=[0.1, 0.2]), "signal": grid(wave, amplitude=[0.5, 1.0]), "keys": KEYS}
    assert names(**given)[1:3] == ["signal.amplitude", "noise.amplitude"]
    given["disturbance"] = grid(source, phase=[0.1])
    assert names(**given)[3] == "phase"
    families = variants(lambda a: FAMILY, a=[1, 2])
    assert names(grid(PLANT, a=[0.5]), families)[1] == "plant.a"
    assert names(PLANT, variants(lambda gamma: FAMILY, gamma=[1, 2])) == ["observer.gamma"]


def test_a_lane_is_the_combination_that_its_axes_say():
    given = {"noise": grid(noise.Gaussian(0.1), sigma=[0.1, 0.2, 0.3]), "keys": KEYS, "x0": [[0.5, 0.0], [0.1, 0.2]]}
    group = groups(grid(PLANT, a=[0.5, 1.2]), **given)[1][0]
    assert group.shape == group.world.shape == (2, 2, 3, 2, 3)
    assert group.lanes == 72
    world, observer, x0, xhat0, key = group.world.at((1, 0, 2, 1, 2))
    assert (observer.gamma, world.plant.a, world.noise.sigma) == (3.0, 0.5, 0.3)
    np.testing.assert_array_equal(x0, [0.1, 0.2])
    np.testing.assert_array_equal(xhat0, [0, 0])
    assert key == jax.random.fold_in(jax.random.key(0), 2)


def test_variants_are_the_full_grid_of_their_axes():
    made = []

    def make(q, kind):
        made.append((q, kind))
        return FAMILY

    shape_axes, found = groups(PLANT, variants(make, q=[0, 1], kind=["a", "b"]))
    assert made == [(0, "a"), (0, "b"), (1, "a"), (1, "b")]
    assert shape_axes == {"q": [0, 1], "kind": ["a", "b"]}
    assert [dict(group.label) for group in found] == [{"q": q, "kind": kind} for q, kind in made]


def test_coordinates_are_the_shortest_decimals():
    rng = np.random.default_rng(0)
    sizes = 10.0 ** rng.uniform(-12, 12, 20_000)
    values = np.concatenate([sizes, -sizes, 2.0 ** np.arange(-120, 120), [0.1, 0.0, 1e9, 1e-9, np.inf, np.nan]])
    single = values.astype(np.float32).reshape(2, -1)
    np.testing.assert_array_equal(decimal(single), single.astype(str).astype(float))
    assert decimal(values) is values


def test_coordinates_in_float32_can_be_selected_as_they_were_typed():
    values = np.asarray([0.1, 2.5, 1e-20, np.inf], np.float32)
    assert decimal(values).tolist() == [0.1, 2.5, 1e-20, np.inf]
    np.testing.assert_array_equal(decimal(values).astype(np.float32), values)


SHAPES = [(), (7,), (3, 5), (2, 3, 4), (4, 1, 6), (1, 1), (2, 100)]


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("most", [1, 2, 5, 24, 1000])
def test_a_chunk_is_a_rectangle_of_lanes_in_a_row(shape, most):
    size = block_of(shape, most)
    assert 1 <= math.prod(size) <= max(most, 1)
    lanes = np.arange(math.prod(shape)).reshape(shape)
    seen = []
    for corner in itertools.product(*(range(0, n, b) for n, b in zip(shape, size, strict=True))):
        part = lanes[tuple(slice(c, c + b) for c, b in zip(corner, size, strict=True))].reshape(-1)
        np.testing.assert_array_equal(np.diff(part), 1)
        seen += part.tolist()
    assert seen == list(range(lanes.size))
    if size and most < lanes.size:  # as large as allowed: one more value along the axis that is cut would be too much
        cut = next(i for i in reversed(range(len(shape))) if size[i] < shape[i] or i == 0)
        parts = -(-shape[cut] // size[cut])
        assert parts == 1 or -(-shape[cut] // (parts - 1)) * math.prod(shape[cut + 1 :]) > most


@pytest.mark.parametrize("chunk", [1, 4, 100])
def test_chunks_cover_every_group_once(chunk):
    shape_axes, found = groups(PLANT, {"one": FAMILY, "two": FAMILY}, keys=Seeds(jax.random.key(0), 5))
    plan = make_plan(found, shape_axes, chunk)
    ds = xr.Dataset({"lane": (tuple(plan.sizes), np.full(tuple(plan.sizes.values()), -1))})
    for i in range(len(plan)):
        part = plan[i]
        lanes = np.arange(part.start, part.start + part.count) + 10 * part.group
        where = ds.lane[dict(part.region)]
        assert part.index == i
        ds.lane[dict(part.region)] = lanes.reshape(where.shape)
    np.testing.assert_array_equal(ds.lane.values.reshape(-1), np.arange(20))
    with pytest.raises(IndexError, match=f"chunk {len(plan)} of {len(plan)}"):
        plan[len(plan)]
    shares = [set(parts_of(plan, (i, 3))) for i in range(3)]
    assert sorted(itertools.chain(*shares)) == list(range(len(plan)))


def test_the_layout_is_that_of_the_study_alone(monkeypatch):
    """Neither memory nor devices enter: every machine cuts the same study in the same way."""
    found = groups(keys=Seeds(jax.random.key(0), 10**6))[1]
    monkeypatch.setattr(memory, "free_memory", lambda: 1)
    plan = make_plan(found, {}, None)
    assert plan.block == {"gamma": 2, "seed": 10**6}  # 11 samples only: millions of lanes are little work
    long = groups(keys=Seeds(jax.random.key(0), 10**6), ts=np.linspace(0, 1, 100_001))[1]
    assert make_plan(long, {}, None).block["seed"] <= 2**15
    kept = groups(keys=Seeds(jax.random.key(0), 10**6), ts=np.linspace(0, 1, 100_001), save=1)[1]
    assert make_plan(kept, {}, None).block["seed"] * 100_001 * 4 * 8 <= 2**28


def test_vectors_along_an_axis_stand_beside_it():
    family = grid(OBSERVER, alphas=[[1.5, 1.0], [2.0, 1.0], [3.0, 2.0]])
    shape_axes, found = groups(PLANT, family, save=2)
    plan = make_plan(found, shape_axes, None)
    ds = frame(plan, config(found, shape_axes))
    np.testing.assert_array_equal(ds.alphas, [0, 1, 2])
    assert ds.alphas_value.dims == ("alphas", "alphas_0")
    np.testing.assert_array_equal(ds.alphas_value, [[1.5, 1.0], [2.0, 1.0], [3.0, 2.0]])
    np.testing.assert_array_equal(ds.time, GIVEN["ts"][::2])
    results = {name: np.arange(3 * math.prod(v.shape[1:])).reshape(3, *v.shape[1:]) for name, v in plan.variables.items()}
    for name, array in block(plan, plan[0], results).items():
        np.testing.assert_array_equal(array, results[name])


CHANGES = [
    {"plant": plants.Pendulum(1.1)},
    {"families": grid(OBSERVER, gamma=[2.0, 3.5])},
    {"families": grid(OBSERVER, gamma=[2.0, 3.0], **{"model.a": [1.0]})},
    {"families": {"one": FAMILY}},
    {"ts": np.linspace(0, 1, 12)},
    {"metrics": {"rmse": metrics.RMSE(0.5)}},
    {"metrics": {"error": metrics.RMSE()}},
    {"x0": [0.5, 0.1]},
    {"xhat0": [[0, 0]]},
    {"keys": Seeds(jax.random.key(1), 3)},
    {"keys": jax.random.split(jax.random.key(0), 3)},
    {"signal": signals.Sine(0.5, 2.0)},
    {"noise": noise.Uniform(0.1)},
    {"disturbance": noise.Uniform(0.1)},
    {"integrator": integrators.RK4(substeps=2)},
    {"hold_innovation": True},
    {"save": 2},
]
BASE = {"plant": PLANT, "families": FAMILY, "keys": KEYS}


def print_of(**given):
    shape_axes, found = groups(**(BASE | given))
    return fingerprint(config(found, shape_axes))


def test_every_argument_that_changes_numbers_changes_the_fingerprint():
    prints = [print_of(), *(print_of(**change) for change in CHANGES)]
    assert len(set(prints)) == len(prints)


def test_what_changes_no_number_does_not():
    other = grid(observers.HighGain(PLANT, [1.5, 1.0], 7.0), gamma=[2, 3])  # gamma runs over the same values all the same
    typed = {"families": other, "ts": np.linspace(0, 1, 11), "x0": np.asarray([0.5, 0.0]), "integrator": integrators.RK4()}
    assert print_of(**typed) == print_of()


def test_descriptions_keep_every_digit_and_hash_what_is_long():
    long = np.linspace(0, 1, 50)
    nudged = np.where(np.arange(50) == 25, np.nextafter(long, 2), long)
    assert describe(jnp.asarray(0.1)) == 0.1
    assert describe(np.asarray([np.nan, np.inf])) == ["nan", "inf"]
    assert describe(long)["sha256"] != describe(nudged)["sha256"]
    assert describe(lambda x: x + 1)["code"] != describe(lambda x: x + 2)["code"]
    assert describe(scaled(2))["given"] != describe(scaled(3))["given"]
    assert describe(scaled(2)) == describe(scaled(2)) == describe(jax.jit(scaled(2)))
    assert describe(functools.partial(math.pow, 2.0)) != describe(functools.partial(math.pow, 3.0))
    assert "0x" not in json.dumps(describe([object(), integrators.Adaptive()]), allow_nan=False)


def scaled(factor):
    return lambda x: factor * x


def proc(root, available, **files):
    (root / "proc/self").mkdir(parents=True)
    (root / "proc/meminfo").write_text(f"MemTotal: 1 kB\nMemAvailable: {available} kB\n")
    for name, text in files.items():
        path = root / name.replace("__", "/").replace("memory_", "memory.")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def test_free_memory_is_the_least_of_what_limits(tmp_path):
    assert memory.free_memory(proc(tmp_path / "plain", 1000)) == 1000 * 1024
    v2 = {"proc__self__cgroup": "0::/job/step\n", "sys__fs__cgroup__job__memory_max": "600000"}
    v2 |= {"sys__fs__cgroup__job__memory_current": "100000", "sys__fs__cgroup__job__step__memory_max": "max"}
    assert memory.free_memory(proc(tmp_path / "v2", 1000, **v2)) == 500_000
    v1 = {"sys__fs__cgroup__memory__memory_limit_in_bytes": "9000", "sys__fs__cgroup__memory__memory_usage_in_bytes": "2000"}
    v1 = {name.replace("memory_limit", "memory.limit").replace("memory_usage", "memory.usage"): t for name, t in v1.items()}
    assert memory.free_memory(proc(tmp_path / "v1", 1000, **v1)) == 7000
    assert memory.free_memory(tmp_path / "nothing") > 0
    assert memory.free_memory() > 2**20


@pytest.mark.parametrize("count", [1, 2, 3, 8, 13, 1000])
def test_trees_sum(count):
    values = np.random.default_rng(count).normal(size=(3, count)) * 10.0 ** np.arange(-3, 0)[:, None]
    array = xr.DataArray(values, dims=("gamma", "seed"), coords={"gamma": [1.0, 2.0, 3.0], "seed": np.arange(count)})
    exact = [math.fsum(row) for row in values]
    np.testing.assert_allclose(tree_sum(array, "seed"), exact, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(tree_mean(array, "seed"), np.asarray(exact) / count, rtol=1e-13, atol=1e-15)
    assert tree_mean(array, "seed").dims == ("gamma",)
    assert list(tree_mean(array, "seed").coords) == ["gamma"]


def test_trees_have_a_fixed_order():
    """1 + 2^-53 is 1, so that ((a + b) + (c + d)) + e is not the sum from left to right."""
    tiny = 2.0**-53
    array = xr.DataArray([1.0, tiny, tiny, tiny, tiny], dims="seed")
    assert float(tree_sum(array, "seed")) == ((1.0 + tiny) + (tiny + tiny)) + tiny > sum(array.values.tolist()) == 1.0


def test_trees_and_lanes_that_diverged():
    array = xr.DataArray([[1.0, np.nan, 3.0], [np.nan] * 3], dims=("gamma", "seed"))
    assert np.isnan(tree_mean(array, "seed")).all()
    np.testing.assert_array_equal(tree_sum(array, "seed", skipna=True), [4, 0])
    np.testing.assert_array_equal(tree_mean(array, "seed", skipna=True), [2, np.nan])
    assert tree_mean(array.astype(np.float32), "seed", skipna=True).dtype == np.float32
    with pytest.raises(ValueError, match=r"tree_sum\.dim: given 'lane'; expected one of gamma, seed"):
        tree_sum(array, "lane")


@pytest.mark.usefixtures("as_users_have_it")
def test_trees_take_one_variable():
    ds = xr.Dataset({"rmse": ("seed", [1.0, 2.0])})
    with pytest.raises(ValueError, match=r"tree_sum\.array: given .*an instance of DataArray"):
        tree_mean(ds, "seed")


def test_ctrl_c_is_left_alone_outside_the_main_thread():
    import signal
    import threading

    before, seen = signal.getsignal(signal.SIGINT), []

    def work():
        with Stop() as stop:
            seen.append((stop.before, signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [(None, before)]
