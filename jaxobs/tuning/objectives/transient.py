"""What a wrong first guess costs, without noise: the peak of the transient, its settling time, its squared error."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs import linalg
from jaxobs._module import Module, Scalar, concrete, param, refuse, require_shape
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant
from jaxobs.tuning.linear_error import LinearError, input_covariance, period
from jaxobs.tuning.objectives._points import check_points, linear_errors, root, weight_matrix
from jaxobs.tuning.objectives._response import Settled, response, samples, settled

REFINEMENTS = 6  # of the time of the peak: its distance enters the peak squared, and its gradient as it is


class Peak(Module):
    """max_t |E e(t)|, e = xhat - x of the linear error from e(0), the largest over operating points and over the rows of
    `initial` (k, n); if that is not given, over all e(0) with |e(0)| = 1.

    plant, points (S, n), inputs (S, m), weight: as in SteadyNoise. The gradient is that of the maximiser (envelope theorem):
    exact where the maximiser is unique. Infinite where the error is not stable. A step observer's first 4,096 samples count.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    points: Float[Array, "S n"] = param()
    initial: Float[Array, "k n"] | None = param(default=None)
    weight: Float[Array, "..."] | None = param(default=None)
    inputs: Float[Array, "S m ..."] | None = param(default=None)

    def __check_init__(self):
        check_points(self)
        _check_initial(self)

    @eqx.filter_jit
    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        errors = linear_errors(self, observer)
        return jnp.max(jax.vmap(self._at)(errors))

    def _at(self, error: LinearError) -> Scalar:
        one = settled(error, weight_matrix(self.weight, error.output.shape[0], error.f.dtype))
        return one.size(_peak(one, self.initial, error.step)[0])


class Settling(Module):
    """The last time [s] at which |E e(t)| exceeds band * max_t |E e(t)|, from the rows of `initial` (k, n), the unit errors of
    each state if not given; the latest over rows and operating points.

    The crossing is found to rounding and its derivative is that of the implicit function: almost everywhere, for it jumps
    where a later swing touches the band. For a step observer it is interpolated between samples; infinite where it lies beyond
    4,096 of them, or where the error is not stable. band in ]0, 1[.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    points: Float[Array, "S n"] = param()
    initial: Float[Array, "k n"] | None = param(default=None)
    band: Scalar = param(default=0.05)
    weight: Float[Array, "..."] | None = param(default=None)
    inputs: Float[Array, "S m ..."] | None = param(default=None)

    def __check_init__(self):
        check_points(self)
        _check_initial(self)
        known = concrete(self.band)
        if known is not None and not 0 < known < 1:
            raise refuse(self, "band", known, "a number between 0 and 1", "It is a share of the peak.")

    @eqx.filter_jit
    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        errors = linear_errors(self, observer)
        dt = period("Settling", observer) if errors.step else None

        def at(error: LinearError) -> Scalar:
            one = settled(error, weight_matrix(self.weight, error.output.shape[0], error.f.dtype))
            rows = jnp.eye(error.output.shape[0], dtype=error.f.dtype) if self.initial is None else self.initial
            if dt is None:
                return one.size(jnp.max(jax.vmap(lambda row: _crossing(one, row, self.band))(rows)))
            return one.size(jnp.max(jax.vmap(lambda row: _interpolated(one, row, self.band))(rows)) * dt)

        return jnp.max(jax.vmap(at)(errors))


class SquaredError(Module):
    """The integral of |E e(t)|^2 over all times from e(0), by a Lyapunov equation: the mean over the rows of `initial` (k, n)
    and over operating points. If `initial` is not given, over random e(0) of covariance I: the sum over the unit errors.

    A step observer's is the sum over its samples, times its period. Infinite where the error is not stable.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    points: Float[Array, "S n"] = param()
    initial: Float[Array, "k n"] | None = param(default=None)
    weight: Float[Array, "..."] | None = param(default=None)
    inputs: Float[Array, "S m ..."] | None = param(default=None)

    def __check_init__(self):
        check_points(self)
        _check_initial(self)

    @eqx.filter_jit
    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        errors = linear_errors(self, observer)
        dt = period("SquaredError", observer) if errors.step else 1.0

        def at(error: LinearError) -> Scalar:
            rows = self.initial
            factor = error.start if rows is None else error.start @ rows.T / float(np.sqrt(rows.shape[0]))
            e = weight_matrix(self.weight, error.output.shape[0], error.f.dtype)
            found, stable = input_covariance(error, factor)
            return jnp.where(stable, jnp.sum((e @ found) * e), jnp.inf)

        return jnp.mean(jax.vmap(at)(errors)) * dt


def _check_initial(objective: Any) -> None:
    if objective.initial is not None:
        fix = "One row for each first error xhat(0) - x(0)."
        rows = np.shape(objective.initial)[:1] or (1,)
        require_shape(objective, "initial", objective.initial, (*rows, objective.plant.n), fix)


def _peak(one: Settled, initial: Float[Array, "k n"] | None, step: bool) -> tuple[Scalar, Scalar]:
    """(the peak, its time or its sample)."""
    frozen = jax.tree.map(jax.lax.stop_gradient, one)
    ts, path = _path(frozen, frozen.start if initial is None else frozen.start @ initial.T, step)
    seen = frozen.output @ path  # (K, s, n or k)
    if initial is None:
        sizes = jnp.linalg.norm(seen, axis=(1, 2)) if seen.shape[1] == 1 else jnp.linalg.norm(seen, 2, axis=(1, 2))
        at, row = jnp.argmax(sizes), 0
    else:
        sizes = jnp.linalg.norm(seen, axis=1)
        at, row = jnp.unravel_index(jnp.argmax(sizes), sizes.shape)

    def worst(seen: Float[Array, "s _"]) -> Float[Array, " n"]:
        """The first error of the largest response, where the responses to `initial`, or to all units, are these."""
        return jnp.linalg.svd(seen, full_matrices=False)[2][0] if initial is None else initial[row]

    if step:
        x0 = one.start @ worst(seen[at])
        return root(jnp.sum((one.output @ _power(one.f, at, x0)) ** 2)), at.astype(x0.dtype)
    low, high = ts[jnp.maximum(at - 1, 0)], ts[jnp.minimum(at + 1, ts.shape[0] - 1)]

    def closer(_, time: Scalar) -> Scalar:
        """A Newton step towards |E e|' = 0, from the first error that is worst now."""
        moved = linalg.expm(frozen.f * time) @ frozen.start
        size, slope, bend = _derivatives(frozen, moved @ worst(frozen.output @ moved))
        good = (bend < 0) & (size > 0)
        return jnp.clip(time - jnp.where(good, slope / jnp.where(good, bend, 1), 0), low, high)

    time = jax.lax.fori_loop(0, REFINEMENTS, closer, ts[at])
    x0 = one.start @ worst(frozen.output @ linalg.expm(frozen.f * time) @ frozen.start)
    return root(jnp.sum((one.output @ path_at(one, time, x0)) ** 2)), time


def _path(one: Settled, b: Float[Array, "N r"], step: bool) -> tuple[Array, Array]:
    if step:
        path = samples(one.f, b)
        return jnp.arange(path.shape[0], dtype=one.f.dtype), path
    return response(one.f, b, one.horizon)


def path_at(one: Settled, t: Scalar, x0: Float[Array, " N"]) -> Float[Array, " N"]:
    return linalg.expm(one.f * t) @ x0


def _derivatives(one: Settled, x: Float[Array, " N"]) -> tuple[Scalar, Scalar, Scalar]:
    """|E e|^2 / 2 and its first two derivatives in time."""
    rate = one.f @ x
    e, de, dde = one.output @ x, one.output @ rate, one.output @ (one.f @ rate)
    return e @ e / 2, e @ de, de @ de + e @ dde


def _power(f: Float[Array, "N N"], k: Any, x: Float[Array, " N"]) -> Float[Array, " N"]:
    """f^k x for a traced k < 2^12, by the binary digits of k."""

    def digit(carry, bit):
        power, x = carry
        return (power @ power, jnp.where((k >> bit) & 1 == 1, power @ x, x)), None

    return jax.lax.scan(digit, (f, x), jnp.arange(12))[0][1]


def _crossing(one: Settled, row: Float[Array, " n"], band: Scalar) -> Scalar:
    frozen = jax.tree.map(jax.lax.stop_gradient, one)
    ts, path = _path(frozen, (frozen.start @ row)[:, None], False)
    sizes = jnp.linalg.norm((frozen.output @ path)[:, :, 0], axis=1)
    level = band * _peak(one, row[None], False)[0]
    fixed = jax.lax.stop_gradient(level)
    outside = sizes > fixed
    k = sizes.shape[0] - 1 - jnp.argmax(outside[::-1])
    after = jnp.minimum(k + 1, sizes.shape[0] - 1)
    low, high = ts[k], ts[after]

    def gap(one: Settled, t: Scalar) -> tuple[Scalar, Scalar]:
        """log |E e(t)| and its derivative in time."""
        size, slope, _ = _derivatives(one, path_at(one, t, one.start @ row))
        return jnp.log(2 * size) / 2, slope / (2 * size)

    share = jnp.log(sizes[k] / fixed) / jnp.log(sizes[k] / sizes[after])
    time = low + (high - low) * share
    for _ in range(2):
        value, slope = gap(frozen, time)
        time = jnp.clip(time - (value - jnp.log(fixed)) / slope, low, high)
    slope = gap(frozen, time)[1]
    # One Newton step on the traced arguments: its value is the crossing's, its derivative the implicit one.
    return time - (gap(one, time)[0] - jnp.log(level)) / slope


def _interpolated(one: Settled, row: Float[Array, " n"], band: Scalar) -> Scalar:
    sizes = jnp.sqrt(jnp.maximum(jnp.sum((one.output @ samples(one.f, one.start @ row[:, None])) ** 2, axis=(1, 2)), 1e-300))
    level = band * jnp.max(sizes)
    outside = sizes > level
    k = sizes.shape[0] - 1 - jnp.argmax(outside[::-1])
    after = jnp.minimum(k + 1, sizes.shape[0] - 1)
    crossing = k.astype(sizes.dtype) + (sizes[k] - level) / jnp.maximum(sizes[k] - sizes[after], 1e-300)
    return jnp.where(outside[-1], jnp.inf, crossing)
