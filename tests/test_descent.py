"""Gradient descent: closed forms, starts side by side, and steps that fail."""

import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxobs.tuning import descend


def test_minimises_a_quadratic_from_every_start():
    target = jnp.asarray([1.0, -2.0])
    starts = {"x": jnp.asarray([[0.0, 0.0], [3.0, 3.0], [-1.0, 4.0]])}
    found = descend(lambda theta, _: jnp.sum((theta["x"] - target) ** 2), starts, steps=400, rate=0.1)
    assert np.allclose(found.theta["x"], target, atol=1e-3)
    assert found.history.shape == (3, 400)
    assert np.allclose(found.value, found.history.min(axis=1))


def test_arguments_go_with_their_start():
    found = descend(lambda x, goal: (x - goal) ** 2, jnp.zeros(4), jnp.arange(4.0), steps=500, rate=0.1)
    assert np.allclose(found.theta, np.arange(4.0), atol=1e-2)


def test_a_step_into_nan_returns_to_the_best():
    """log(x) is NaN for x < 0; plain descent with this rate steps over the edge at once."""

    def loss(x, _):
        return jnp.log(x) ** 2 + x

    found = descend(loss, jnp.asarray([2.0]), steps=50, optimizer=optax.sgd(3.0))
    assert np.isnan(found.history).any()
    assert np.isfinite(found.value).all()
    assert found.value[0] <= loss(2.0, None)


@pytest.mark.parametrize("steps", [1, 7])
def test_the_best_iterate_is_kept_not_the_last(steps):
    found = descend(lambda x, _: x**2, jnp.asarray([1.0]), steps=steps, optimizer=optax.sgd(1.5))  # it diverges
    assert float(found.value[0]) == 1.0
    assert float(found.theta[0]) == 1.0
