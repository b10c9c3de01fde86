"""The noise of a study is that of `jaxobs.score`, whatever is drawn block by block and whatever at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxobs
from jaxobs import Seeds, integrators, metrics, noise, observers, plants, study

PLANT = plants.Pendulum()
OBSERVER = observers.HighGain(PLANT, [1.5, 1.0], 3.0)


class Walk(noise.AbstractNoise):
    """Noise of a user's own that has a memory."""

    def sample(self, key, ts, p):
        w = jnp.cumsum(0.01 * jax.random.normal(key, (ts.shape[0], p), ts.dtype), axis=0)
        return w, jnp.ones(w.shape, bool)


@pytest.mark.slow
@pytest.mark.parametrize("sources", [(noise.Gaussian(0.1), Walk()), (Walk(), noise.Gaussian(0.1))], ids=["after", "before"])
def test_noise_beside_one_with_a_memory_is_that_of_score(sources):
    """Over more than one block: the one would be drawn block by block, the other at once."""
    keys = Seeds(jax.random.key(3), 4)
    given = {
        "ts": np.linspace(0, 1, 2 * noise.BLOCK + 2),
        "x0": [0.5, 0.0],
        "xhat0": [0, 0],
        "metrics": {"rmse": metrics.RMSE()},
    }
    given |= {"integrator": integrators.Euler(), "noise": sources[0], "disturbance": sources[1]}
    found = study(PLANT, OBSERVER, keys=keys, **given)
    for i in range(len(keys)):
        expected = jaxobs.score(PLANT, OBSERVER, key=keys[i], **given)["rmse"]
        np.testing.assert_allclose(found.rmse.sel(seed=i), expected, rtol=1e-12, atol=1e-14)
