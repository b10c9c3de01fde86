"""Sinusoidal inputs, with their derivatives where they are asked for."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param, require_integer, static
from jaxobs.signals.base import AbstractSignal


class Sine(AbstractSignal):
    """u(t) = offset + amplitude sin(frequency t + phase), frequency in rad/s; `order` derivatives are appended if > 0."""

    amplitude: Scalar = param(default=1.0)
    frequency: Scalar = param(default=1.0)
    phase: Scalar = param(default=0.0)
    offset: Scalar = param(default=0.0)
    order: int = static(default=0)
    m = 1

    def __check_init__(self):
        require_integer(self, "order", self.order, 0, "It counts the derivatives that u carries.")

    def __call__(self, t):
        angle = self.frequency * t + self.phase
        terms = [
            self.amplitude * self.frequency**r * jnp.sin(angle + jnp.asarray(r * jnp.pi / 2, angle.dtype))
            for r in range(self.order + 1)
        ]
        u = jnp.stack(terms).at[0].add(self.offset)
        return u if self.order == 0 else u[None, :]
