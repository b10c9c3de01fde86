"""A plant in the coordinates z = (h, L_f h, ..., L_f^{n-1} h): a chain, or triangular, where these are coordinates at all.

Source: Gauthier, Hammouri and Othman, A simple observer for nonlinear systems, IEEE TAC 37 (1992); Isidori, Nonlinear Control
Systems, 1995, chapters 4 and 5; Gauthier and Kupka, Deterministic Observation Theory and Applications, 2001.
"""

import abc
from typing import TYPE_CHECKING, Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Module, dtype_of, param, refuse, require_instance, require_integer, require_shape, static
from jaxobs.linalg import shift
from jaxobs.plants._depends import depends, require_timeless
from jaxobs.plants.base import AbstractFlowPlant
from jaxobs.plants.forms import AbstractChain, AbstractTriangular
from jaxobs.plants.lie import observability_map

HALVINGS = 8  # Newton steps of 1, 1/2, ..., 2^-7 are tried side by side
FIX = "jaxobs.structure.normal_form(plant, states=..., inputs=...) chooses the form."


class AbstractNormalForm(Module):
    """z = Phi(x) = (h, L_f h, ..., L_f^{n-1} h) at u = 0, and back: a mixin, before the form among the bases.

    Phi depends on the plant's parameters, and so does all that is made of it: gradients with respect to them go through.
    """

    if TYPE_CHECKING:
        plant: ClassVar[AbstractFlowPlant]
        start: ClassVar[Array]
        max_steps: ClassVar[int]
    else:
        plant: eqx.AbstractVar[AbstractFlowPlant]
        start: eqx.AbstractVar[Array]
        max_steps: eqx.AbstractVar[int]

    @property
    def n(self) -> int:
        return self.plant.n

    @property
    def m(self) -> int:
        return self.plant.m

    def to_normal(self, x: Float[Array, " n"]) -> Float[Array, " n"]:
        """z = Phi(x)."""
        return observability_map(self.plant, x, jnp.zeros((self.m,), x.dtype))

    def jacobian(self, x: Float[Array, " n"]) -> Float[Array, "n n"]:
        """dPhi/dx."""
        return jax.jacfwd(self.to_normal)(x)

    def pushed(self, x: Float[Array, " n"], u: Float[Array, "*m"]) -> Float[Array, " n"]:
        """z' = dPhi/dx f(x, u), where the state is x."""
        return jax.jvp(self.to_normal, (x,), (self.plant.flow(jnp.zeros((), x.dtype), x, u),))[1]

    def to_original(self, z: Float[Array, " n"], start: Float[Array, " n"] | None = None) -> Float[Array, " n"]:
        """x with Phi(x) = z, by damped Newton from `start` (the form's own if not given); NaN where it does not converge.

        Of the steps 1, 1/2, ..., 2^-7 along the Newton direction the one is taken after which the next correction is least.
        Done when a step is below sqrt(eps) of 1 + |x|, at most max_steps. Where Phi is not one to one (outside the region
        in which its Jacobian is regular) another solution may be found: start near the one that is meant. Derivatives are
        those of the implicit function, dx/dz = (dPhi/dx)^-1, not those of the iteration.
        """
        first = jnp.asarray(self.start if start is None else start, z.dtype)

        def residual(x):
            return self.to_normal(x) - z

        def solve(g, x):
            return _newton(g, x, self.max_steps)

        def tangent(g, y):
            return jnp.linalg.solve(jax.jacfwd(g)(jnp.zeros_like(y)), y)

        x, converged = jax.lax.custom_root(residual, first, solve, tangent, has_aux=True)
        return jnp.where(converged > 0, x, jnp.full_like(x, jnp.nan))

    @abc.abstractmethod
    def known(self, x: Float[Array, " n"]) -> AbstractFlowPlant:
        """The form at a state whose original coordinates are known: its flow needs no inverse."""


class NormalChain(AbstractNormalForm, AbstractChain):
    """z_i' = z_{i+1}, z_n' = phi(z, u) = d(L_f^{n-1} h)/dx f(x, u) at x = Phi^-1(z), y = z_1.

    plant: one output, y = h(x), whose input enters y^(n) first (relative degree n) or that has none. start (n,): where the
    inverse begins its search, in the coordinates of the plant.
    """

    plant: AbstractFlowPlant
    start: Float[Array, " n"] = param()
    max_steps: int = static(default=50)

    def __check_init__(self):
        _check(self)

    def phi(self, x, u):
        return self.pushed(self.to_original(x), u)[-1]

    def known(self, x):
        return _KnownState(self, x)


class NormalTriangular(AbstractNormalForm, AbstractTriangular):
    """z_i' = z_{i+1} + g_i(z_1, ..., z_i, u), y = z_1: a plant that is observable for every input, x = Phi^-1(z).

    g(z, u) = dPhi/dx f(x, u) - (z_2, ..., z_n, 0), whose i-th component knows z_1, ..., z_i only (Gauthier, Hammouri and
    Othman 1992); its derivatives along the others are taken as the zeros that they are. plant, start: as for `NormalChain`.
    """

    plant: AbstractFlowPlant
    start: Float[Array, " n"] = param()
    max_steps: int = static(default=50)

    def __check_init__(self):
        _check(self)

    def a(self, u):
        return jnp.ones((self.n - 1,), self.start.dtype)

    def g(self, x, u):
        lower = jnp.tril(jnp.ones((self.n, self.n), bool))

        def component(seen, i):
            z = jnp.where(seen, x, jax.lax.stop_gradient(x))
            return (self.pushed(self.to_original(z), u) - shift(jax.lax.stop_gradient(x)))[i]

        return jax.vmap(component)(lower, jnp.arange(self.n))

    def known(self, x):
        return _KnownState(self, x)


class _KnownState(AbstractFlowPlant):
    """A normal form at the state with original coordinates x: z' = dPhi/dx f(x, u), whatever z is said to be; y = z_1."""

    form: NormalChain | NormalTriangular
    x: Float[Array, " n"] = param()
    p = 1

    @property
    def n(self):
        return self.form.n

    @property
    def m(self):
        return self.form.m

    def flow(self, t, x, u):
        return self.form.pushed(self.x, u)

    def h(self, x, u):
        return x[:1]

    def disturbance_matrix(self):
        return self.form.disturbance_matrix()


def _newton(g: Any, x: Array, max_steps: int) -> tuple[Array, Array]:
    """(x, 1.0 if converged): damped by the natural level function |J^-1 g| (Deuflhard, Newton Methods, 2004, section 3.3)."""
    small = jnp.sqrt(jnp.finfo(x.dtype).eps)
    lengths = jnp.asarray(2.0, x.dtype) ** -jnp.arange(HALVINGS, dtype=x.dtype)

    def body(state):
        k, x, _ = state
        inverse = jnp.linalg.inv(jax.jacfwd(g)(x))
        step = -inverse @ g(x)
        trials = x + lengths[:, None] * step
        levels = jnp.sum(jax.vmap(lambda trial: inverse @ g(trial))(trials) ** 2, axis=1)
        best = jnp.argmin(jnp.where(jnp.isfinite(levels), levels, jnp.inf))
        return k + 1, trials[best], jnp.max(jnp.abs(step)) <= small * (1 + jnp.max(jnp.abs(x)))

    def going(state):
        k, x, done = state
        return (k < max_steps) & ~done & jnp.all(jnp.isfinite(x))

    _, x, done = jax.lax.while_loop(going, body, (jnp.asarray(0), x, jnp.asarray(False)))
    return x, (done & jnp.all(jnp.isfinite(x))).astype(x.dtype)


def _check(form: NormalChain | NormalTriangular) -> None:
    require_instance(form, "plant", form.plant, AbstractFlowPlant, "Build it first, e.g. jaxobs.plants.from_function(...).")
    if form.plant.p != 1:
        raise refuse(form, "plant", f"a plant with {form.plant.p} outputs", "one output", "Choose the one that tells most.")
    require_shape(form, "start", form.start, (form.plant.n,), "A state of the plant, near those that are met.")
    require_autonomous(form, form.plant)
    require_integer(form, "max_steps", form.max_steps, 1, "It counts the Newton steps of the inverse.")


def require_autonomous(owner: Any, plant: AbstractFlowPlant) -> None:
    """ValueError for a plant whose flow knows the time or whose output the input: Phi(x) = (h, L_f h, ...) has neither."""
    require_timeless(owner, plant)
    x, u = jnp.zeros((plant.n,), dtype_of(plant)), jnp.zeros((plant.m,), dtype_of(plant))
    if plant.m and depends(plant.h, 1, x, u):
        fix = "Subtract what the input adds to the output, and leave it out of h."
        raise refuse(owner, "plant", "y = h(x, u), which knows the input", "y = h(x)", fix)
