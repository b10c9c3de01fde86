"""Any flow observer at any integrator, as a step observer."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param, refuse, require_instance, require_positive, require_shape, static
from jaxobs.integrators import AbstractIntegrator, Field, check_step
from jaxobs.observers.base import AbstractFlowObserver, AbstractStepObserver


class Sampled(AbstractStepObserver):
    """z_{k+1} = Integrator(observer.flow, z_k, dt) with u_k and y_k held over the interval; estimate that of the observer.

    Holding y adds dt/2 of delay to what the flow observer has; between samples z settles on y_k, so that no error goes to zero
    while the output moves. holds="innovation" holds y_k - h(z_k) instead: at z(t) the observer is given y_k + h(z(t)) - h(z_k),

        z' = f(z, u) + L (y_k - h(z_k)),

    whose error does go to zero for periods that designs.sampled_data proves. dt [s] must match the spacing of the data to 1e-3.
    """

    observer: AbstractFlowObserver
    integrator: AbstractIntegrator
    dt: Scalar = param()
    holds: str = static(default="output")

    def __check_init__(self):
        require_instance(self, "observer", self.observer, AbstractFlowObserver, "A step observer needs no integrator.")
        require_instance(
            self, "integrator", self.integrator, AbstractIntegrator, "Build it first, e.g. jaxobs.integrators.RK4()."
        )
        require_shape(self, "dt", self.dt, (), "One sampling period.")
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")
        if self.holds not in ("output", "innovation"):
            fix = "The held innovation is what designs.sampled_data is about."
            raise refuse(self, "holds", repr(self.holds), "'output' or 'innovation'", fix)
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

    def _field(self, u, y, shift=None) -> Field:
        """The flow while y, or y + predict(t, z, u) - shift, is what the observer sees."""
        split = getattr(self.observer, "split", None)

        def seen(t, z):
            return y if shift is None else y + self.observer.predict(t, z, u) - shift

        return Field(
            lambda t, z: self.observer.flow(t, z, u, seen(t, z)),
            None if split is None else (lambda t, z: split(t, z, u, seen(t, z))),
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
        t = self._time(k)
        shift = self.observer.predict(t, inner, u) if self.holds == "innovation" else None
        return self.integrator.step(self._field(u, y, shift), cache, t, self.dt, inner), cache

    def estimate(self, k, z, u, y):
        return self.observer.estimate(self._time(k), z[0], u, y)

    def predict(self, k, z, u):
        return self.observer.predict(self._time(k), z[0], u)
