"""Linear plants given by their matrices, in continuous and in sampled time."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Module, param, refuse
from jaxobs.plants.base import AbstractStepPlant, everywhere
from jaxobs.plants.forms import AbstractStateAffine


class Linear(AbstractStateAffine):
    """x' = A x + B u, y = C x. A (n, n) [1/s], B (n, m), by default without inputs, C (p, n), by default I."""

    A: Float[Array, "n n"] = param()
    B: Float[Array, "n m"] | None = param(default=None)
    C: Float[Array, "p n"] | None = param(default=None)

    def __check_init__(self):
        _check(self, self.A, self.B, self.C)

    @property
    def n(self):
        return self.A.shape[0]

    @property
    def m(self):
        return 0 if self.B is None else self.B.shape[1]

    @property
    def p(self):
        return self.n if self.C is None else self.C.shape[0]

    def a(self, u):
        return self.A

    def b(self, u):
        return jnp.zeros((self.n,), self.A.dtype) if self.B is None else self.B @ u

    def c(self):
        return jnp.eye(self.n, dtype=self.A.dtype) if self.C is None else self.C

    def split(self, t, x, u):
        return self.A, self.b(u)


class LinearStep(AbstractStepPlant):
    """x+ = A x + B u, y = C x. A (n, n), B (n, m), by default without inputs, C (p, n), by default I."""

    A: Float[Array, "n n"] = param()
    B: Float[Array, "n m"] | None = param(default=None)
    C: Float[Array, "p n"] | None = param(default=None)

    def __check_init__(self):
        _check(self, self.A, self.B, self.C)

    @property
    def n(self):
        return self.A.shape[0]

    @property
    def m(self):
        return 0 if self.B is None else self.B.shape[1]

    @property
    def p(self):
        return self.n if self.C is None else self.C.shape[0]

    def step(self, k, x, u):
        return self.A @ x if self.B is None else self.A @ x + self.B @ u

    def h(self, x, u):
        return x if self.C is None else self.C @ x

    def disturbance_matrix(self):
        return everywhere(self)


def _check(owner: Module, a: Array, b: Array | None, c: Array | None) -> None:
    if a.ndim != 2 or a.shape[0] != a.shape[1] or a.shape[0] == 0:
        raise refuse(owner, "A", f"shape {a.shape}", "a square matrix (n, n), n >= 1", "One row and one column a state.")
    n = a.shape[0]
    if b is not None and (b.ndim != 2 or b.shape[0] != n):
        raise refuse(owner, "B", f"shape {b.shape}", f"shape ({n}, m)", "One row a state, one column an input: [[0.0], [1.0]].")
    if c is not None and (c.ndim != 2 or c.shape[1] != n or c.shape[0] == 0):
        raise refuse(owner, "C", f"shape {c.shape}", f"shape (p, {n}), p >= 1", "One row an output, one column a state.")
