"""Adaptive steps through diffrax; every grid point is a step end, so held noise is never stepped over."""

import diffrax
import jax
import jax.numpy as jnp

from jaxobs._module import require_instance, require_integer, require_positive, static
from jaxobs.integrators.base import AbstractIntegrator


class Adaptive(AbstractIntegrator):
    """A diffrax solver with a PID step control at tolerances rtol, atol; `solver` defaults to Tsit5 (stiff: Kvaerno5).

    An interval that needs more than max_steps gives NaN: the lane is then reported as diverged at that time. Under `vmap` every
    lane costs as much as its slowest one.
    """

    solver: diffrax.AbstractSolver = diffrax.Tsit5()
    rtol: float = static(default=1e-6)
    atol: float = static(default=1e-9)
    max_steps: int = static(default=4096)

    def __check_init__(self):
        require_instance(self, "solver", self.solver, diffrax.AbstractSolver, "Build it first, e.g. diffrax.Kvaerno5().")
        require_positive(self, "rtol", self.rtol, "It is the relative error allowed in a step.")
        require_positive(self, "atol", self.atol, "It is the absolute error allowed in a step.")
        require_integer(self, "max_steps", self.max_steps, 1, "It bounds the steps in one grid interval.")

    def prepare(self, field, dt, z):
        return None

    def step(self, field, cache, t, dt, z):
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda time, z, args: field.flow(jnp.asarray(time, dt.dtype), z)),
            self.solver,
            t0=t,
            t1=t + dt,
            dt0=dt,
            y0=z,
            stepsize_controller=diffrax.PIDController(rtol=self.rtol, atol=self.atol),
            max_steps=self.max_steps,
            throw=False,
        )
        done = solution.result == diffrax.RESULTS.successful
        return jax.tree.map(lambda path: jnp.where(done, path[-1], jnp.nan), solution.ys)
