"""Any flow observer at any integrator, as a step observer."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param, require_instance, require_positive, require_shape
from jaxobs.integrators import AbstractIntegrator, Field, check_step
from jaxobs.observers.base import AbstractFlowObserver, AbstractStepObserver


class Sampled(AbstractStepObserver):
    """z_{k+1} = Integrator(observer.flow, z_k, dt) with u_k and y_k held over the interval; estimate that of the observer.

    Holding y adds dt/2 of delay to what the flow observer has. dt [s] must match the spacing of the data to 1e-3.
    """

    observer: AbstractFlowObserver
    integrator: AbstractIntegrator
    dt: Scalar = param()

    def __check_init__(self):
        require_instance(self, "observer", self.observer, AbstractFlowObserver, "A step observer needs no integrator.")
        require_instance(
            self, "integrator", self.integrator, AbstractIntegrator, "Build it first, e.g. jaxobs.integrators.RK4()."
        )
        require_shape(self, "dt", self.dt, (), "One sampling period.")
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")
        check_step("Sampled", self.observer, self.integrator, self.dt)

    @property
    def n(self):
        return self.observer.n

    @property
    def m(self):
        return self.observer.m

    @property
    def p(self):
        return self.observer.p

    def _field(self, u, y) -> Field:
        split = getattr(self.observer, "split", None)
        return Field(
            lambda t, z: self.observer.flow(t, z, u, y),
            None if split is None else (lambda t, z: split(t, z, u, y)),
        )

    def _time(self, k):
        return jnp.asarray(k, self.dt.dtype) * self.dt

    def init(self, xhat0):
        # The matrices of an exponential integrator live in the state: made once for each lane, outside the loop.
        z = self.observer.init(xhat0)
        u, y = jnp.zeros((self.observer.m,), self.dt.dtype), jnp.zeros((self.p,), self.dt.dtype)
        return z, self.integrator.prepare(self._field(u, y), self.dt, z)

    def step(self, k, z, u, y):
        inner, cache = z
        return self.integrator.step(self._field(u, y), cache, self._time(k), self.dt, inner), cache

    def estimate(self, k, z, u, y):
        return self.observer.estimate(self._time(k), z[0], u, y)

    def predict(self, k, z, u):
        return self.observer.predict(self._time(k), z[0], u)
