"""Noise that adds to the output: gaussian, uniform, sinusoidal, constant, none."""

import math

import jax.numpy as jnp

from jaxobs._module import Scalar, param, require_nonnegative
from jaxobs._random import normal, uniform
from jaxobs.noise.base import AbstractNoise, additive, grid_shape


class Silent(AbstractNoise):
    """w_k = 0."""

    memoryless = True

    def sample(self, key, ts, p):
        return additive(jnp.zeros((ts.shape[0], p), ts.dtype))


class Gaussian(AbstractNoise):
    """w_k ~ N(0, sigma^2), independent. Held over dt, its white-noise intensity is sigma^2 dt."""

    memoryless = True
    sigma: Scalar = param()

    def __check_init__(self):
        require_nonnegative(self, "sigma", self.sigma, "It measures the size of the noise.")

    def sample(self, key, ts, p):
        shape, dtype = grid_shape(self, ts, p)
        return additive(self.sigma * normal(key, math.prod(shape), dtype).reshape(shape))


class Uniform(AbstractNoise):
    """w_k uniform on [-width, width], independent; its standard deviation is width / sqrt(3)."""

    memoryless = True
    width: Scalar = param()

    def __check_init__(self):
        require_nonnegative(self, "width", self.width, "It measures the size of the noise.")

    def sample(self, key, ts, p):
        shape, dtype = grid_shape(self, ts, p)
        return additive(self.width * (2 * uniform(key, math.prod(shape), dtype).reshape(shape) - 1))


class Sinusoid(AbstractNoise):
    """w_k = amplitude sin(frequency t_k + phase), frequency in rad/s, the same in every output."""

    memoryless = True
    amplitude: Scalar = param()
    frequency: Scalar = param()
    phase: Scalar = param(default=0.0)

    def sample(self, key, ts, p):
        shape, dtype = grid_shape(self, ts, p)
        angle = self.frequency * ts.astype(dtype) + self.phase
        return additive(jnp.broadcast_to(self.amplitude * jnp.sin(angle)[:, None], shape))


class Bias(AbstractNoise):
    """w_k = value: a constant offset, which no observer of this project removes."""

    memoryless = True
    value: Scalar = param()

    def sample(self, key, ts, p):
        return additive(jnp.broadcast_to(self.value, (ts.shape[0], p)))
