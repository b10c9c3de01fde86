"""The extended Kalman observer in continuous time and in discrete time, its covariance kept as a root."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar, param
from jaxobs.observers._kalman import check_kalman, measurement_update, process_root, root, time_update
from jaxobs.observers.base import AbstractFlowObserver, AbstractModelled, AbstractStepObserver
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant

FLOW = "For a step plant take DiscreteKalman."
STEP = "For a flow plant take ContinuousDiscreteKalman or ContinuousKalman."


class ContinuousKalman(AbstractModelled, AbstractFlowObserver):
    """With F = df/dx and C = dh/dx at xhat, E the model's disturbance matrix, the extended Kalman-Bucy observer

        xhat' = f(xhat, u) + K (y - h(xhat, u)),    K = P C'r^-1,    P' = F P + P F' + E q E' - P C'r^-1 C P,    P(0) = start

    kept as the Cholesky root P = S S':   S' = S Phi(S^-1 (F P + P F' + E q E') S'^-1 - S'C'r^-1 C S), Phi the lower triangle
    with half the diagonal. P stays semidefinite whatever the integrator does. Explicit steps must resolve the start, where K C
    is fastest as a rule: `simulate` and Sampled refuse steps outside the stability limit there, which a large start / r makes
    small; ContinuousDiscreteKalman has no such limit. For a linear model it is the Kalman-Bucy filter.

    model: any flow plant, h differentiable. q (w, w): intensity of the white disturbance, per second; r (p, p): intensity of
    white measurement noise (samples of variance v, held for dt: r = v dt); start (n, n). All symmetric positive definite, else
    ValueError. A lost sample moves xhat by the model alone, but P goes on as if it had come: the contract passes no validity.
    Source: Jazwinski, Stochastic Processes and Filtering Theory, chapters 7 and 8; Morf, Levy and Kailath (1978).
    """

    model: AbstractFlowPlant
    q: Float[Array, "w w"] = param()
    r: Float[Array, "p p"] = param()
    start: Float[Array, "n n"] = param()

    def __check_init__(self):
        check_kalman(self, self.model, AbstractFlowPlant, FLOW)

    @property
    def fastest_rate(self) -> Scalar:
        """3/2 |r^-1/2 C S|^2 [1/s] at the start, C at x = 0: the fastest rate of the equation of S there."""
        x, u = jnp.zeros((self.n,), self.r.dtype), jnp.zeros((self.m,), self.r.dtype)
        c = jax.jacfwd(lambda x: self.model.h(x, u))(x)
        root_r = jnp.linalg.cholesky(self.r)
        return 1.5 * jnp.linalg.norm(jax.scipy.linalg.solve_triangular(root_r, c @ self.init(x)[1], lower=True), 2) ** 2

    def init(self, xhat0):
        return xhat0, jnp.linalg.cholesky(self.start)

    def flow(self, t, z, u, y):
        xhat, s = z
        f = jax.jacfwd(lambda x: self.model.flow(t, x, u))(xhat)
        c = jax.jacfwd(lambda x: self.model.h(x, u))(xhat)
        solve = jax.scipy.linalg.solve_triangular
        seen = solve(jnp.linalg.cholesky(self.r), c @ s, lower=True)  # r^-1/2 C S
        drift = solve(s, f @ s, lower=True)
        driven = solve(s, process_root(self.model, self.q), lower=True)
        inner = drift + drift.T + driven @ driven.T - seen.T @ seen
        ds = s @ (jnp.tril(inner) - jnp.diag(jnp.diagonal(inner)) / 2)
        scaled = solve(jnp.linalg.cholesky(self.r), y - self.model.h(xhat, u), lower=True)
        return self.model.flow(t, xhat, u) + s @ (seen.T @ scaled), ds

    def estimate(self, t, z, u, y):
        return z[0]

    def predict(self, t, z, u):
        return self.model.h(z[0], u)


class DiscreteKalman(AbstractModelled, AbstractStepObserver):
    """With F = df/dx at xhat_k and C = dh/dx at xhat_k^-, E the model's disturbance matrix, the extended Kalman observer

        xhat_k = xhat_k^- + K_k (y_k - h(xhat_k^-, u_k)),    K_k = P_k^- C'(C P_k^- C' + r)^-1,    P_k = (I - K_k C) P_k^-
        xhat_{k+1}^- = f(k, xhat_k, u_k),    P_{k+1}^- = F P_k F' + E q E',    P_0^- = start

    kept as the root P = U'U; both updates are QR array steps, so that P never loses definiteness. For a linear model it is the
    Kalman filter. The estimate at k uses y_k.

    model: any step plant. q (w, w): covariance of the disturbance of one step; r (p, p): of one sample; start (n, n). All
    symmetric positive definite, else ValueError. A lost sample moves xhat by the model alone, but P goes on as if it had come:
    the contract passes no validity.
    Source: Kailath, Sayed and Hassibi, Linear Estimation, chapters 9 and 12; Jazwinski, chapter 8.
    """

    model: AbstractStepPlant
    q: Float[Array, "w w"] = param()
    r: Float[Array, "p p"] = param()
    start: Float[Array, "n n"] = param()

    def __check_init__(self):
        check_kalman(self, self.model, AbstractStepPlant, STEP)

    def init(self, xhat0):
        return xhat0, root(self.start)

    def step(self, k, z, u, y):
        xhat, u_root = correct(self, z, u, y)

        def ahead(x):
            return self.model.step(k, x, u)

        return ahead(xhat), time_update(u_root, jax.jacfwd(ahead)(xhat), process_root(self.model, self.q))

    def estimate(self, k, z, u, y):
        return correct(self, z, u, y)[0]

    def predict(self, k, z, u):
        return self.model.h(z[0], u)


def correct(observer, z, u, y) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """The estimate and the root of its covariance, with y in hand."""
    xhat, before = z
    c = jax.jacfwd(lambda x: observer.model.h(x, u))(xhat)
    return measurement_update(xhat, before, c, root(observer.r), y - observer.model.h(xhat, u))
