"""A chain of three states with bounds of its slopes, and a gain for it."""

import jax.numpy as jnp
import numpy as np

from jaxobs.plants import SineChain

BOUNDS = np.array([[-2.0, 1.0], [-0.5, 0.5], [0.0, 1.5]])
GAIN = (4.0, 6.0, 4.0)


def plant(n=3, k_f=1.0):
    return SineChain(jnp.asarray(k_f), n)
