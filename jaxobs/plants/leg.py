"""The lower leg of a walker as a pendulum driven by an unknown muscle torque."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param
from jaxobs.plants.forms import AbstractChain


class SwingingLeg(AbstractChain):
    """x1' = x2, x2' = x3, x3' = d/dt [-a sin(x1 - rest) - b x2] + v', v' = -c v: a pendulum in chain coordinates.

    With x3 = x1'' the muscle torque (per inertia) is v = x3 + a sin(x1 - rest) + b x2, and

        phi(x) = -a cos(x1 - rest) x2 - b x3 - c [x3 + a sin(x1 - rest) + b x2].

    a [1/s^2] gravity over length, b [1/s] damping, c [1/s] the rate at which torque is forgotten, rest [rad] hanging angle.
    """

    a: Scalar = param()
    b: Scalar = param()
    c: Scalar = param()
    rest: Scalar = param()
    n = 3
    m = 0

    def phi(self, x, u):
        gravity = self.a * jnp.sin(x[0] - self.rest)
        torque = x[2] + gravity + self.b * x[1]
        return -self.a * jnp.cos(x[0] - self.rest) * x[1] - self.b * x[2] - self.c * torque
