"""A separately excited DC motor: what the armature current tells of the speed depends on the field."""

import jax.numpy as jnp

from jaxobs._module import Scalar, param
from jaxobs.plants.forms import AbstractTriangular


class FieldMotor(AbstractTriangular):
    """Armature current, speed and load torque; u = (flux phi, armature voltage v), y = current:

        L i'     = v - R i - k phi w,      J w' = k phi i - c tanh(w / w_c) - d w - tau,      tau' = 0

    so a_1 = -k phi / L and a_2 = -1 / J, and g is nonlinear by its friction, with the slope -(c / w_c + d) / J at most. Without
    flux the speed cannot be seen. Source: Krause, Wasynczuk and Sudhoff, Analysis of Electric Machinery, chapter 2; the
    friction law and the load as a state are ours. SI units.
    """

    resistance: Scalar = param(default=1.0)
    inductance: Scalar = param(default=0.5)
    torque_constant: Scalar = param(default=1.0)
    inertia: Scalar = param(default=0.5)
    coulomb: Scalar = param(default=0.2)
    stiction_speed: Scalar = param(default=0.5)
    damping: Scalar = param(default=0.1)
    n = 3
    m = 2

    def a(self, u):
        return jnp.stack([-self.torque_constant * u[0] / self.inductance, -1 / self.inertia])

    def g(self, x, u):
        friction = self.coulomb * jnp.tanh(x[1] / self.stiction_speed) + self.damping * x[1]
        torque = self.torque_constant * u[0] * x[0] - friction
        return jnp.stack([(u[1] - self.resistance * x[0]) / self.inductance, torque / self.inertia, jnp.zeros_like(x[0])])
