"""What passes from the measurement to the estimate: the worst case, and how much of the spectrum."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Module, Scalar, param, refuse, require_integer, static
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant
from jaxobs.tuning.linear_error import LinearError, input_covariance, period
from jaxobs.tuning.objectives._points import check_points, linear_errors, weight_matrix
from jaxobs.tuning.objectives._response import response, samples, settled

FREQUENCIES, HALVINGS = 1024, 50  # looked at, and then halved between two of them


class L1Gain(Module):
    """max_i sum_j int_0^inf |g_ij(t)| dt = max_i sup |(E e)_i| over all |v_j(t)| <= 1, after the transient: g is the impulse
    response from v to E (xhat - x). The largest over operating points.

    noise: V, or the largest size of the measurement noise; process: W, or that of the disturbance. Each interval of the time
    grid counts as the difference of the step response at its ends, which is exact between sign changes of g; an interval with
    one is cut there. The grid has 256 samples in each octave of time, up to 16 time constants of the slowest pole: beyond
    them about 1e-7 of the sum is left out. A step observer's is a sum over 4,096 samples. Infinite where it is not stable.
    Source: Dahleh and Diaz-Bobillo, Control of Uncertain Systems (1995), chapter 2.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    points: Float[Array, "S n"] = param()
    noise: Float[Array, "..."] = param(default=1.0)
    process: Float[Array, "..."] | None = param(default=None)
    weight: Float[Array, "..."] | None = param(default=None)
    inputs: Float[Array, "S m ..."] | None = param(default=None)

    def __check_init__(self):
        check_points(self)

    @eqx.filter_jit
    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        errors = linear_errors(self, observer, self.process, self.noise)
        return jnp.max(jax.vmap(self._at)(errors))

    def _at(self, error: LinearError) -> Scalar:
        e = weight_matrix(self.weight, error.output.shape[0], error.f.dtype)
        one = settled(error, e)
        if error.step:
            sums = jnp.sum(jnp.abs(one.output @ samples(one.f, one.driven)), axis=0)
        else:
            ts, path = response(one.f, one.driven, one.horizon)
            sums = _variation(one.output, one.f, ts, path)
        return one.size(jnp.max(jnp.sum(sums, axis=1) + jnp.sum(jnp.abs(one.direct), axis=1)))


def _variation(output: Array, f: Array, ts: Float[Array, " K"], path: Float[Array, "K N r"]) -> Float[Array, "s r"]:
    """int |output x(t)| dt for x' = f x, sampled as path: the total variation of the integral of output x."""
    integral = output @ jnp.linalg.solve(f, path - path[0])
    impulse, slope, bend = output @ path, output @ (f @ path), output @ (f @ (f @ path))
    sign = jax.lax.stop_gradient(jnp.sign(impulse))
    left, right = jax.lax.stop_gradient((impulse[:-1], impulse[1:]))
    spacing = jnp.diff(ts)[:, None, None]
    changes = left * right < 0
    delta = jnp.where(changes, left / jnp.where(changes, left - right, 1), 0) * spacing
    # The root of the expansion from the left: there the integral is stationary, so its derivative needs none of the root.
    first, second = jax.lax.stop_gradient((slope[:-1], bend[:-1]))
    for _ in range(2):
        rate = jnp.where(changes, first + delta * second, 1)
        delta = jnp.where(changes, delta - (left + delta * (first + delta / 2 * second)) / rate, 0)
    delta = jnp.clip(delta, 0, spacing)
    middle = integral[:-1] + delta * (impulse[:-1] + delta / 2 * (slope[:-1] + delta / 3 * bend[:-1]))
    cut = sign[:-1] * (middle - integral[:-1]) + sign[1:] * (integral[1:] - middle)
    whole = jnp.where(sign[:-1] == 0, sign[1:], sign[:-1]) * (integral[1:] - integral[:-1])
    return jnp.sum(jnp.where(changes, cut, whole), axis=0)


class NoiseBandwidth(Module):
    """int_0^inf |T(j w)|^2 dw / (2 pi |T(0)|^2) [Hz], T from y_j to xhat_i (j = `output`, i = `state`, from 0): white noise
    through an ideal low pass of this bandwidth has the variance that it has in xhat_i. The largest over operating points.

    For states with T(0) != 0, as a rule the measured ones; infinite otherwise, and where the error is not stable. By a Lyapunov
    equation; for a step observer up to its Nyquist frequency.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    points: Float[Array, "S n"] = param()
    inputs: Float[Array, "S m ..."] | None = param(default=None)
    state: int = static(default=0)
    output: int = static(default=0)

    def __check_init__(self):
        _check_channel(self)

    @eqx.filter_jit
    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        errors = linear_errors(self, observer)
        dt = period("NoiseBandwidth", observer) if errors.step else None

        def at(error: LinearError) -> Scalar:
            h, g, direct = _channel(error, self.state, self.output)
            found, stable = input_covariance(error, g[:, None])
            energy = found[self.state, self.state] + (direct**2 if error.step else jnp.where(direct == 0, 0, jnp.inf))
            one = jnp.eye(error.f.shape[0], dtype=error.f.dtype)
            steady = direct + h @ jnp.linalg.solve(one - error.f if error.step else -error.f, g)
            return jnp.where(stable, energy / (2 * steady**2), jnp.inf) / (1.0 if dt is None else dt)

        return jnp.max(jax.vmap(at)(errors))


class Bandwidth(Module):
    """The highest frequency [Hz] at which |T(j w)|^2 = |T(0)|^2 / 2, T from y_j to xhat_i (j = `output`, i = `state`, from 0);
    the largest over operating points.

    Found on 1,024 frequencies between the poles' (100 times further out on both sides), then by bisection; its derivative is
    that of the implicit function. For states with T(0) != 0. Infinite where |T| does not fall so far (to the Nyquist
    frequency for a step observer), and where the error is not stable.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    points: Float[Array, "S n"] = param()
    inputs: Float[Array, "S m ..."] | None = param(default=None)
    state: int = static(default=0)
    output: int = static(default=0)

    def __check_init__(self):
        _check_channel(self)

    @eqx.filter_jit
    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        errors = linear_errors(self, observer)
        dt = period("Bandwidth", observer) if errors.step else None
        found = jax.vmap(lambda error: self._at(error))(errors)
        return jnp.max(found) / (2 * np.pi) / (1.0 if dt is None else dt)

    def _at(self, error: LinearError) -> Scalar:
        """In rad/s, or rad a sample."""
        one = settled(error, jnp.eye(error.output.shape[0], dtype=error.f.dtype))
        h, g, direct = one.output[self.state], one.driven[:, self.output], one.direct[self.state, self.output]
        poles = jnp.abs(jnp.linalg.eigvals(jax.lax.stop_gradient(one.f)))
        low, high = jnp.min(poles) / 100, jnp.max(poles) * 100
        low, high = (jnp.full_like(low, 1e-6), jnp.full_like(high, np.pi)) if error.step else (low, high)

        def level(log_w: Scalar, parts: Any) -> Scalar:
            """log |T|^2 - log |T(0)|^2 + log 2, zero at the edge."""
            f, h, g, direct = parts
            unit = jnp.eye(f.shape[0], dtype=f.dtype)
            w = jnp.exp(log_w)
            zero = jnp.zeros_like(w)
            place = jax.lax.complex(jnp.cos(w), jnp.sin(w)) if error.step else jax.lax.complex(zero, w)
            matrix = place * unit.astype(place.dtype) - f.astype(place.dtype)
            t = direct.astype(place.dtype) + h.astype(place.dtype) @ jnp.linalg.solve(matrix, g.astype(place.dtype))
            steady = direct + h @ jnp.linalg.solve((unit if error.step else 0 * unit) - f, g)
            return jnp.log(jnp.real(t) ** 2 + jnp.imag(t) ** 2) - jnp.log(steady**2) + jnp.log(jnp.asarray(2, w.dtype))

        parts = (one.f, h, g, direct)
        frozen = jax.lax.stop_gradient(parts)
        grid = jnp.linspace(jnp.log(low), jnp.log(high), FREQUENCIES, dtype=one.f.dtype)
        passes = jax.vmap(level, in_axes=(0, None))(grid, frozen) > 0
        k = FREQUENCIES - 1 - jnp.argmax(passes[::-1])

        def halve(_, bracket):
            middle = (bracket[0] + bracket[1]) / 2
            above = level(middle, frozen) > 0
            return jnp.where(above, middle, bracket[0]), jnp.where(above, bracket[1], middle)

        edge = jax.lax.fori_loop(0, HALVINGS, halve, (grid[k], grid[jnp.minimum(k + 1, FREQUENCIES - 1)]))[0]
        slope = jax.jvp(lambda w: level(w, frozen), (edge,), (jnp.ones_like(edge),))[1]
        # One Newton step on the traced arguments: its value is the edge's, its derivative the implicit one.
        moved = edge - (level(edge, parts) - jax.lax.stop_gradient(level(edge, frozen))) / slope
        return one.size(jnp.where(passes[-1] | ~jnp.any(passes), jnp.inf, jnp.exp(moved)))


def _channel(error: LinearError, state: int, output: int) -> tuple[Array, Array, Array]:
    return error.output[state], error.noise[:, output], error.direct[state, output]


def _check_channel(objective: Any) -> None:
    plant = objective.plant
    check_points(objective)
    for name, size in (("state", plant.n), ("output", plant.p)):
        require_integer(objective, name, getattr(objective, name), 0, "They are counted from 0.")
        if getattr(objective, name) >= size:
            raise refuse(objective, name, getattr(objective, name), f"less than {size}", "They are counted from 0.")
