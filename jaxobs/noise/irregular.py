"""Noise that strikes now and then: outliers and dropouts; and sums of several kinds."""

import math

import jax
import jax.numpy as jnp

from jaxobs._module import Scalar, concrete, dtype_of, param, refuse, require_instance
from jaxobs._random import normal, uniform
from jaxobs.noise.base import AbstractNoise, additive, grid_shape


class Outliers(AbstractNoise):
    """w_k = size * N(0, 1) with the given probability, else 0, independently in each output."""

    memoryless = True
    probability: Scalar = param()
    size: Scalar = param()

    def __check_init__(self):
        _require_probability(self, self.probability)

    def sample(self, key, ts, p):
        shape, dtype = grid_shape(self, ts, p)
        when, what = jax.random.split(key)
        struck = uniform(when, math.prod(shape), dtype).reshape(shape) < self.probability
        return additive(jnp.where(struck, self.size * normal(what, math.prod(shape), dtype).reshape(shape), 0))


class Dropout(AbstractNoise):
    """valid_k = False with the given probability, independently in each output; w = 0."""

    memoryless = True
    probability: Scalar = param()

    def __check_init__(self):
        _require_probability(self, self.probability)

    def sample(self, key, ts, p):
        shape, dtype = grid_shape(self, ts, p)
        return jnp.zeros(shape, dtype), uniform(key, math.prod(shape), dtype).reshape(shape) >= self.probability


class Sum(AbstractNoise):
    """The sum of several noises, each with its own stream; a sample is valid where all parts are."""

    parts: tuple[AbstractNoise, ...]

    @property
    def memoryless(self):
        return all(part.memoryless for part in self.parts)

    def __check_init__(self):
        require_instance(self, "parts", self.parts, tuple | list, "Put the noises in a tuple: Sum((Gaussian(0.1), Bias(0.2))).")
        for i, part in enumerate(self.parts):
            require_instance(self, f"parts[{i}]", part, AbstractNoise, "Build it first, e.g. Gaussian(0.1).")
        if len(self.parts) == 0:
            raise refuse(self, "parts", "()", "at least one noise", "Use Silent() for no noise.")

    def sample(self, key, ts, p):
        keys = jax.random.split(key, len(self.parts))
        paths = [part.sample(k, ts, p) for part, k in zip(self.parts, keys, strict=True)]
        dtype = dtype_of(self)
        return jnp.sum(jnp.stack([w.astype(dtype) for w, _ in paths]), axis=0), jnp.all(
            jnp.stack([valid for _, valid in paths]), axis=0
        )


def _require_probability(noise: AbstractNoise, value) -> None:
    known = concrete(value)
    if known is not None and not ((known >= 0) & (known <= 1)).all():
        raise refuse(noise, "probability", known, "a number in [0, 1]", "It is the share of samples that are struck.")
