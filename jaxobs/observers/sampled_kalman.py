"""The extended Kalman observer of a continuous plant that is measured in samples."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar, param, require_instance, require_integer, require_positive, static
from jaxobs.integrators import RK4, AbstractIntegrator, Field
from jaxobs.observers._kalman import check_kalman, process_root, root, time_update
from jaxobs.observers.base import AbstractModelled, AbstractStepObserver
from jaxobs.observers.kalman import correct
from jaxobs.plants import AbstractFlowPlant


class ContinuousDiscreteKalman(AbstractModelled, AbstractStepObserver):
    """Between samples, with u held, F = df/dx along xhat(t) and E the model's disturbance matrix

        xhat' = f(xhat, u),    P' = F P + P F' + E q E',

    and at each sample the measurement update of DiscreteKalman; the estimate at k uses y_k. P = U'U is kept as its root and
    both updates are QR array steps. In each of `substeps` parts h of dt, with the transition matrices A and B of its first and
    second half from the variational equation by `integrator`, the time update takes Simpson's rule, whose weights are positive:

        P+ = B A P A'B' + h/6 B A G G'A'B' + 2h/3 B G G'B' + h/6 G G',     G G' = E q E'    (error of order h^4).

    model: any flow plant. q (w, w): intensity of the white disturbance, per second; r (p, p): covariance of one sample; start
    (n, n) = P(0). All symmetric positive definite. dt [s] > 0, checked against the data. ValueError for anything else. A lost
    sample moves xhat by the model alone, but P goes on as if it had come: the contract passes no validity.
    Source: Jazwinski, Stochastic Processes and Filtering Theory, chapters 7 and 8; Kailath, Sayed and Hassibi, chapter 12.
    """

    model: AbstractFlowPlant
    q: Float[Array, "w w"] = param()
    r: Float[Array, "p p"] = param()
    start: Float[Array, "n n"] = param()
    dt: Scalar = param()
    integrator: AbstractIntegrator = RK4()
    substeps: int = static(default=1)

    def __check_init__(self):
        check_kalman(self, self.model, AbstractFlowPlant, "For a step plant take DiscreteKalman.")
        require_instance(
            self, "integrator", self.integrator, AbstractIntegrator, "Build it first, e.g. jaxobs.integrators.RK4()."
        )
        require_positive(self, "dt", self.dt, "It is the sampling period in seconds.")
        require_integer(self, "substeps", self.substeps, 1, "It counts the time updates between two samples.")

    def _field(self, u) -> Field:
        """x' = f, and its variational equation Phi' = F Phi."""

        def flow(t, state):
            x, phi = state
            f = jax.jacfwd(lambda x: self.model.flow(t, x, u))(x)
            return self.model.flow(t, x, u), f @ phi

        def split(t, state):
            x, phi = state
            a, b = self.model.split(t, x, u)  # pyright: ignore[reportAttributeAccessIssue]: only where the form has one
            rest = jax.jacfwd(lambda x: self.model.split(t, x, u)[1])(x)  # pyright: ignore[reportAttributeAccessIssue]
            return (a, a), (b, rest @ phi)

        return Field(flow, split if hasattr(self.model, "split") else None)

    def init(self, xhat0):
        # The matrices of an exponential integrator live in the state: made once for each lane, outside the loop.
        u = jnp.zeros((self.m,), self.dt.dtype)
        whole = jnp.eye(self.n, dtype=self.dt.dtype)
        cache = self.integrator.prepare(self._field(u), self.dt / (2 * self.substeps), (xhat0, whole))
        return xhat0, root(self.start), cache

    def step(self, k, z, u, y):
        *before, cache = z
        field, h = self._field(u), self.dt / self.substeps
        t0 = jnp.asarray(k, self.dt.dtype) * self.dt
        whole = jnp.eye(self.n, dtype=self.dt.dtype)
        g = process_root(self.model, self.q)

        def part(i, state):
            x, before = state
            t = t0 + jnp.asarray(i, h.dtype) * h
            middle, a = self.integrator.step(field, cache, t, h / 2, (x, whole))
            x, b = self.integrator.step(field, cache, t + h / 2, h / 2, (middle, whole))
            ends = jnp.sqrt(h / 6)
            return x, time_update(before, b @ a, ends * (b @ (a @ g)), 2 * ends * (b @ g), ends * g)

        state = correct(self, before, u, y)
        state = part(0, state) if self.substeps == 1 else jax.lax.fori_loop(0, self.substeps, part, state)
        return (*state, cache)

    def estimate(self, k, z, u, y):
        return correct(self, z[:2], u, y)[0]

    def predict(self, k, z, u):
        return self.model.h(z[0], u)
