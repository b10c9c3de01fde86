"""The Luenberger-type observer: a copy of the model, corrected through a constant gain. Designs differ only in L."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import param, refuse, require_finite, require_instance, require_shape
from jaxobs.observers.base import AbstractFlowObserver, AbstractModelled, AbstractStepObserver
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant

FLOW = "For a step plant take StepLuenberger or CurrentLuenberger."
STEP = "For a flow plant take Luenberger, or wrap the plant: jaxobs.plants.Discretised(plant, integrator, dt)."


class Luenberger(AbstractModelled, AbstractFlowObserver):
    """z' = f(z, u) + L (y - h(z)), estimate z (papers 000 (6), 002 (9), 003 (3), 004 (5) are of this form).

    model: any flow plant. gain L (n, p), finite. For models with a linear part `split` makes the stiff terms explicit.
    """

    model: AbstractFlowPlant
    gain: Float[Array, "n p"] = param()

    def __check_init__(self):
        _check(self, AbstractFlowPlant, FLOW)

    def init(self, xhat0):
        return xhat0

    def flow(self, t, z, u, y):
        return self.model.flow(t, z, u) + self.gain @ (y - self.model.h(z, u))

    def split(self, t, z, u, y):
        linear_part = getattr(self.model, "split", None)
        if linear_part is None:
            raise refuse(self, "model", type(self.model).__name__, "a form with split", "Use RK4 or Adaptive for this model.")
        a, b = linear_part(t, z, u)
        c = jax.jacfwd(self.model.h)(jnp.zeros_like(z), u)  # h = c z for all forms; what is left otherwise goes into b
        return a - self.gain @ c, b + self.gain @ (y - self.model.h(z, u) + c @ z)

    def estimate(self, t, z, u, y):
        return z

    def predict(self, t, z, u):
        return self.model.h(z, u)


class StepLuenberger(AbstractModelled, AbstractStepObserver):
    """z+ = f(k, z, u) + L (y - h(z)), estimate z: the estimate at k uses y up to k - 1 (papers 000 (51), 004 (14)).

    On Discretised(plant, Euler(), dt) it is the observer (51) of paper 000 with L = X^-1 C' (designs.euler_tied, euler_free),
    and (53) and (64) with L = dt P(gamma) C' (designs.euler_riccati): one observer, three designs.

    model: any step plant. gain L (n, p), finite.
    """

    model: AbstractStepPlant
    gain: Float[Array, "n p"] = param()

    def __check_init__(self):
        _check(self, AbstractStepPlant, STEP)

    def init(self, xhat0):
        return xhat0

    def step(self, k, z, u, y):
        return self.model.step(k, z, u) + self.gain @ (y - self.model.h(z, u))

    def estimate(self, k, z, u, y):
        return z

    def predict(self, k, z, u):
        return self.model.h(z, u)


class CurrentLuenberger(AbstractModelled, AbstractStepObserver):
    """xhat = z + K (y - h(z)), z+ = f(k, xhat, u): the current (filter) form, whose estimate at k uses y_k.

    For a linear model it is StepLuenberger with L = F K, less one sample of delay. gain K (n, p), finite.
    Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, section 8.2.
    """

    model: AbstractStepPlant
    gain: Float[Array, "n p"] = param()

    def __check_init__(self):
        _check(self, AbstractStepPlant, STEP)

    def init(self, xhat0):
        return xhat0

    def step(self, k, z, u, y):
        return self.model.step(k, self.estimate(k, z, u, y), u)

    def estimate(self, k, z, u, y):
        return z + self.gain @ (y - self.model.h(z, u))

    def predict(self, k, z, u):
        return self.model.h(z, u)


def _check(observer, kind: type, fix: str) -> None:
    require_instance(observer, "model", observer.model, kind, fix)
    shape = (observer.model.n, observer.model.p)
    require_shape(observer, "gain", observer.gain, shape, "One row a state, one column an output: [[l1], [l2], ...] for p = 1.")
    require_finite(observer, "gain", observer.gain)
