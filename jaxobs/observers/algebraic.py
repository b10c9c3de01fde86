"""The algebraic observer: a derivative tracker, then a static map from the output's derivatives to the state."""

import abc
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxobs._module import Module, dtype_of, refuse, require_instance
from jaxobs.observers.base import AbstractFlowObserver, AbstractStepObserver, Input
from jaxobs.observers.discrete_tracker import DiscreteTracker
from jaxobs.observers.tracker import Tracker
from jaxobs.plants import AbstractFlowPlant


class AbstractAlgebraicMap(Module):
    """x = phi(y, y', ..., y^(order), u, u', ..., u^(input_order)): paper 001, (39), for a plant `model` with one output."""

    model: eqx.AbstractVar[AbstractFlowPlant]
    if TYPE_CHECKING:  # a type checker takes an AbstractVar for a constructor argument
        order: ClassVar[int]
        input_order: ClassVar[int]
    else:
        order: eqx.AbstractVar[int]
        input_order: eqx.AbstractVar[int]

    @abc.abstractmethod
    def state(self, y: Float[Array, " d"], u: Float[Array, "m r"]) -> Float[Array, " n"]:
        """phi; y holds y, y', ... up to `order` or beyond, row i of u the derivatives of u_i up to `input_order` or beyond."""

    @abc.abstractmethod
    def denominators(self, y: Float[Array, " d"], u: Float[Array, "m r"]) -> Float[Array, " n"]:
        """D_i of x_i = N_i / D_i, each in its own units: phi is singular where one of them is zero. Ones if phi has none."""


class Algebraic(AbstractFlowObserver):
    """xhat = phi(etahat_1, ..., etahat_d, u, u', ...),    etahat = the estimate of `tracker`     (paper 001, (43) corrected).

    All arguments come from the tracker, y itself too, so that they share one delay (in the print, y and y' are taken as known,
    though only y is measured). There is no model in the loop, hence no asymptotic convergence: the bias is that of the tracker.
    It starts from the derivatives that y has at xhat0 under u = 0.

    phi: a map whose order is at most tracker.n - 1. u (m,), or (m, r + 1) with the derivatives, of which phi asks for
    phi.input_order. ValueError if the tracker has too few states, or the signal too few derivatives.
    """

    phi: AbstractAlgebraicMap
    tracker: Tracker
    p = 1

    def __check_init__(self):
        require_instance(self, "tracker", self.tracker, Tracker, "For samples there is DiscreteAlgebraic.")
        check_parts(self)

    @property
    def n(self):
        return self.phi.model.n

    @property
    def m(self):
        return self.phi.model.m

    def init(self, xhat0):
        return self.tracker.init(output_derivatives(self.phi.model, xhat0, self.tracker.n - 1))

    def flow(self, t, z, u, y):
        return self.tracker.flow(t, z, u, y)

    def estimate(self, t, z, u, y):
        return self.phi.state(self.tracker.estimate(t, z, u, y), with_derivatives(self.phi, u))

    def denominators(self, t, z, u, y) -> Float[Array, " n"]:
        """Those of phi at the present estimate of the derivatives: near 0 the estimate of the state means nothing."""
        return self.phi.denominators(self.tracker.estimate(t, z, u, y), with_derivatives(self.phi, u))

    def predict(self, t, z, u):
        return self.tracker.predict(t, z, u)


class DiscreteAlgebraic(AbstractStepObserver):
    """xhat_k = phi(etahat_k, u_k, ...) with the estimate etahat_k of a DiscreteTracker, which uses y_k; else as `Algebraic`."""

    phi: AbstractAlgebraicMap
    tracker: DiscreteTracker
    p = 1

    def __check_init__(self):
        require_instance(self, "tracker", self.tracker, DiscreteTracker, "In continuous time there is Algebraic.")
        check_parts(self)

    @property
    def n(self):
        return self.phi.model.n

    @property
    def m(self):
        return self.phi.model.m

    @property
    def dt(self):
        return self.tracker.dt

    def init(self, xhat0):
        return self.tracker.init(output_derivatives(self.phi.model, xhat0, self.tracker.n - 1))

    def step(self, k, z, u, y):
        return self.tracker.step(k, z, u, y)

    def estimate(self, k, z, u, y):
        return self.phi.state(self.tracker.estimate(k, z, u, y), with_derivatives(self.phi, u))

    def denominators(self, k, z, u, y) -> Float[Array, " n"]:
        """Those of phi at the present estimate of the derivatives: near 0 the estimate of the state means nothing."""
        return self.phi.denominators(self.tracker.estimate(k, z, u, y), with_derivatives(self.phi, u))

    def predict(self, k, z, u):
        return self.tracker.predict(k, z, u)


def output_derivatives(
    model: AbstractFlowPlant, x: Float[Array, " n"], order: int, u: Float[Array, "m r"] | None = None
) -> Float[Array, " _"]:
    """(y, y', ..., y^(order)) of a time-invariant plant with one output, where it is at x and its input and the input's
    derivatives are u (None: zero; those beyond the columns of u are zero):

        L_0 = h(x, u),    L_{i+1} = (d/dx) L_i f(x, u) + sum_r (d/du^(r)) L_i u^(r+1).
    """
    u = jnp.zeros((model.m, 1), x.dtype) if u is None else u
    zero = jnp.zeros((), x.dtype)

    def along(function):
        def derivative(x, u):
            after = jnp.concatenate([u[:, 1:], jnp.zeros_like(u[:, :1])], axis=1)
            return jax.jvp(function, (x, u), (model.flow(zero, x, u[:, 0]), after))[1]

        return derivative

    functions = [lambda x, u: model.h(x, u[:, 0])[0]]
    for _ in range(order):
        functions.append(along(functions[-1]))
    return jnp.stack([function(x, u) for function in functions])


def crossings(phi: AbstractAlgebraicMap, y: Float[Array, "T d"], u: Float[Array, "T m r"] | None = None) -> Bool[Array, " T"]:
    """Where phi is singular along a record: at k or between k - 1 and k a denominator vanishes (it is zero or changes sign).

    y: the derivatives, true or estimated; u: the input with its derivatives, zero if not given. An input with a crossing is a
    bad one for this trajectory (paper 001, definition 2); one without is good for this trajectory only.
    """
    u = jnp.zeros((y.shape[0], phi.model.m, phi.input_order + 1), y.dtype) if u is None else u
    sign = jnp.sign(jax.vmap(phi.denominators)(y, u))
    changed = jnp.concatenate([jnp.zeros_like(sign[:1], bool), sign[1:] != sign[:-1]])
    return jnp.any(changed | (sign == 0) | jnp.isnan(sign), axis=1)


def sensitivity(phi: AbstractAlgebraicMap, y: Float[Array, " d"], u: Float[Array, "m r"]) -> Float[Array, "n d"]:
    """d phi / d(y, y', ...): |error of x_i| <= sum_j |.|_ij |error of y^(j)| to first order. It has no bound where phi is
    singular.
    """
    return jax.jacfwd(phi.state)(y, u)


def with_derivatives(phi: AbstractAlgebraicMap, u: Input) -> Float[Array, "m r"]:
    """u as (m, r + 1), with as many derivatives as phi asks for."""
    u = u[:, None] if u.ndim == 1 else u
    if u.shape[1] <= phi.input_order:
        fix = "Give a signal that supplies derivatives, e.g. jaxobs.signals.Sine(order=1)."
        expected = f"{phi.input_order} of them, shape ({u.shape[0]}, {phi.input_order + 1})"
        raise refuse(phi, "u", f"{u.shape[1] - 1} derivatives of u", expected, fix)
    return u


def check_parts(observer: Algebraic | DiscreteAlgebraic) -> None:
    """What xhat = phi(etahat, u, u', ...) needs: tracker.n >= phi.order + 1, a model with one output, one float precision.

    ValueError otherwise, and if phi is no AbstractAlgebraicMap.
    """
    phi, tracker = observer.phi, observer.tracker
    fix = "e.g. jaxobs.observers.DuffingRoot(jaxobs.plants.Duffing()), or the map of jaxobs.designs.eliminate."
    require_instance(observer, "phi", phi, AbstractAlgebraicMap, fix)
    if phi.model.p != 1:
        raise refuse(observer, "phi", f"a model with p = {phi.model.p} outputs", "one output", "Choose one of them.")
    if tracker.n <= phi.order:
        expected = f"tracker.n >= {phi.order + 1}: the map uses y and {phi.order} derivatives"
        raise refuse(
            observer, "tracker", f"n = {tracker.n} states", expected, "More states follow fast signals with less bias."
        )
    if dtype_of(phi) != dtype_of(tracker):
        raise refuse(
            observer,
            "phi",
            f"precision {dtype_of(phi)}",
            f"the tracker's {dtype_of(tracker)}",
            "Use jaxobs.astype(part, dtype).",
        )
