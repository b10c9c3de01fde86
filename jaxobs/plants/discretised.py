"""Any flow plant at any integrator, as a step plant."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param, require_instance, require_positive
from jaxobs.integrators import AbstractIntegrator, Field
from jaxobs.plants.base import AbstractFlowPlant, AbstractStepPlant


class Discretised(AbstractStepPlant):
    """x+ = Integrator(plant.flow, x, dt) with u held; y as before. With Euler() it is the Euler model of paper 000, (50)."""

    plant: AbstractFlowPlant
    integrator: AbstractIntegrator
    dt: Scalar = param()

    def __check_init__(self):
        require_instance(self, "plant", self.plant, AbstractFlowPlant, "A step plant needs no integrator: take it as it is.")
        require_instance(
            self, "integrator", self.integrator, AbstractIntegrator, "Build it first, e.g. jaxobs.integrators.RK4()."
        )
        require_positive(self, "dt", self.dt, "It is the sampling period.")

    @property
    def n(self):
        return self.plant.n

    @property
    def m(self):
        return self.plant.m

    @property
    def p(self):
        return self.plant.p

    def step(self, k, x, u):
        split = getattr(self.plant, "split", None)
        field = Field(lambda t, x: self.plant.flow(t, x, u), split and (lambda t, x: split(t, x, u)))
        t = jnp.asarray(k, self.dt.dtype) * self.dt
        return self.integrator.step(field, self.integrator.prepare(field, self.dt, x), t, self.dt, x)

    def h(self, x, u):
        return self.plant.h(x, u)

    def disturbance_matrix(self):
        """E dt: a disturbance held over the step, to first order."""
        return self.plant.disturbance_matrix().astype(self.dt.dtype) * self.dt
