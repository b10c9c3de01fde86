"""Measurement noise: a path sampled on the time grid and held between its points."""

import abc

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key, UInt

from jaxobs._module import Module, dtype_of

PRNGKey = Key[Array, ""] | UInt[Array, "2"]


class AbstractNoise(Module):
    """y_k = h(x(t_k), u_k) + w_k where valid_k. The same objects serve as process disturbance, entering through E."""

    @abc.abstractmethod
    def sample(self, key: PRNGKey, ts: Float[Array, " T"], p: int) -> tuple[Float[Array, "T p"], Bool[Array, "T p"]]:
        """(w, valid) on the grid. w is finite everywhere, also where valid is False."""


def additive(w: Float[Array, "T p"]) -> tuple[Float[Array, "T p"], Bool[Array, "T p"]]:
    """Noise that adds to every sample and invalidates none."""
    return w, jnp.ones(w.shape, bool)


def grid_shape(noise: AbstractNoise, ts: Float[Array, " T"], p: int) -> tuple[tuple[int, int], jnp.dtype]:
    """Shape and dtype of a path: the precision is that of the noise's own parameters."""
    return (ts.shape[0], p), dtype_of(noise)
