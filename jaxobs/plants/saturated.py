"""The model with its nonlinearity frozen outside a box: what an observer may run on when the plant is known to stay inside."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import concrete, param, refuse, require_instance, require_shape
from jaxobs.plants.forms import AbstractLipschitz


class Saturated(AbstractLipschitz):
    """x' = A x + B f(sat(x)) + g(y, u), sat(x) = min(max(x, lower), upper): the plant on the box, Lipschitz everywhere.

    plant in the form of paper 004; lower <= upper (n,). Then f(sat(x)) - f(sat(z)) = sum_ij e_i d_ij (x_j - z_j), where each
    d_ij lies between 0 and the slopes of f on the box: bounds on the box, extended to include 0, hold for every z.
    """

    plant: AbstractLipschitz
    lower: Float[Array, " n"] = param()
    upper: Float[Array, " n"] = param()

    def __check_init__(self):
        require_instance(self, "plant", self.plant, AbstractLipschitz, "Write the plant as x' = A x + B f(x) + g(y, u).")
        for name, value in (("lower", self.lower), ("upper", self.upper)):
            require_shape(self, name, value, (self.plant.n,), "One bound a state.")
        low, high = concrete(self.lower), concrete(self.upper)
        if low is not None and high is not None and not (low <= high).all():
            raise refuse(self, "lower", f"{low} above upper = {high}", "lower <= upper", "Swap the two bounds.")

    @property
    def n(self):
        return self.plant.n

    @property
    def m(self):
        return self.plant.m

    @property
    def p(self):
        return self.plant.p

    def a(self):
        return self.plant.a()

    def b(self):
        return self.plant.b()

    def c(self):
        return self.plant.c()

    def f(self, x):
        return self.plant.f(jnp.clip(x, self.lower, self.upper))

    def g(self, y, u):
        return self.plant.g(y, u)
