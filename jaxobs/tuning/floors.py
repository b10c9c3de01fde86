"""The least error that a measurement leaves: the steady Kalman filter, and the covariances of the noises of a study.

`jaxobs.tuning.posterior_cramer_rao` is the floor where the plant is not linear.
"""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Complex, Float

from jaxobs._module import Numbers, dtype_of, refuse, require_instance, require_positive, require_shape
from jaxobs.integrators import RK4, AbstractIntegrator, Field
from jaxobs.noise import AbstractNoise, Gaussian, Uniform
from jaxobs.plants import AbstractFlowPlant, AbstractPlant

RESIDUAL = 1e-7  # of the Riccati equation, relative to its terms: beyond it the solver has failed
INVISIBLE = 1e-12  # the singular value of (A - pole; C), both of norm one, of a mode that no output shows
EDGE = 1e-9  # poles this near to the axis or the circle, relative to the largest rate, lie on it


@dataclasses.dataclass(frozen=True, eq=False)
class KalmanBound:
    """covariance (n, n) of the least error, rmse (n,) its roots, level = sqrt(tr(W S W')) for the weight W.

    gain (n, p) and poles (n,) are those of the filter that attains it: xhat' = A xhat + K (y - C xhat), or with samples
    xhat_k = xhat_k^- + K (y_k - C xhat_k^-), whose poles are in the z-plane.
    """

    covariance: Float[np.ndarray, "n n"]
    rmse: Float[np.ndarray, " n"]
    level: float
    gain: Float[np.ndarray, "n p"]
    poles: Complex[np.ndarray, " n"]


def kalman_bound(
    a: Numbers,
    c: Numbers,
    process: Numbers,
    noise: Numbers,
    *,
    dt: Numbers | None = None,
    held: bool = False,
    weight: Numbers | None = None,
) -> KalmanBound:
    """The least steady covariance S of the error of any causal linear filter of x' = A x + d, from an uncertain start:

        A S + S A' + Q - S C'R^-1 C S = 0,                       y = C x + v                 (dt = None)
        S^- = F S F' + Q_dt,   S = S^- - S^- C'(C S^- C' + R)^-1 C S^-,   y_k = C x(t_k) + v_k   (samples every dt seconds)

    with F = e^{A dt} and S = P(k|k), the error at the samples with y_k in hand.

    a (n, n), c (p, n). process (n, n) >= 0: intensity Q of white d [x^2/s], Q_dt = int_0^dt e^{As} Q e^{A's} ds; with `held`
    (samples only) the covariance of a d that is drawn at each sample and held, Q_dt = Gamma Q Gamma', Gamma = int e^{As} ds:
    what `jaxobs.simulate` does with a disturbance, Q = E var E'. noise (p, p) > 0: intensity R of white v [y^2 s], or with dt
    the covariance of one sample. A Gaussian(sigma) held over dt is to filters much slower than 1/dt white of intensity
    sigma^2 dt. weight (s, n), default I.

    What it bounds. Gaussian noises: every estimator, nonlinear ones too, since the Kalman filter is then the conditional mean
    (for stationary noises the causal Wiener filter is this filter). Other noises with these covariances: linear filters alone.
    A nonlinear plant: nothing. The sampled form bounds observers that see samples (step observers, Sampled, `observe`). A flow
    observer in `simulate` sees h(x(t)) + v_k with v_k held, hence exact increments of y within each period, and there no floor
    but zero exists: on two integrators L = (0+, (2 pi / dt)^2) averages v_k away over its period dt. Of the same plant's gains
    with poles up to 2 / dt none was found below the sampled form. dt = None idealises both worlds.

    ValueError for shapes, for Q not >= 0 or R not > 0, for (A, C) not detectable (no floor is finite), and for modes on the
    imaginary axis that no noise excites (their floor falls to zero with time). Float64 on the host.
    Source: Kalman and Bucy, J. Basic Engineering 83 (1961); Kailath, Sayed and Hassibi, Linear Estimation, chapter 14.
    """
    a, c, q, r = (np.array(one, np.float64) for one in (a, c, process, noise))
    n = len(a) if a.ndim == 2 else 0
    p = len(c) if c.ndim == 2 else 0
    require_shape("kalman_bound", "a", a, (n, n), "x' = A x: one row for each state.")
    require_shape("kalman_bound", "c", c, (p, n), "y = C x: one row for each output, one column for each state.")
    _check_covariance("process", q, n, "Of the disturbance on each state: E q E'.", strict=False)
    _check_covariance("noise", r, p, "An output without noise gives its derivatives exactly.", strict=True)
    w = np.eye(n) if weight is None else np.array(weight, np.float64)
    if w.ndim != 2 or w.shape[1] != n:
        raise refuse("kalman_bound", "weight", f"shape {w.shape}", f"(s, {n})", "One column for each state.")
    if dt is None:
        if held:
            fix = "Without samples a held disturbance is white of intensity var dt: process=E @ E.T * var * dt."
            raise refuse("kalman_bound", "held", "True", "False where dt is None", fix)
        _require_detectable(a, c, None)
        s, gain, closed = _continuous(a, c, q, r)
        slack = -np.linalg.eigvals(closed).real
        scale = float(np.max(np.abs(np.linalg.eigvals(closed))))
    else:
        dt = _period("kalman_bound", dt)
        f, q_dt = _held(a, q, dt) if held else _van_loan(a, q, dt)
        _require_detectable(f, c, dt)
        s, gain, closed = _sampled(f, c, q_dt, r)
        slack, scale = 1 - np.abs(np.linalg.eigvals(closed)), 1.0
    if not np.all(slack > EDGE * scale):
        given = f"{q.tolist()}, which leaves a mode on the boundary of stability unexcited"
        fix = "Its floor falls to zero with time: give it a process noise, or take it out of the model."
        raise refuse("kalman_bound", "process", given, "a noise that reaches every mode that does not decay", fix)
    s = (s + s.T) / 2
    rmse = np.sqrt(np.maximum(np.diagonal(s), 0))
    return KalmanBound(s, rmse, float(np.sqrt(max(np.trace(w @ s @ w.T), 0))), gain, np.linalg.eigvals(closed).astype(complex))


def disturbance_covariance(
    plant: AbstractPlant,
    disturbance: AbstractNoise,
    dt: Numbers | None = None,
    *,
    held: bool = True,
    x: Numbers | None = None,
    u: Numbers | None = None,
    integrator: AbstractIntegrator | None = None,
) -> Float[np.ndarray, "n n"]:
    """What a disturbance of variance var, drawn at each sample, adds to the covariance of the state in one step of dt:

        held:  Gamma var Gamma',  Gamma = d x(t + dt) / d d of one step of `integrator` (RK4() if none) with d held
        else:  int_0^dt e^{As} E E' e^{A's} ds var dt: that of white noise of the same intensity var dt, A = df/dx

    at x and u (zeros if not given; they matter only to the order dt relative). The first is what `jaxobs.simulate` does and
    has the rank of E; the second has full rank where E reaches all states through A, is never smaller in a linear plant, and
    differs by a relative order of dt^2 in the long run. A step plant has E var E' (dt None).

    disturbance: Gaussian or Uniform, on each column of E = plant.disturbance_matrix(). ValueError for other noises (they are
    correlated in time, or not additive) and for a dt that is missing or not positive.
    """
    require_instance("disturbance_covariance", "plant", plant, AbstractPlant, "E comes from plant.disturbance_matrix().")
    var = _variance(disturbance)
    e = np.asarray(plant.disturbance_matrix(), np.float64)
    if not isinstance(plant, AbstractFlowPlant):
        if dt is not None:
            raise refuse("disturbance_covariance", "dt", dt, "None for a step plant", "Its E is that of one step.")
        return var * e @ e.T
    if dt is None:
        raise refuse("disturbance_covariance", "dt", "None", "the sampling period in seconds", "A flow plant moves with time.")
    dt = _period("disturbance_covariance", dt)
    dtype = dtype_of(plant)
    state = jnp.zeros((plant.n,), dtype) if x is None else jnp.asarray(x, dtype)
    require_shape("disturbance_covariance", "x", state, (plant.n,), "One number for each state.")
    given = jnp.zeros((plant.m,), dtype) if u is None else jnp.asarray(u, dtype)
    if not held:
        a = jax.jacfwd(lambda x: plant.flow(jnp.zeros((), dtype), x, given))(state)
        return _van_loan(np.asarray(a, np.float64), var * dt * e @ e.T, dt)[1]
    integrator = RK4() if integrator is None else integrator
    gamma = np.asarray(_response(plant, integrator, state, given, jnp.asarray(dt, dtype)), np.float64)
    return var * gamma @ gamma.T


@eqx.filter_jit
def _response(plant: Any, integrator: AbstractIntegrator, x: Any, u: Any, step: Any) -> Any:
    """d x(t + dt) / d d for a disturbance that is held over one step."""
    e, start = plant.disturbance_matrix().astype(x.dtype), jnp.zeros((), x.dtype)

    def ahead(d):
        def split(t, x):
            a, b = plant.split(t, x, u)
            return a, b + e @ d

        field = Field(lambda t, x: plant.flow(t, x, u) + e @ d, split if hasattr(plant, "split") else None)
        return integrator.step(field, integrator.prepare(field, step, x), start, step, x)

    return jax.jacfwd(ahead)(jnp.zeros((e.shape[1],), x.dtype))


def _period(owner: str, dt: Numbers) -> float:
    require_shape(owner, "dt", dt, (), "One sampling period.")
    require_positive(owner, "dt", dt, "It is the sampling period in seconds.")
    return float(np.asarray(dt))


def _variance(noise: AbstractNoise) -> float:
    if isinstance(noise, Gaussian):
        return float(noise.sigma) ** 2
    if isinstance(noise, Uniform):
        return float(noise.width) ** 2 / 3
    fix = "Take the variance of each sample, if they are independent, and Gaussian(its root)."
    raise refuse("disturbance_covariance", "disturbance", type(noise).__name__, "Gaussian or Uniform", fix)


def _continuous(a: Any, c: Any, q: Any, r: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    s = _solved(scipy.linalg.solve_continuous_are, a.T, c.T, q, r)
    gain = np.linalg.solve(r, c @ s).T
    terms = (a @ s, s @ a.T, q, -gain @ r @ gain.T)
    _check_residual(sum(terms), terms)
    return s, gain, a - gain @ c


def _sampled(f: Any, c: Any, q: Any, r: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    before = _solved(scipy.linalg.solve_discrete_are, f.T, c.T, q, r)
    gain = np.linalg.solve(c @ before @ c.T + r, c @ before).T
    keep = np.eye(len(f)) - gain @ c
    s = keep @ before @ keep.T + gain @ r @ gain.T  # Joseph's form is symmetric and >= 0 by itself
    _check_residual(f @ s @ f.T + q - before, (before,))
    return s, gain, f @ keep


def _solved(solver: Any, *matrices: np.ndarray) -> np.ndarray:
    try:
        s = solver(*matrices)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise _unexcited() from error
    return s


def _check_residual(residual: Any, terms: tuple[Any, ...]) -> None:
    if not np.max(np.abs(residual)) <= RESIDUAL * max(float(np.max(np.abs(term))) for term in terms):
        raise _unexcited()


def _unexcited() -> ValueError:
    given = "a noise for which the Riccati equation has no solution within rounding"
    expected = "one that reaches every mode that does not decay"
    fix = "A mode without noise has a floor that falls to zero with time; or scale the states to like sizes."
    return refuse("kalman_bound", "process", given, expected, fix)


def _require_detectable(a: np.ndarray, c: np.ndarray, dt: float | None) -> None:
    """Hautus: no mode that does not decay is invisible."""
    scale = max(float(np.linalg.norm(a, 2)), 1e-300)
    for pole in np.linalg.eigvals(a):
        if (pole.real < -EDGE * scale) if dt is None else (abs(pole) < 1 - EDGE):
            continue
        rows = np.vstack([(a - pole * np.eye(len(a))) / scale, c / np.maximum(np.linalg.norm(c, 2), 1e-300)])
        if np.linalg.svd(rows, compute_uv=False)[-1] < INVISIBLE:
            given = f"outputs that do not see the mode {pole:.4g}" + ("" if dt is None else f" per sample of {dt:.4g} s")
            fix = "No observer's error stays finite there: measure more, or leave that state out."
            raise refuse("kalman_bound", "c", given, "a detectable pair (A, C)", fix)


def _van_loan(a: np.ndarray, q: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """(e^{A dt}, int_0^dt e^{As} Q e^{A's} ds) by one exponential. Van Loan, IEEE Trans. Autom. Control 23 (1978)."""
    n = len(a)
    e = scipy.linalg.expm(np.block([[-a, q], [np.zeros((n, n)), a.T]]) * dt)
    f = e[n:, n:].T
    q_dt = f @ e[:n, n:]
    return f, (q_dt + q_dt.T) / 2


def _held(a: np.ndarray, q: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """(e^{A dt}, Gamma Q Gamma'), Gamma = int_0^dt e^{As} ds."""
    n = len(a)
    e = scipy.linalg.expm(np.block([[a, np.eye(n)], [np.zeros((n, 2 * n))]]) * dt)
    return e[:n, :n], e[:n, n:] @ q @ e[:n, n:].T


def _check_covariance(name: str, value: np.ndarray, size: int, what: str, *, strict: bool, owner: str = "kalman_bound") -> None:
    require_shape(owner, name, value, (size, size), what)
    if not np.all(np.isfinite(value)) or not np.allclose(value, value.T, rtol=1e-9, atol=0):
        raise refuse(owner, name, value.tolist(), "a finite symmetric matrix", what)
    lowest = np.min(np.linalg.eigvalsh(value))
    if lowest <= 0 if strict else lowest < -1e-12 * np.max(np.abs(value)):
        wanted = "a positive definite matrix" if strict else "a positive semidefinite matrix"
        raise refuse(owner, name, f"{value.tolist()} with the eigenvalue {lowest:.4g}", wanted, what)
