"""Several objectives as one, with a cap on the fastest pole."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Module, OptionalScalar, Scalar, param, refuse, require_nonnegative, require_positive, require_shape
from jaxobs.observers import AbstractFlowObserver, Sampled
from jaxobs.plants import AbstractFlowPlant
from jaxobs.tuning.linear_error import linearise

SQUARINGS, STEPS, SWEEPS = 6, 8, 10  # of F: K = 2^6; of Newton; of the balancing


class Weighted(Module):
    """sum_i weights_i terms_i(observer, key) + strength * max(0, log(rho / fastest))^2 at the worst operating point,

    rho the root of mean_{K <= j < 2K} |(F / rho)^j|^2 = 1 with K = 64 and the Frobenius norm, F that of the linear error in
    balanced coordinates. As in Gelfand's formula rho is never less than the largest |pole|. It is more by below 1 % for a
    complex pair, by 4 % for five Butterworth poles, by 6 % for two and 26 % for five poles that meet: it is a smooth function
    of the gains also there, and the poles are not. Five poles that meet make it steep; let a search start elsewhere.

    terms: objectives; weights: one number each, all one if not given. fastest [1/s] with `plant` and `points` (S, n): no
    penalty at or below it, so an optimum that respects the cap is not moved; one that does not ends
    slightly above, by a factor of about exp(slope of the terms / (2 strength)). A flow observer, or Sampled of one.
    """

    terms: tuple[Any, ...]
    weights: Float[Array, " _"] | None = param(default=None)
    fastest: OptionalScalar = param(default=None)
    plant: AbstractFlowPlant | None = None
    points: Float[Array, "S n"] | None = param(default=None)
    inputs: Float[Array, "S m ..."] | None = param(default=None)
    strength: Scalar = param(default=100.0)

    def __check_init__(self):
        if not isinstance(self.terms, tuple) or not self.terms or not all(callable(term) for term in self.terms):
            fix = "Give a tuple: Weighted((SteadyNoise(...), Peak(...)), [1.0, 0.1])."
            raise refuse(self, "terms", type(self.terms).__name__, "a tuple of objectives", fix)
        if self.weights is not None:
            require_shape(self, "weights", self.weights, (len(self.terms),), "One weight for each term.")
            require_nonnegative(self, "weights", self.weights, "Objectives are minimised.")
        require_nonnegative(self, "strength", self.strength, "It scales the penalty.")
        if self.fastest is None:
            return
        require_positive(self, "fastest", self.fastest, "It caps |pole| in 1/s.")
        if self.plant is None or self.points is None:
            fix = "The poles are those of the linear error there: plant=..., points=[[0.0, 0.0]]."
            raise refuse(self, "fastest", "a cap without plant and points", "both", fix)
        if np.ndim(self.points) != 2 or np.shape(self.points)[1] != self.plant.n:
            fix = "One row for each operating point."
            raise refuse(self, "points", f"shape {np.shape(self.points)}", f"(any, {self.plant.n})", fix)

    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        values = [term(observer, key) for term in self.terms]
        weights = [1.0] * len(values) if self.weights is None else list(self.weights)
        total = sum((w * value for w, value in zip(weights, values, strict=True)), start=jnp.zeros_like(values[0]))
        if self.fastest is None:
            return total
        excess = jnp.log(fastest_pole(observer, self.plant, self.points, self.inputs) / self.fastest)
        return total + self.strength * jnp.maximum(excess, 0) ** 2


def fastest_pole(observer: Any, plant: Any, points: Any, inputs: Any = None) -> Scalar:
    """The smooth upper bound [1/s] of the largest |pole| that `Weighted` caps, the largest over operating points."""
    inside = observer.observer if isinstance(observer, Sampled) else observer
    if not isinstance(inside, AbstractFlowObserver):
        fix = "A step observer's fast poles lie near 0 and cost nothing: leave the cap out."
        raise refuse("Weighted", "observer", type(observer).__name__, "a flow observer, or Sampled of one", fix)
    if inputs is None:
        f = jax.vmap(lambda x: linearise(inside, plant, x).f)(points)
    else:
        f = jax.vmap(lambda x, u: linearise(inside, plant, x, u).f)(points, inputs)
    return jnp.max(jax.vmap(spectral_bound)(f))


def spectral_bound(f: Float[Array, "N N"]) -> Scalar:
    """The r with mean_{K <= j < 2K} |(f / r)^j|^2 = 1, never less than the largest |pole| of an f that is not nilpotent.

    Gelfand's formula starts Newton's method on log r; its last step is on the traced arguments, which makes the derivative that
    of the implicit function. One power alone would not do: where poles are complex its norm turns with their phase.
    """
    f = _balanced(f)
    frozen, one = jax.lax.stop_gradient(f), jnp.eye(f.shape[0], dtype=f.dtype)

    def level(f: Float[Array, "N N"], log_r: Scalar) -> Scalar:
        def double(pair, _):
            power, total = pair  # total = sum of |(f / r)^i|^2 as a matrix, i below the power's exponent
            return (power @ power, total + power @ total @ power.T), None

        power, total = jax.lax.scan(double, (f * jnp.exp(-log_r), one), None, length=SQUARINGS)[0]
        return jnp.log(jnp.sum((power @ total) * power) / 2**SQUARINGS)

    def square(pair, k):
        power, log_size = pair
        size = jnp.sqrt(jnp.sum(power**2))
        return ((power / size) @ (power / size), log_size + jnp.log(size) / 2**k), None

    log_r = jax.lax.scan(square, (frozen, jnp.zeros((), f.dtype)), jnp.arange(SQUARINGS + 1, dtype=f.dtype))[0][1]

    def newton(_, log_r: Scalar) -> Scalar:
        value, slope = jax.jvp(lambda log_r: level(frozen, log_r), (log_r,), (jnp.ones_like(log_r),))
        return log_r - value / slope

    log_r = jax.lax.fori_loop(0, STEPS, newton, log_r)
    slope = jax.jvp(lambda log_r: level(frozen, log_r), (log_r,), (jnp.ones_like(log_r),))[1]
    return jnp.exp(log_r - level(f, log_r) / slope)


def _balanced(f: Float[Array, "N N"]) -> Float[Array, "N N"]:
    """Osborne's iteration without rounding, a fixed number of sweeps: a smooth function of f, for rho depends on the scale."""
    n = f.shape[0]
    off = f**2 * (1 - jnp.eye(n, dtype=f.dtype))

    def sweep(log_d, _):
        for i in range(n):
            column = jnp.sum(off[:, i] * jnp.exp(2 * (log_d[i] - log_d)))
            row = jnp.sum(off[i] * jnp.exp(2 * (log_d - log_d[i])))
            both = (column > 0) & (row > 0)
            log_d = log_d.at[i].add(jnp.log(jnp.where(both, row, 1) / jnp.where(both, column, 1)) / 4)
        return log_d, None

    log_d = jax.lax.scan(sweep, jnp.zeros((n,), f.dtype), None, length=SWEEPS)[0]
    return f * jnp.exp(log_d[None, :] - log_d[:, None])
