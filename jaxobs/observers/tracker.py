"""The nonpeaking time-derivative tracker, continuous: no model, a gain that opens gently."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import (
    Scalar,
    concrete,
    param,
    refuse,
    require_finite,
    require_integer,
    require_positive,
    require_shape,
    static,
)
from jaxobs.linalg import shift
from jaxobs.observers._fading import pascal_matrix, start_up_gain
from jaxobs.observers._gains import powers
from jaxobs.observers.base import AbstractFlowObserver


class Tracker(AbstractFlowObserver):
    """Estimates (y, y', ..., y^(n-1)) without a model; with eta = (xi, xhat), s = (+1 on xi, -1 on xhat; all +1 if q = 0),

        eta' = (A~ - K(t) C~) eta + B y,    K = H^-1 C~',    H' = -mu H - A~'H - H A~ + C~'C~,    H(0) = start

    (paper 001, (4)). A~ = s A_N s with the plain shift A_N, N = n + q, so one closed form of H serves every (n, q):
    H(t) = H_inf + e^{-mu t} e^{-A~'t} (H(0) - H_inf) e^{-A~t}. The gain tends to s_i C(N, i) mu^i, all poles at -mu; from any
    fixed start > 0 there is no peaking, uniformly in mu. In steady state it is IntegralHighGain on IntegratorChain(n) with
    binomial alphas.

    n >= 1 derivatives (y counts), q >= 0 integrators, mu [1/s] > sqrt(n + q) for the paper's theorem. start: a number c for
    c I, N numbers for a diagonal, or a positive definite (N, N), in the coordinates of eta; jaxobs.linalg.tracker_steady(n, q,
    mu) makes the gain constant, and peaks.
    """

    n: int = static()
    q: int = static()
    mu: Scalar = param()
    start: Float[Array, "..."] = param(default=1.0)
    m = 0
    p = 1

    def __check_init__(self):
        check_tracker(self)
        check_start(self, "H(0) = start; large values open the gain slowly.")

    def init(self, xhat0):
        return jnp.concatenate([jnp.zeros((self.q,), xhat0.dtype), xhat0]), jnp.zeros((), xhat0.dtype)

    def gain(self, elapsed: Scalar) -> Float[Array, " N"]:
        """K(t) in the coordinates of the plain shift (all signs +), `elapsed` seconds after the start."""
        size = self.n + self.q
        tau = self.mu * elapsed
        steady = pascal_matrix(size, self.mu.dtype)
        grades = self.mu ** jnp.arange(size, dtype=self.mu.dtype)
        scaled_start = self.mu * grades[:, None] * start_matrix(self) * grades[None, :]
        return powers(self.mu, size) * start_up_gain(steady, scaled_start, tau, tau)

    def flow(self, t, z, u, y):
        eta, elapsed = z
        s = signs(self.n, self.q, eta.dtype)
        drift = s * shift(s * eta)
        if self.q == 0:
            return drift + self.gain(elapsed) * (y - eta[:1]), jnp.ones_like(elapsed)
        drift = drift.at[self.q - 1].add(y[0])
        return drift - s * self.gain(elapsed) * eta[0], jnp.ones_like(elapsed)

    def estimate(self, t, z, u, y):
        return z[0][self.q :]

    def predict(self, t, z, u):
        return z[0][self.q : self.q + 1]


def signs(n: int, q: int, dtype) -> Float[Array, " N"]:
    """s: +1 on the integrators, -1 on the estimate; all +1 without integrators."""
    return jnp.asarray([1.0] * q + [-1.0 if q else 1.0] * n, dtype)


def start_matrix(tracker) -> Float[Array, "N N"]:
    """H(0) in the coordinates of the plain shift: s H(0) s."""
    n, q, start = tracker.n, tracker.q, tracker.start
    if start.ndim < 2:
        return jnp.diag(jnp.broadcast_to(start, (n + q,)))
    s = signs(n, q, start.dtype)
    return s[:, None] * start * s[None, :]


def check_start(tracker, what: str) -> None:
    """A number, a diagonal or a matrix of size n + q, positive definite where it is concrete."""
    size, start = tracker.n + tracker.q, tracker.start
    shapes = ((), (size,), (size, size))
    if np.shape(start) not in shapes:
        expected = f"shape {shapes[0]}, {shapes[1]} or {shapes[2]}"
        raise refuse(
            tracker, "start", f"shape {np.shape(start)}", expected, "A grid goes through jaxobs.grid(observer, start=...)."
        )
    if np.ndim(start) < 2:
        return require_positive(tracker, "start", start, what)
    known = concrete(start)
    if known is None:
        return None
    d = np.sqrt(np.abs(np.diag(known)))
    lowest = np.linalg.eigvalsh(known / np.outer(d, d))[0] if np.all(np.diag(known) > 0) else -1.0
    if not np.allclose(known, known.T, rtol=1e-6, atol=0) or lowest <= 0:
        raise refuse(tracker, "start", known.tolist(), "a symmetric positive definite matrix", what)
    return None


def check_tracker(tracker) -> None:
    """n >= 1, q >= 0, n + q <= 10, integers; mu > 0 [1/s], one finite number (its value is checked where it is concrete).

    ValueError otherwise.
    """
    require_integer(tracker, "n", tracker.n, 1, "It counts the signal and the derivatives wanted: order + 1.")
    require_integer(tracker, "q", tracker.q, 0, "It counts the integrators in front of the estimate.")
    require_shape(tracker, "mu", tracker.mu, (), "A grid of mu goes through jaxobs.grid(observer, mu=...) and jaxobs.over.")
    require_finite(tracker, "mu", tracker.mu)
    require_positive(tracker, "mu", tracker.mu, "It is the rate of all poles in 1/s; larger is faster and noisier.")
    if tracker.n + tracker.q > 10:
        raise refuse(tracker, "n", f"n + q = {tracker.n + tracker.q}", "n + q <= 10", "Higher derivatives drown in rounding.")
