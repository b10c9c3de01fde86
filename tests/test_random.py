"""Random numbers: the generator's known answers, jax.random's bits, and the laws."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from jaxobs import _random as random

DTYPES = [np.float32, np.float64]
KEY = jax.random.key(7)
LANES, COUNT = 512, 400


@pytest.fixture(scope="module", params=DTYPES, ids=["float32", "float64"])
def drawn(request):
    """(LANES, COUNT) normals, one key a lane."""
    keys = jax.random.split(KEY, LANES)
    return np.asarray(jax.vmap(lambda key: random.normal(key, COUNT, request.param))(keys), np.float64)


@pytest.mark.parametrize(
    ("key", "counter", "words"),
    [
        ((0, 0), (0, 0), (0x6B200159, 0x99BA4EFE)),
        ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
        ((0x13198A2E, 0x03707344), (0x243F6A88, 0x85A308D3), (0xC4923A9C, 0x483DF7A0)),
    ],
)
def test_known_answers(key, counter, words):
    """Those of the authors' Random123."""
    pairs = [tuple(jnp.asarray(n, jnp.uint32) for n in numbers) for numbers in (key, counter)]
    assert tuple(int(w) for w in random.threefry(*pairs)) == words


def test_bits_are_those_of_jax():
    for key in (KEY, jax.random.fold_in(KEY, 3), jax.random.PRNGKey(11)):
        high, low = random.bits(key, 100)
        words = np.asarray(high, np.uint64) << np.uint64(32) | np.asarray(low, np.uint64)
        np.testing.assert_array_equal(words, jax.random.bits(key, (100,), jnp.uint64))


def test_other_generators_serve_too():
    normals = random.normal(jax.random.key(0, impl="rbg"), 5000, np.float64)
    assert scipy.stats.kstest(np.asarray(normals), "norm").pvalue > 1e-3


@pytest.mark.parametrize("dtype", DTYPES)
def test_number_i_depends_on_the_key_and_on_i_only(dtype):
    for draw, less in ((random.normal, 3), (random.uniform, 1)):
        whole = draw(KEY, 257, dtype)
        assert whole.dtype == dtype
        np.testing.assert_array_equal(draw(KEY, less, dtype), whole[:less])


@pytest.mark.parametrize("dtype", DTYPES)
def test_transformations_give_the_same_bits(dtype):
    keys, draw = jax.random.split(KEY, 33), partial(random.normal, count=64, dtype=dtype)
    one = np.stack([draw(key) for key in keys])
    np.testing.assert_array_equal(jax.vmap(draw)(keys), one)
    np.testing.assert_array_equal(jax.jit(jax.vmap(draw, out_axes=-1))(keys).T, one)
    np.testing.assert_array_equal(jax.lax.map(draw, keys), one)


@pytest.mark.parametrize("dtype", DTYPES)
def test_formula(dtype):
    """From JAX's own bits, in NumPy's float64."""
    words = np.asarray(jax.random.bits(KEY, (20000,), jnp.uint64))
    high, low = (
        (words >> np.uint64(32)).astype(float),
        (words & np.uint64(0xFFFFFFFF)).astype(np.uint32).view(np.int32).astype(float),
    )
    radius = np.sqrt(-2 * np.log((high + 0.5) / 2.0**32))
    known = radius * np.sin((low + 0.5) * np.pi / 2**32)
    size = np.finfo(dtype).eps * (4 * radius + 1 / radius)  # logarithm, root, sine, product; and the rounding of u
    assert np.max(np.abs(np.asarray(random.normal(KEY, 20000, dtype), float) - known) / size) < 1
    kept = 24 if dtype == np.float32 else 53
    ours = np.asarray(random.uniform(KEY, 20000, dtype), float)
    np.testing.assert_array_equal(ours, (words >> np.uint64(64 - kept)).astype(float) * 2.0**-kept)


@pytest.mark.parametrize("dtype", DTYPES)
def test_logarithm(dtype):
    x = np.concatenate(
        [np.geomspace(2.0**-33, 1, 20000), 1 - np.geomspace(1e-7, 0.3, 2000), np.geomspace(1, 1e30, 2000)]
    ).astype(dtype)
    known = np.log(x.astype(np.longdouble))
    ours = np.asarray(jax.jit(random._log)(x))
    assert np.all(np.abs(ours - known) <= 2 * np.spacing(np.abs(known).astype(dtype)))


@pytest.mark.parametrize("dtype", DTYPES)
def test_extreme_words_give_finite_numbers(dtype, monkeypatch):
    words = jnp.asarray([0, 1, 2**31 - 1, 2**31, 2**32 - 1], jnp.uint32)
    high, low = (w.reshape(-1) for w in jnp.meshgrid(words, words))
    monkeypatch.setattr(random, "bits", lambda key, count: (high, low))
    normals, uniform = jax.jit(lambda: [f.__wrapped__(KEY, 25, dtype) for f in (random.normal, random.uniform)])()
    assert np.all(np.isfinite(normals))
    assert np.max(np.abs(normals)) <= 6.77
    assert np.all((uniform >= 0) & (uniform < 1))


def test_law(drawn):
    """Kolmogorov and Smirnov's test, the first four moments and the tails, within 5 standard errors."""
    x = drawn.ravel()
    assert scipy.stats.kstest(x, "norm").pvalue > 1e-3
    for power, mean in ((1, 0), (2, 1), (3, 0), (4, 3)):
        assert abs(np.mean(x**power) - mean) < 5 * np.std(x**power) / np.sqrt(x.size)
    for level in (1, 2, 3, 4):
        expected = x.size * 2 * scipy.stats.norm.sf(level)
        assert abs(np.sum(np.abs(x) > level) - expected) < 5 * np.sqrt(expected)


def test_independence(drawn):
    """Between lanes and between times, of the numbers and of their squares; the law is the same at each time."""
    for x in (drawn, drawn**2 - 1):
        x = x / np.sqrt(np.mean(x**2))
        for rows in (x, x.T):
            correlation = rows @ rows.T / rows.shape[1]
            off = correlation[np.triu_indices(len(rows), 1)]
            assert np.max(np.abs(off)) < 8 / np.sqrt(rows.shape[1])
            assert abs(np.mean(off**2) * rows.shape[1] - 1) < 0.1
    means = drawn.mean(axis=0) * np.sqrt(LANES)
    assert scipy.stats.kstest(means, "norm").pvalue > 1e-3


def test_keys_of_a_sequence_are_independent():
    """fold_in(key, 0), fold_in(key, 1), ...: what follows one block is not what starts another."""
    blocks = jax.vmap(lambda i: random.normal(jax.random.fold_in(KEY, i), 64, np.float64))(jnp.arange(2000))
    path = np.asarray(blocks).ravel()
    for lag in (1, 2, 63, 64, 65, 128):
        assert abs(np.mean(path[lag:] * path[:-lag])) < 5 / np.sqrt(path.size)
    assert len(np.unique(path)) == path.size


@pytest.mark.slow
@pytest.mark.parametrize("dtype", DTYPES)
def test_law_of_many(dtype):
    """1e8 numbers: counts in cells of equal probability, and beyond 5 standard deviations."""
    edges, cells = scipy.stats.norm.ppf(np.arange(1, 64) / 64), np.zeros(64)
    draw = jax.jit(jax.vmap(lambda key: random.normal(key, 1000, dtype)))
    beyond, total = 0, 0
    for i in range(100):
        x = np.asarray(draw(jax.random.split(jax.random.fold_in(KEY, i), 1000)), float).ravel()
        cells += np.bincount(np.searchsorted(edges, x), minlength=64)
        beyond, total = beyond + np.sum(np.abs(x) > 5), total + x.size
    assert scipy.stats.chisquare(cells).pvalue > 1e-3
    expected = total * 2 * scipy.stats.norm.sf(5)
    assert abs(beyond - expected) < 5 * np.sqrt(expected)
