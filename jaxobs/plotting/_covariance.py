"""What a Kalman observer believed of itself along a run: its covariances, which the run does not keep."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import dtype_of, refuse
from jaxobs.integrators import RK4
from jaxobs.observers import ContinuousDiscreteKalman, ContinuousKalman, DiscreteKalman, Sampled

KALMAN = DiscreteKalman | ContinuousDiscreteKalman | ContinuousKalman
AWAY = 1e-3  # of the largest estimate: how far the repeated run may be from the one given


class Believed(NamedTuple):
    """deviations (T, n): roots of the diagonal of P_k, with y_k in hand; innovation (T, p, p): C P_k^- C' + r."""

    deviations: Float[np.ndarray, "T n"]
    innovation: Float[np.ndarray, "T p p"]


def believed(owner: str, observer: Any, run: Any) -> Believed:
    """The observer once more over the y and u of one run that it made; a Kalman-Bucy observer with its samples held.

    ValueError for an observer without a covariance, for one that did not make this run, and where the run has no u.
    """
    where = f"plotting.{owner}"
    if not isinstance(observer, KALMAN):
        fix = "Others have none: leave it out, or give deviations=, shape (T, n)."
        raise refuse(where, "observer", type(observer).__name__, "an observer with a covariance (Kalman)", fix)
    if np.ndim(run.xhat) != 2 or np.shape(run.xhat)[1] != observer.n:
        fix = "Give the observer that made the run."
        raise refuse(where, "run", f"xhat of shape {np.shape(run.xhat)}", f"one run (T, {observer.n})", fix)
    us = getattr(run, "u", None)
    if us is None and observer.m > 0:
        fix = "Draw its deviations: give deviations=, shape (T, n)."
        raise refuse(where, "run", f"{type(run).__name__}, which keeps no u", "a Trajectory, or an observer with m = 0", fix)
    dtype = dtype_of(observer)
    ts = jnp.asarray(run.ts, dtype)
    us = jnp.zeros((ts.shape[0], 0), dtype) if us is None else us
    xhat, deviations, innovation = _again(observer, ts, jnp.asarray(run.xhat, dtype), run.y, run.valid, us, run.innovation)
    # Jointly integrated, a flow observer saw y between the samples, too.
    away = 0.0 if isinstance(observer, ContinuousKalman) else np.max(np.abs(np.asarray(xhat) - np.asarray(run.xhat)))
    if not away <= AWAY * max(1.0, float(np.max(np.abs(np.asarray(run.xhat))))):
        given = f"an observer whose estimates are {away:.3g} away from those of the run"
        raise refuse(where, "observer", given, "the one that made the run", "Its numbers, q, r and start count.")
    return Believed(np.asarray(deviations, float), np.asarray(innovation, float))


@eqx.filter_jit
def _again(observer: Any, ts, xhat, y, valid, us, innovation) -> tuple[Array, Array, Array]:
    flows = isinstance(observer, ContinuousKalman)
    dt = (ts[-1] - ts[0]) / (ts.shape[0] - 1)
    stepper = Sampled(observer, RK4(), dt) if flows else observer

    def output(x, u):
        return jax.jacfwd(lambda x: observer.model.h(x, u))(x)

    def parts(z):
        """The estimate before y_k, and P^-."""
        x, half = z[0] if flows else z[:2]
        return x, half @ half.T if flows else half.T @ half

    def body(z, sample):
        k, u, seen, good = sample
        x, p = parts(z)
        seen = jnp.where(good, seen, stepper.predict(k, z, u)).astype(x.dtype)
        c = output(x, u)
        s = c @ p @ c.T + (observer.r / dt if flows else observer.r)
        after = p if flows else p - p @ c.T @ jnp.linalg.solve(s, c @ p)
        found = stepper.estimate(k, z, u, seen), jnp.sqrt(jnp.maximum(jnp.diagonal(after), 0)), s
        return stepper.step(k, z, u, seen), found

    # A filter has used y_0 in the first estimate of the run: xhat_0^- = xhat_0 - K_0 innovation_0.
    start, c = observer.start.astype(xhat.dtype), output(xhat[0], us[0])
    gain = 0 * (start @ c.T) if flows else start @ c.T @ jnp.linalg.inv(c @ start @ c.T + observer.r)
    first = stepper.init(xhat[0] - gain @ innovation[0].astype(xhat.dtype))
    _, found = jax.lax.scan(body, first, (jnp.arange(ts.shape[0]), us.astype(xhat.dtype), y, valid))
    return found
