"""The Luenberger observer whose nonlinearity is also corrected by the measurement: measured states are put in as measured."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import param, require_finite, require_instance, require_shape
from jaxobs.observers.base import AbstractFlowObserver, AbstractModelled
from jaxobs.plants import AbstractLipschitz


class InnerInjection(AbstractModelled, AbstractFlowObserver):
    """z' = A z + B f(z + K (y - C z)) + g(y, u) + L (y - C z), estimate z.

    model: a plant x' = A x + B f(x) + g(y, u), y = C x. gain L and inner gain K, both (n, p). K = C^+ (`measured`) makes f see
    y itself wherever y is a state, so that the slopes of f along measured states leave the error equation; K = 0 is paper 004
    (10) with g of the measured y. Source: Arcak and Kokotovic, Automatica 37 (2001) (its circle-criterion observer).
    """

    model: AbstractLipschitz
    gain: Float[Array, "n p"] = param()
    inner: Float[Array, "n p"] = param()

    def __check_init__(self):
        fix = "Write the plant as x' = A x + B f(x) + g(y, u)."
        require_instance(self, "model", self.model, AbstractLipschitz, fix)
        for name, value in (("gain", self.gain), ("inner", self.inner)):
            shape = (self.model.n, self.model.p)
            require_shape(self, name, value, shape, "One row a state, one column an output.")
            require_finite(self, name, value)

    def init(self, xhat0):
        return xhat0

    def flow(self, t, z, u, y):
        innovation = y - self.model.h(z, u)
        known = self.model.f(z + self.inner @ innovation)
        return self.model.a() @ z + self.model.b() @ known + self.model.g(y, u) + self.gain @ innovation

    def split(self, t, z, u, y):
        linear = self.model.a() - self.gain @ self.model.c()
        return linear, self.flow(t, z, u, y) - linear @ z

    def estimate(self, t, z, u, y):
        return z

    def predict(self, t, z, u):
        return self.model.h(z, u)


def measured(model: AbstractLipschitz) -> Float[Array, "n p"]:
    """K = C^+: the inner gain with C (z + K (y - C z)) = y. For outputs that are states it puts y in their place."""
    c = np.asarray(model.c(), np.float64)
    return jnp.asarray(np.linalg.pinv(c), model.c().dtype)
