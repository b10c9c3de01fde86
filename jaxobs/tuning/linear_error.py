"""The linear error dynamics of any observer at an operating point, and its covariance under noise.

Both are smooth functions of the observer's numbers, for a search by gradient: they answer in microseconds what a Monte Carlo
study answers in seconds, to first order in the noise.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxobs import linalg
from jaxobs._module import Module, Numbers, Scalar, as_param, dtype_of, refuse, require_instance, require_positive, static
from jaxobs.integrators import RK4, AbstractIntegrator, Field
from jaxobs.observers import AbstractStepObserver, Observer
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant
from jaxobs.tuning._live_state import LiveState

CLOCK = 1e6  # seconds, or steps, that the clock inside an observer has run: a gain that opens with time is then open


class LinearError(Module):
    """eps = z - init(x) and xhat - x near an operating point, z the live part of the observer's state (N numbers):

        eps' = F eps + noise v + process w + drift,    xhat - x = output eps + direct v + offset       (eps+ for `step`)

    for x' = f(x, u) + W w and y = h(x, u) + V v. F = f (N, N), noise = d flow/dy V (N, p), process = -(d init/dx) W (N, m),
    output = d estimate/dz (n, N), direct = d estimate/dy V (n, p), start = d init/dx (N, n): eps(0) = start e for a guess that
    is wrong by e.

    drift (N,) is what moves the estimate away from the truth without any noise, flow(init(x), h(x)) - (d init/dx) f(x), and
    mismatch (N, n) its slope, F X + G C - X A where X = d init/dx is constant; offset (n,) is estimate(init(x)) - x. All three
    vanish for an observer whose model is the plant; they do not for a tracker, or for a model with other parameters.
    """

    f: Float[Array, "N N"]
    noise: Float[Array, "N p"]
    process: Float[Array, "N m"]
    output: Float[Array, "n N"]
    direct: Float[Array, "n _"]
    start: Float[Array, "N n"]
    drift: Float[Array, " N"]
    mismatch: Float[Array, "N n"]
    offset: Float[Array, " n"]
    step: bool = static()

    def bias(self) -> Float[Array, " n"]:
        """The steady xhat - x without noise while x stays here: -output F^-1 drift + offset, F - I in place of F for steps."""
        f = self.f - jnp.eye(self.f.shape[0], dtype=self.f.dtype) if self.step else self.f
        return self.offset - self.output @ jnp.linalg.solve(f, self.drift)


def linearise(
    observer: Observer,
    plant: AbstractFlowPlant | AbstractStepPlant,
    x: Numbers,
    u: Numbers | None = None,
    *,
    process: Numbers | None = None,
    noise: Numbers | None = None,
    z: Any = None,
    clock: float = CLOCK,
    integrator: AbstractIntegrator | None = None,
) -> LinearError:
    """The linear error of `observer` on `plant` at the state x (n,) and input u (zeros if not given), by forward mode.

    noise: V (p, k), or a number for V = number * I (1 if not given). process: W (n, m), or a number for W = number *
    plant.disturbance_matrix() (0 if not given): unit covariance with `noise.Gaussian(number)` of `simulate`, unit intensity for
    white noise. A step observer of a flow plant sees it over its own period by `integrator` (RK4()), W held in between.

    Live are the parts of z that the measurement or the first guess reaches; a matrix cache or a clock is not. Scalar clocks are
    advanced by `clock` seconds (steps) so that gains which open with time are open. Gains that obey an equation (Kalman,
    Lyapunov) are those of `z`, an observer state; init(x) if not given. Works under jit, vmap over x, and grad with respect to
    the numbers in the observer. ValueError for arguments that do not fit.
    """
    require_instance("linearise", "observer", observer, Observer, "Give the observer alone, without its certificate.")
    require_instance("linearise", "plant", plant, AbstractFlowPlant | AbstractStepPlant, "Give the plant second.")
    step = isinstance(observer, AbstractStepObserver)
    if not step and isinstance(plant, AbstractStepPlant):
        fix = "Wrap it: jaxobs.observers.Sampled(observer, integrator, dt)."
        raise refuse("linearise", "observer", type(observer).__name__, "a step observer for a step plant", fix)
    if (observer.n, observer.p) != (plant.n, plant.p):
        given = f"n = {observer.n}, p = {observer.p}"
        fix = "The error xhat - x compares like with like."
        raise refuse("linearise", "observer", given, f"the plant's n = {plant.n}, p = {plant.p}", fix)
    dtype = dtype_of(observer)
    x = _vector("x", x, plant.n, dtype)
    u = jnp.zeros((plant.m,), dtype) if u is None else jnp.asarray(u, dtype)
    w = _matrix("process", 0.0 if process is None else process, plant.disturbance_matrix().astype(dtype))
    v = _matrix("noise", 1.0 if noise is None else noise, jnp.eye(plant.p, dtype=dtype))
    return _linearise(observer, plant, x, u, w, v, observer.init(x) if z is None else z, clock, integrator or RK4())


@eqx.filter_jit
def _linearise(observer, plant, x, u, w, v, z, clock, integrator) -> LinearError:
    step = isinstance(observer, AbstractStepObserver)
    time = jnp.zeros((), int) if step else jnp.zeros((), x.dtype)

    def move(z, y):
        return observer.step(time, z, u, y) if step else observer.flow(time, z, u, y)

    def output(x):
        return plant.h(x, u)

    def ahead(x, d):
        """Where the plant is one sample later."""
        if isinstance(plant, AbstractStepPlant):
            return plant.step(time, x, u) + w @ d
        dt = period("linearise", observer).astype(x.dtype)
        zero = jnp.zeros((), x.dtype)
        split = getattr(plant, "split", None)

        def shifted(t, x):
            a, b = plant.split(t, x, u)
            return a, b + w @ d

        field = Field(lambda t, x: plant.flow(t, x, u) + w @ d, split and shifted)
        return integrator.step(field, integrator.prepare(field, dt, x), zero, dt, x)

    y, still = output(x), jnp.zeros((w.shape[1],), x.dtype)
    parts = LiveState(observer, move, x, y, z, clock)
    begun = parts.take(observer.init(x))
    origin = parts.take(z)  # of eps: init(x), or the state that was given, moving with the truth in the same way

    def reference(x):
        return origin + (parts.take(observer.init(x)) - begun)

    def rate(live, y):
        return parts.take(move(parts.put(live), y))

    def estimate(live, y):
        return observer.estimate(time, parts.put(live), u, y)

    def drift(x):
        if step:
            return rate(reference(x), output(x)) - reference(ahead(x, still))
        return rate(reference(x), output(x)) - jax.jvp(reference, (x,), (plant.flow(time, x, u),))[1]

    start = jax.jacfwd(reference)(x)
    process = -jax.jacfwd(lambda d: reference(ahead(x, d)))(still) if step else -start @ w
    return LinearError(
        f=jax.jacfwd(rate)(origin, y),
        noise=jax.jacfwd(rate, 1)(origin, y) @ v,
        process=process,
        output=jax.jacfwd(estimate)(origin, y),
        direct=jax.jacfwd(estimate, 1)(origin, y) @ v,
        start=start,
        drift=drift(x),
        mismatch=jax.jacfwd(drift)(x),
        offset=estimate(origin, y) - x,
        step=step,
    )


def covariance(error: LinearError, dt: Numbers | None = None, *, process_held: bool = False) -> Float[Array, "n n"]:
    """The steady covariance of xhat - x; infinite where the linear error is not stable.

        white    F X + X F' + noise noise' + process process' = 0,    cov = output X output'
        held     X = Phi X Phi' + G G',   Phi = e^{F dt},   G = int_0^dt e^{Fs} ds noise
        steps    X = F X F' + noise noise' + process process',        cov = output X output' + direct direct'   (held, too)

    dt [s]: v is one unit sample held for dt, as in `simulate`, the covariance that at the sampling instants, exactly. w stays
    white, of unit intensity: its part of X solves the first equation. With process_held it is a unit sample held for dt, too.
    White noise that the estimate sees directly is infinite. For a step observer leave dt out. Solved in balanced coordinates,
    so that gains over many decades cost no digits; float64 is advised.
    """
    if error.step and dt is not None:
        raise refuse("covariance", "dt", dt, "None for a step observer", "Its samples have the period it was made for.")
    if dt is not None:
        require_positive("covariance", "dt", dt, "It is the period for which a sample is held, in seconds.")
        dt = jnp.asarray(dt, error.f.dtype)
    return _covariance(error, dt, process_held)


@eqx.filter_jit
def _covariance(error: LinearError, dt: Scalar | None, process_held: bool) -> Float[Array, "n n"]:
    one, stable = balanced(error)
    both = jnp.concatenate([one.noise, one.process], axis=1)
    if error.step:
        x = linalg.stein(one.f, both @ both.T)
    elif dt is None:
        x = linalg.lyapunov(one.f, both @ both.T)
    else:
        phi = linalg.phi_functions(one.f * dt, 1)
        b = dt * (phi[1] @ (both if process_held else one.noise))
        x = linalg.stein(phi[0], b @ b.T)
        x = x if process_held else x + linalg.lyapunov(one.f, one.process @ one.process.T)
    found = one.output @ x @ one.output.T
    if error.step or dt is not None:
        return jnp.where(stable, found + one.direct @ one.direct.T, jnp.inf)
    white = jnp.where(jnp.any(one.direct != 0, axis=1), jnp.inf, 0).astype(found.dtype)
    return jnp.where(stable, found, jnp.inf) + jnp.diag(white)


def input_covariance(error: LinearError, b: Float[Array, "N k"]) -> tuple[Float[Array, "n n"], Bool[Array, ""]]:
    """The integral of output e^{Ft} b b' e^{F't} output' over all t >= 0, the sum of output F^k b b' F'^k output' for steps,
    and whether F is stable (if not, that of calm dynamics)."""
    one, stable = balanced(eqx.tree_at(lambda error: error.noise, error, b))
    x = (linalg.stein if error.step else linalg.lyapunov)(one.f, one.noise @ one.noise.T)
    return one.output @ x @ one.output.T, stable


def balanced(error: LinearError) -> tuple[LinearError, Bool[Array, ""]]:
    """The same error with eps in units in which rows and columns of F are of like size, and whether F is stable. Where it is
    not, F is replaced by one that is, -I or 0, so that no NaN gets into gradients."""
    d = linalg.balance(jax.lax.stop_gradient(error.f))
    f, identity = error.f * d[None, :] / d[:, None], jnp.eye(error.f.shape[0], dtype=error.f.dtype)
    fixed = jax.lax.stop_gradient(f)
    # F is stable if and only if the response to all unit impulses has a positive definite sum (Lyapunov).
    total = (linalg.stein if error.step else linalg.lyapunov)(fixed, identity)
    stable = jnp.all(jnp.isfinite(jnp.linalg.cholesky(total)))
    parts = (jnp.where(stable, f, 0 * f if error.step else -identity), error.output * d[None, :])
    driven = (error.noise, error.process, error.start, error.mismatch, error.drift[:, None])
    noise, process, start, mismatch, drift = (part / d[:, None] for part in driven)
    return LinearError(
        parts[0], noise, process, parts[1], error.direct, start, drift[:, 0], mismatch, error.offset, error.step
    ), stable


def period(owner: str, observer: Any) -> Scalar:
    """The sampling period [s] of a step observer: its own `dt`, or that of its model. ValueError without one."""
    maker = next((part for part in (observer, getattr(observer, "model", None)) if hasattr(part, "dt")), None)
    if maker is None:
        fix = "Give the step plant that the samples come from, e.g. jaxobs.plants.Discretised(plant, integrator, dt)."
        raise refuse(owner, "observer", f"{type(observer).__name__} without dt", "a step observer made for one period", fix)
    return getattr(maker, "dt")  # noqa: B009 (not every Module has one)


def _vector(name: str, value: Any, size: int, dtype: Any) -> Float[Array, " size"]:
    if np.shape(value) != (size,):
        fix = "For several operating points take jax.vmap over x."
        raise refuse("linearise", name, f"shape {np.shape(value)}", f"({size},)", fix)
    return jnp.asarray(value, dtype)


def _matrix(name: str, value: Any, unit: Float[Array, "r k"]) -> Float[Array, "r _"]:
    """value * unit for a number, else the matrix given."""
    given = as_param(value).astype(unit.dtype)
    if given.ndim == 0:
        return given * unit
    if given.ndim != 2 or given.shape[0] != unit.shape[0]:
        fix = "One row for each state (process) or output (noise), or a single number."
        raise refuse("linearise", name, f"shape {given.shape}", f"a number or ({unit.shape[0]}, any)", fix)
    return given
