"""A plant whose measurement carries damped tones (mains hum, a vibration): an internal model of the noise."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Scalar, concrete, param, refuse, require_instance, require_positive, require_shape
from jaxobs.plants.base import AbstractStepPlant


class WithTones(AbstractStepPlant):
    """State (x, d_1, ..., d_r) with d_i in R^2, x+ = f(k, x, u), y = h(x, u) + sum_i (d_i)_1 in every output, and

        d_i+ = e^{-decay_i dt} [[cos w_i, -sin w_i], [sin w_i, cos w_i]] d_i,     w_i = 2 pi frequency_i dt.

    plant: any step plant, of the same dt if it has one. frequencies (r,) in Hz, decays (r,) in 1/s, dt in s. An observer with
    this model estimates the tones and keeps them out of x.
    """

    plant: AbstractStepPlant
    frequencies: Float[Array, " r"] = param()
    decays: Float[Array, " r"] = param()
    dt: Scalar = param()

    def __check_init__(self):
        require_instance(self, "plant", self.plant, AbstractStepPlant, "Wrap a flow plant: Discretised(plant, integrator, dt).")
        require_shape(self, "decays", self.decays, self.frequencies.shape, "One decay for each frequency.")
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")
        own, dt = concrete(getattr(self.plant, "dt", self.dt)), concrete(self.dt)
        if own is not None and dt is not None and not np.allclose(own, dt, rtol=1e-6, atol=0):
            raise refuse(
                self, "dt", dt, f"{type(self.plant).__name__}.dt = {own}", "Plant and tones share one sampling period."
            )

    @property
    def n(self):
        return self.plant.n + 2 * self.frequencies.shape[0]

    @property
    def m(self):
        return self.plant.m

    @property
    def p(self):
        return self.plant.p

    def step(self, k, x, u):
        own, tones = x[: self.plant.n], x[self.plant.n :]
        angle = 2 * jnp.pi * self.frequencies * self.dt
        damping = jnp.exp(-self.decays * self.dt)
        cosine, sine = damping * jnp.cos(angle), damping * jnp.sin(angle)
        a, b = tones[0::2], tones[1::2]
        turned = jnp.stack([cosine * a - sine * b, sine * a + cosine * b], axis=1).reshape(-1)
        return jnp.concatenate([self.plant.step(k, own, u), turned])

    def h(self, x, u):
        return self.plant.h(x[: self.plant.n], u) + jnp.sum(x[self.plant.n :: 2])

    def disturbance_matrix(self):
        own = self.plant.disturbance_matrix()
        return jnp.concatenate([own, jnp.zeros((2 * self.frequencies.shape[0], own.shape[1]), own.dtype)])
