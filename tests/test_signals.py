"""Values and derivatives of the inputs u(t)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs.signals import Held, Recorded, Sine, Zero

TS, VALUES = [0.0, 0.5, 2.0], [[1.0, 10.0], [3.0, 20.0], [-1.0, 0.0]]


def test_sine_and_its_derivatives():
    signal = Sine(amplitude=0.5, frequency=2.0, phase=0.3, offset=1.0, order=3)
    ts = jnp.linspace(-1, 2, 7)
    values = jax.vmap(signal)(ts)
    assert values.shape == (7, 1, 4)
    np.testing.assert_allclose(values[:, 0, 0], 1 + 0.5 * np.sin(2 * ts + 0.3), rtol=1e-14)
    for r in range(3):
        slope = jax.vmap(jax.grad(lambda t, r=r: signal(t)[0, r]))(ts)
        np.testing.assert_allclose(values[:, 0, r + 1], slope, rtol=0, atol=1e-14)


def test_sine_without_derivatives_is_a_vector():
    assert Sine()(jnp.asarray(0.0)).shape == (1,)
    assert Sine(phase=jnp.pi / 2)(jnp.asarray(0.0)) == 1


@pytest.mark.parametrize(
    ("t", "held", "joined"),
    [
        (-1.0, [1, 10], [1, 10]),
        (0.0, [1, 10], [1, 10]),
        (0.25, [1, 10], [2, 15]),
        (0.5 - 1e-9, [1, 10], [3, 20]),
        (0.5, [3, 20], [3, 20]),
        (1.25, [3, 20], [1, 10]),
        (2.0, [-1, 0], [-1, 0]),
        (9.0, [-1, 0], [-1, 0]),
    ],
)
def test_recorded_inputs(t, held, joined):
    """Held keeps the last sample, from its own time on; Recorded joins the samples; both are constant outside."""
    assert (Held(TS, VALUES)(jnp.asarray(t)) == jnp.asarray(held, float)).all()
    np.testing.assert_allclose(Recorded(TS, VALUES)(jnp.asarray(t)), joined, atol=2e-8)


def test_sizes():
    assert Held(TS, VALUES).m == Recorded(TS, VALUES).m == 2
    assert Zero(3)(jnp.asarray(0.0)).shape == (3,)
    assert Zero()(jnp.asarray(0.0)).shape == (0,)
