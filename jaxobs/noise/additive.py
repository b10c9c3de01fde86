"""Noise that adds to the output: gaussian, uniform, sinusoidal, constant, none."""

import jax
import jax.numpy as jnp

from jaxobs._module import Scalar, param, require_nonnegative
from jaxobs.noise.base import AbstractNoise, additive, grid_shape


class Silent(AbstractNoise):
    """w_k = 0."""

    def sample(self, key, ts, p):
        return additive(jnp.zeros((ts.shape[0], p), ts.dtype))


class Gaussian(AbstractNoise):
    """w_k ~ N(0, sigma^2), independent. Held over dt, its white-noise intensity is sigma^2 dt."""

    sigma: Scalar = param()

    def __check_init__(self):
        require_nonnegative(self, "sigma", self.sigma, "It measures the size of the noise.")

    def sample(self, key, ts, p):
        return additive(self.sigma * jax.random.normal(key, *grid_shape(self, ts, p)))


class Uniform(AbstractNoise):
    """w_k uniform on [-width, width], independent; its standard deviation is width / sqrt(3)."""

    width: Scalar = param()

    def __check_init__(self):
        require_nonnegative(self, "width", self.width, "It measures the size of the noise.")

    def sample(self, key, ts, p):
        shape, dtype = grid_shape(self, ts, p)
        return additive(self.width * jax.random.uniform(key, shape, dtype, -1, 1))


class Sinusoid(AbstractNoise):
    """w_k = amplitude sin(frequency t_k + phase), frequency in rad/s, the same in every output."""

    amplitude: Scalar = param()
    frequency: Scalar = param()
    phase: Scalar = param(default=0.0)

    def sample(self, key, ts, p):
        shape, dtype = grid_shape(self, ts, p)
        angle = self.frequency * ts.astype(dtype) + self.phase
        return additive(jnp.broadcast_to(self.amplitude * jnp.sin(angle)[:, None], shape))


class Bias(AbstractNoise):
    """w_k = value: a constant offset, which no observer of this project removes."""

    value: Scalar = param()

    def sample(self, key, ts, p):
        return additive(jnp.broadcast_to(self.value, (ts.shape[0], p)))
