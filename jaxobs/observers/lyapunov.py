"""High-gain observers whose gain is a state: it solves a Lyapunov equation driven by the input."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Module, Numbers, Scalar, as_param, concrete, param, refuse, require_positive, require_shape
from jaxobs.integrators import RK4, AbstractIntegrator, Field
from jaxobs.linalg import expm, triangularise
from jaxobs.observers.base import AbstractFlowObserver, AbstractModelled, AbstractStepObserver
from jaxobs.plants import AbstractBlockTriangular, AbstractChain, AbstractStateAffine, AbstractTriangular

SeenThrough = AbstractChain | AbstractTriangular | AbstractBlockTriangular | AbstractStateAffine  # they have pair(u)
FIX = "Write it as a subclass of AbstractTriangular, AbstractBlockTriangular or AbstractStateAffine, or use a constant gain."


class Lyapunov(AbstractModelled, AbstractFlowObserver):
    """z = (xhat, S),    xhat' = f(xhat, u) + S^-1 C'(y - C xhat),    S' = -theta S - A(u)'S - S A(u) + C'C

    (paper 003, (25); 001's (4) with theta = mu; and (12), see `from_scaled`). f = A(u) x + g(u, x): only A(u) and C enter S.
    For an affine plant V = e'S e falls like e^{-theta t} whatever the input; what that says about e is how large S stays,
    which `jaxobs.excitation.classify` measures. On a chain S tends to the steady state whose gains are C(n, i) theta^i.

    model: chain, triangular, block triangular or state affine. theta [1/s] > 0. start: S(0) (n, n), symmetric positive
    definite, or a number s for s I. The linear equation of S limits explicit steps to theta dt < 2.785 (RK4), 2 (Euler):
    beyond that `simulate`, `observe` and `Sampled` refuse. With samples, StepLyapunov has no such limit.
    """

    model: SeenThrough
    theta: Scalar = param()
    start: Float[Array, "..."] = param(default=1.0)

    def __check_init__(self):
        _check(self)

    @property
    def fastest_rate(self):
        """All eigenvalues of the equation of S are -theta where A(u) is nilpotent."""
        return self.theta

    def init(self, xhat0):
        return xhat0, _full(self.start, self.n).astype(xhat0.dtype)

    def gain(self, s: Float[Array, "n n"], u: Float[Array, "*m"]) -> Float[Array, "n p"]:
        """S^-1 C', by a Cholesky factor in scaled coordinates: the grading of S costs no digits."""
        _, c = self.model.pair(u)
        d = jnp.sqrt(jnp.diagonal(s))
        factor = jnp.linalg.cholesky(s / (d[:, None] * d[None, :]))
        return jax.scipy.linalg.cho_solve((factor, True), c.T / d[:, None]) / d[:, None]

    def flow(self, t, z, u, y):
        xhat, s = z
        a, c = self.model.pair(u)
        turned = s @ a
        correction = self.gain(s, u) @ (y - self.model.h(xhat, u))
        return self.model.flow(t, xhat, u) + correction, -self.theta * s - turned - turned.T + c.T @ c

    def estimate(self, t, z, u, y):
        return z[0]

    def predict(self, t, z, u):
        return self.model.h(z[0], u)


class StepLyapunov(AbstractModelled, AbstractStepObserver):
    """The same for samples dt apart, with u held; S = R'R is kept as its root, F = e^{A(u_k) dt}, and at sample k

        S_k = S_k^- + dt C'C,   xhat_k = xhat_k^- + dt S_k^-1 C'(y_k - C xhat_k^-),   S_{k+1}^- = e^{-theta dt} F'^-1 S_k F^-1

        as    R_k = triangularise([R_k^-; sqrt(dt) C]),     R_{k+1}^- = e^{-theta dt / 2} R_k F^-1,

    xhat_{k+1}^- by one step of `integrator` on the model's flow. Exact for any theta dt, and R'R is never indefinite. For an
    affine plant xhat_k minimises sum_j e^{-theta (t_k - t_j)} |y_j - C x(t_j)|^2 dt with the prior S(0) around xhat0. As dt
    -> 0 it is Lyapunov; on a chain it is DiscreteTracker without integrators. Source: paper 003, (20) and (25), over one
    sample; the array form is that of Kailath, Sayed and Hassibi, Linear Estimation, chapter 12.

    A lost sample counts in S as one that met the expectation. model, theta [1/s], start as for Lyapunov. dt [s] > 0, checked
    against the data.
    """

    model: SeenThrough
    theta: Scalar = param()
    dt: Scalar = param()
    start: Float[Array, "..."] = param(default=1.0)
    integrator: AbstractIntegrator = RK4()

    def __check_init__(self):
        _check(self)
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")

    def init(self, xhat0):
        return xhat0, jnp.linalg.cholesky(_full(self.start, self.n)).T.astype(xhat0.dtype)

    def _correct(self, z, u, y):
        xhat, root = z
        _, c = self.model.pair(u)
        root = triangularise(jnp.concatenate([root, jnp.sqrt(self.dt) * c]))
        back = jax.scipy.linalg.solve_triangular(root.T, c.T, lower=True)
        gain = self.dt * jax.scipy.linalg.solve_triangular(root, back, lower=False)
        return xhat + gain @ (y - self.model.h(xhat, u)), root

    def step(self, k, z, u, y):
        xhat, root = self._correct(z, u, y)
        field = Field(lambda t, x: self.model.flow(t, x, u))
        t = jnp.asarray(k, self.dt.dtype) * self.dt
        ahead = self.integrator.step(field, None, t, self.dt, xhat)
        return ahead, jnp.exp(-self.theta * self.dt / 2) * root @ self._backward(u)

    def _backward(self, u: Float[Array, "*m"]) -> Float[Array, "n n"]:
        """F^-1 = e^{-A(u) dt}; a finite sum where A(u) is nilpotent by its form."""
        a, _ = self.model.pair(u)
        if isinstance(self.model, AbstractStateAffine):
            return expm(-self.dt * a)
        term = total = jnp.eye(self.n, dtype=a.dtype)
        for k in range(1, self.n):
            term = -self.dt / k * (term @ a)
            total = total + term
        return total

    def estimate(self, k, z, u, y):
        return self._correct(z, u, y)[0]

    def predict(self, k, z, u):
        return self.model.h(z[0], u)


def from_scaled(theta: Numbers, gamma: Numbers, start: Numbers) -> tuple[Array, Array]:
    """(theta, S(0)) of (25) that make it the observer (12) with the parameters theta, gamma and S(0) = start (n, n):

        theta_25 = gamma theta,      S_25 = theta Delta^-1 S_12 Delta^-1,      Delta = diag(theta^i).

    Then S_25^-1 C' = Delta S_12^-1 C' at all times: (12) and (25) of paper 003 are one observer. For chain and triangular
    forms.
    """
    s, scale, rate = as_param(start), as_param(theta), as_param(gamma)
    d = scale ** -jnp.arange(1, s.shape[0] + 1, dtype=s.dtype)
    return rate * scale, scale * d[:, None] * s * d[None, :]


def _full(start: Array, n: int) -> Float[Array, "n n"]:
    return start * jnp.eye(n, dtype=start.dtype) if start.ndim == 0 else start


def _check(observer: Module) -> None:
    model, theta, start = observer.model, observer.theta, observer.start  # pyright: ignore[reportAttributeAccessIssue]
    if not isinstance(model, SeenThrough):
        raise refuse(observer, "model", type(model).__name__, "a chain, a triangular or a state-affine form", FIX)
    require_positive(observer, "theta", theta, "It is the rate in 1/s at which old measurements are forgotten.")
    if start.ndim != 0:
        require_shape(observer, "start", start, (model.n, model.n), "S(0) has a row and a column for each state.")
    known = concrete(start)
    if known is None:
        return
    full = known if known.ndim else known * np.eye(model.n)  # NumPy: this may run while something else is traced
    d = np.sqrt(np.abs(np.diag(full)))
    d = np.where(d > 0, d, 1)
    scaled = full / (d[:, None] * d[None, :])
    smallest = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0])
    if not np.allclose(scaled, scaled.T) or smallest <= 0:
        given = f"{known.tolist()} (symmetric part, scaled to unit diagonal: smallest eigenvalue {smallest:.3g})"
        fix = "It says how much xhat0 is trusted: start = 1.0 is the identity."
        raise refuse(observer, "start", given, "S(0) symmetric and positive definite", fix)
