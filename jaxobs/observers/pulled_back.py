"""An observer designed in normal coordinates z = Phi(x), run in the coordinates of the plant."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import require_instance
from jaxobs.observers.base import AbstractFlowObserver
from jaxobs.observers.high_gain import HighGain
from jaxobs.observers.integral import IntegralHighGain
from jaxobs.observers.luenberger import Luenberger
from jaxobs.plants import AbstractNormalForm


class PulledBack(AbstractFlowObserver):
    """xhat' = (dPhi/dx)^-1 zhat'(Phi(xhat), u, y), estimate xhat: the observer of z, without the inverse of Phi,

        xhat' = f(xhat, u) + (dPhi/dx (xhat))^-1 L (y - h(xhat))          (Gauthier, Hammouri and Othman 1992)

    for HighGain and Luenberger; the integrators eps of IntegralHighGain stay as they are beside xhat. While dPhi/dx is regular
    along the way, Phi(xhat) is exactly the estimate of the observer in z. Where it loses rank the correction grows without
    bound: `jaxobs.structure.observability` says where.

    observer: one whose model is `plants.NormalChain` or `plants.NormalTriangular`. Its gains, and the plant's parameters in its
    model, stay leaves.
    """

    observer: HighGain | IntegralHighGain | Luenberger

    def __check_init__(self):
        fix = "Design it on jaxobs.structure.normal_form(plant, ...)."
        require_instance(self, "observer", self.observer, HighGain | IntegralHighGain | Luenberger, fix)
        require_instance(self, "observer.model", self.observer.model, AbstractNormalForm, fix)

    @property
    def n(self):
        return self.observer.n

    @property
    def m(self):
        return self.observer.m

    @property
    def p(self):
        return self.observer.p

    @property
    def q(self) -> int:
        """The number of states that are integrators, before xhat."""
        return self.observer.q if isinstance(self.observer, IntegralHighGain) else 0

    @property
    def form(self) -> AbstractNormalForm:
        assert isinstance(self.observer.model, AbstractNormalForm)
        return self.observer.model

    def error_poles(self) -> np.ndarray | None:
        """The poles of the linear part of the error in z, where the observer tells them."""
        return None if isinstance(self.observer, Luenberger) else self.observer.error_poles()

    def _mapped(self, z: Float[Array, " N"]) -> Float[Array, " N"]:
        return jnp.concatenate([z[: self.q], self.form.to_normal(z[self.q :])])

    def init(self, xhat0):
        return jnp.concatenate([self.observer.init(xhat0)[: self.q], xhat0])

    def flow(self, t, z, u, y):
        xhat = z[self.q :]
        here = eqx.tree_at(lambda one: one.model, self.observer, self.form.known(xhat))
        moved = here.flow(t, self._mapped(z), u, y)
        return jnp.concatenate([moved[: self.q], jnp.linalg.solve(self.form.jacobian(xhat), moved[self.q :])])

    def estimate(self, t, z, u, y):
        return z[self.q :]

    def predict(self, t, z, u):
        return self.form.plant.h(z[self.q :], u)
