"""Measurement noise: a path sampled on the time grid and held between its points."""

import abc
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key, UInt

from jaxobs._module import Module, dtype_of

PRNGKey = Key[Array, ""] | UInt[Array, "2"]


class AbstractNoise(Module):
    """y_k = h(x(t_k), u_k) + w_k where valid_k. The same objects serve as process disturbance, entering through E."""

    memoryless: ClassVar[bool] = False  # what is drawn at one time says nothing of other times: it may be drawn block by block

    @abc.abstractmethod
    def sample(self, key: PRNGKey, ts: Float[Array, " T"], p: int) -> tuple[Float[Array, "T p"], Bool[Array, "T p"]]:
        """(w, valid) on the grid. w is finite everywhere, also where valid is False."""


def additive(w: Float[Array, "T p"]) -> tuple[Float[Array, "T p"], Bool[Array, "T p"]]:
    """Noise that adds to every sample and invalidates none."""
    return w, jnp.ones(w.shape, bool)


def grid_shape(noise: AbstractNoise, ts: Float[Array, " T"], p: int) -> tuple[tuple[int, int], jnp.dtype]:
    """Shape and dtype of a path: the precision is that of the noise's own parameters."""
    return (ts.shape[0], p), dtype_of(noise)


BLOCK = 64  # samples drawn together: a long run never holds its whole path


def drawn(noise: AbstractNoise, key: PRNGKey, ts: Float[Array, " T"], p: int, block: Any = None) -> tuple[Any, Any]:
    """(w, valid) on ts, block i of a memoryless noise from fold_in(key, i); with `block`, ts are the times of that one."""
    if not noise.memoryless:
        return noise.sample(key, ts, p)
    if block is not None:
        return noise.sample(jax.random.fold_in(key, block), ts, p)
    count = -(-ts.shape[0] // BLOCK)
    padded = jnp.concatenate([ts, jnp.broadcast_to(ts[-1:], (count * BLOCK - ts.shape[0],))]).reshape(count, BLOCK)
    blocks = jax.vmap(lambda i, ts: noise.sample(jax.random.fold_in(key, i), ts, p))(jnp.arange(count), padded)
    w, valid = (path.reshape(count * BLOCK, p)[: ts.shape[0]] for path in blocks)
    return w, valid
