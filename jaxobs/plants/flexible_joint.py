"""The robot link with a flexible joint: paper 004, (17)."""

import jax.numpy as jnp

from jaxobs._module import Scalar, dtype_of, param
from jaxobs.plants.forms import AbstractLipschitz


class FlexibleJoint(AbstractLipschitz):
    """J_m theta_m'' = tau - b theta_m' + K u,   J_l theta_l'' = -tau - M g h sin(theta_l),   tau = k1 d + k2 d^3,

    d = theta_l - theta_m, x = (theta_m, theta_m', theta_l, theta_l'), y = (theta_m', theta_m). Angles in rad, J_m, J_l
    [kg m^2], M [kg], h [m] from the axis to the centre of mass, damping b [N m s], gain K [N m / V], k1 [N m], k2 [N m],
    input u [V], gravity [m/s^2] (the paper gives no value: 9.81). The defaults are those of the paper; its g lacks the u.
    """

    motor_inertia: Scalar = param(default=3.7e-3)
    link_inertia: Scalar = param(default=9.3e-3)
    height: Scalar = param(default=0.15)
    mass: Scalar = param(default=0.21)
    damping: Scalar = param(default=4.6e-2)
    amplifier: Scalar = param(default=8e-2)
    stiffness: Scalar = param(default=1.0)
    hardening: Scalar = param(default=1.0)
    gravity: Scalar = param(default=9.81)
    n = 4
    m = 1
    p = 2

    def a(self):
        zero, one = jnp.zeros_like(self.stiffness), jnp.ones_like(self.stiffness)
        motor, link = self.stiffness / self.motor_inertia, self.stiffness / self.link_inertia
        rows = [
            [zero, one, zero, zero],
            [-motor, -self.damping / self.motor_inertia, motor, zero],
            [zero, zero, zero, one],
            [link, zero, -link, zero],
        ]
        return jnp.stack([jnp.stack(row) for row in rows])

    def b(self):
        zero = jnp.zeros_like(self.stiffness)
        weight = self.mass * self.gravity * self.height
        rows = [
            [zero, zero],
            [self.hardening / self.motor_inertia, zero],
            [zero, zero],
            [-self.hardening / self.link_inertia, -weight / self.link_inertia],
        ]
        return jnp.stack([jnp.stack(row) for row in rows])

    def c(self):
        return jnp.asarray([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]], dtype_of(self))

    def f(self, x):
        return jnp.stack([(x[2] - x[0]) ** 3, jnp.sin(x[2])])

    def g(self, y, u):
        return jnp.zeros((4,), dtype_of(self)).at[1].set(self.amplifier / self.motor_inertia * u[0])
