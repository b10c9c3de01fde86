"""A second-order system whose acceleration is learned: a small network over the phase plane."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar, dtype_of, param, require_positive, require_shape
from jaxobs.plants.base import AbstractStepPlant


class LearnedField(AbstractStepPlant):
    """x1+ = x1 + dt x2 + dt^2/2 phi(x), x2+ = x2 + dt phi(x), y = x1, with the bounded acceleration

        phi(x) = v' tanh(W ((x - centre) / spread) + b).

    W (hidden, 2), b and v (hidden,), v in units of acceleration; centre and spread (2,) in units of x; dt [s]. v = 0 is the
    sampled chain of two integrators. |phi| <= sum |v|.
    """

    weights: Float[Array, "hidden 2"] = param()
    biases: Float[Array, " hidden"] = param()
    v: Float[Array, " hidden"] = param()
    centre: Float[Array, "2"] = param()
    spread: Float[Array, "2"] = param()
    dt: Scalar = param()
    n = 2
    m = 0
    p = 1

    def __check_init__(self):
        require_shape(self, "weights", self.weights, (self.v.shape[0], 2), "One row for each entry of v.")
        require_shape(self, "biases", self.biases, self.v.shape, "One bias for each entry of v.")
        require_positive(self, "spread", self.spread, "It scales the states to about one.")
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")

    def phi(self, x: Float[Array, "2"]) -> Scalar:
        return self.v @ jnp.tanh(self.weights @ ((x - self.centre) / self.spread) + self.biases)

    def step(self, k, x, u):
        phi = self.phi(x)
        return jnp.stack([x[0] + self.dt * x[1] + self.dt**2 / 2 * phi, x[1] + self.dt * phi])

    def h(self, x, u):
        return x[:1]

    def disturbance_matrix(self):
        """A jump of the velocity."""
        return jnp.asarray([[0.0], [1.0]], dtype_of(self))
