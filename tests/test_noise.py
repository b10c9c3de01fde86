"""Moments of every kind of noise, and where its randomness comes from."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import noise

COUNT = 40_000
KEY = jax.random.key(5)


def path(source, key=KEY, count=COUNT, p=2, dtype=np.float64):
    w, valid = source.sample(key, jnp.arange(count, dtype=dtype) * 0.01, p)
    assert np.isfinite(w).all()
    return np.asarray(w), np.asarray(valid)


# source, variance and fourth moment of w_k; the mean is zero.
RANDOM = [
    (noise.Gaussian(0.3), 0.09, 3 * 0.3**4),
    (noise.Uniform(0.3), 0.03, 0.3**4 / 5),
    (noise.Outliers(0.1, 2.0), 0.4, 0.1 * 3 * 2.0**4),
    (noise.Sum((noise.Gaussian(0.3), noise.Gaussian(0.4))), 0.25, 3 * 0.25**2),
]


@pytest.mark.parametrize(("source", "variance", "fourth"), RANDOM, ids=lambda v: type(v).__name__)
def test_moments(source, variance, fourth):
    w, valid = path(source)
    assert valid.all()
    assert np.all(np.abs(w.mean(axis=0)) < 5 * np.sqrt(variance / COUNT))
    assert np.all(np.abs((w**2).mean(axis=0) - variance) < 5 * np.sqrt((fourth - variance**2) / COUNT))
    for product in (w[1:] * w[:-1], w[:, :1] * w[:, 1:]):  # white, and independent between outputs
        assert np.all(np.abs(product.mean(axis=0)) < 5 * variance / np.sqrt(COUNT - 1))


def test_uniform_stays_within_its_width():
    w, _ = path(noise.Uniform(0.3))
    assert 0.299 < np.max(np.abs(w)) <= 0.3


def test_outliers_strike_at_their_rate():
    w, _ = path(noise.Outliers(0.1, 2.0))
    assert np.all(np.abs((w != 0).mean(axis=0) - 0.1) < 5 * np.sqrt(0.09 / COUNT))


def test_dropouts_lose_samples_at_their_rate_and_add_nothing():
    w, valid = path(noise.Dropout(0.2))
    assert not w.any()
    assert np.all(np.abs((~valid).mean(axis=0) - 0.2) < 5 * np.sqrt(0.16 / COUNT))
    assert path(noise.Dropout(0.0))[1].all()
    assert not path(noise.Dropout(1.0))[1].any()


def test_deterministic_kinds():
    ts = np.arange(50) * 0.01
    expected = np.repeat(0.5 * np.sin(3 * ts + 0.2)[:, None], 2, axis=1)
    np.testing.assert_allclose(path(noise.Sinusoid(0.5, 3.0, 0.2), count=50)[0], expected, rtol=1e-14)
    assert (path(noise.Bias(0.7), count=50)[0] == 0.7).all()
    assert (path(noise.Silent(), count=50)[0] == 0).all()


def test_parts_of_a_sum_have_streams_of_their_own():
    sigma = 0.3
    both, _ = path(noise.Sum((noise.Gaussian(sigma), noise.Gaussian(-0.0))))
    again, _ = path(noise.Sum((noise.Gaussian(sigma), noise.Gaussian(sigma))))
    second = again - both
    assert np.all(np.abs((both * second).mean(axis=0)) < 5 * sigma**2 / np.sqrt(COUNT))
    _, valid = path(noise.Sum((noise.Dropout(0.5), noise.Dropout(0.5))))
    assert np.all(np.abs(valid.mean(axis=0) - 0.25) < 5 * np.sqrt(0.1875 / COUNT))


@pytest.mark.parametrize("source", [s for s, *_ in RANDOM] + [noise.Dropout(0.2)], ids=lambda s: type(s).__name__)
def test_a_path_is_decided_by_its_key_alone(source):
    once, again, other = (path(source, key, 50) for key in (KEY, jax.random.key(5), jax.random.key(6)))
    assert all((a == b).all() for a, b in zip(once, again, strict=True))
    assert any((a != b).any() for a, b in zip(once, other, strict=True))
    in_single = path(source, KEY, 50, dtype=np.float32)  # the precision of the grid changes nothing
    assert all((a == b).all() and a.dtype == b.dtype for a, b in zip(once, in_single, strict=True))
    raw = path(source, jax.random.PRNGKey(5), 50)  # keys of the old kind are the same keys
    assert all((a == b).all() for a, b in zip(once, raw, strict=True))


def test_lanes_draw_what_they_draw_alone():
    keys = jax.random.split(KEY, 3)
    source, ts = noise.Sum((noise.Gaussian(0.2), noise.Outliers(0.1, 3.0))), jnp.linspace(0, 2, 20)
    together = jax.vmap(lambda key: source.sample(key, ts, 1)[0])(keys)
    for lane, key in zip(together, keys, strict=True):
        np.testing.assert_allclose(lane, source.sample(key, ts, 1)[0], rtol=1e-15, atol=1e-16)
