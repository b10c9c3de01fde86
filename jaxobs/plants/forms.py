"""The four forms that designs ask for. A form derives flow, h and the linear part from what is specific to the system.

Each form also answers `split(t, x, u) -> (A, b)` with flow = A x + b, A constant: what stiff integrators take exactly.
"""

import abc

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar, dtype_of
from jaxobs.linalg import shift
from jaxobs.plants.base import AbstractFlowPlant, everywhere


class AbstractChain(AbstractFlowPlant):
    """Brunovsky form: x_i' = x_{i+1}, x_n' = phi(x, u), y = x_1 (paper 000, (3))."""

    p = 1

    @abc.abstractmethod
    def phi(self, x: Float[Array, " n"], u: Float[Array, "*m"]) -> Scalar: ...

    def flow(self, t, x, u):
        return jnp.concatenate([x[1:], self.phi(x, u)[None]])

    def h(self, x, u):
        return x[:1]

    def split(self, t, x, u):
        last = jnp.zeros_like(x).at[-1].set(self.phi(x, u))
        return jnp.eye(self.n, k=1, dtype=x.dtype), last

    def disturbance_matrix(self):
        return jnp.zeros((self.n, 1), dtype_of(self)).at[-1].set(1)


class AbstractTriangular(AbstractFlowPlant):
    """x_i' = a_i(u) x_{i+1} + g_i(u, x_1, ..., x_i), y = x_1 (paper 003, (2) with a = 1, and (8)-(9))."""

    p = 1

    @abc.abstractmethod
    def a(self, u: Float[Array, "*m"]) -> Float[Array, " n-1"]:
        """The couplings a_i(u) of x_i to x_{i+1}."""

    @abc.abstractmethod
    def g(self, x: Float[Array, " n"], u: Float[Array, "*m"]) -> Float[Array, " n"]:
        """Lower triangular: g_i may depend on x_1, ..., x_i only."""

    def flow(self, t, x, u):
        coupling = jnp.concatenate([self.a(u), jnp.zeros_like(x[:1])])
        return coupling * shift(x) + self.g(x, u)

    def h(self, x, u):
        return x[:1]

    def split(self, t, x, u):
        linear = jnp.eye(self.n, k=1, dtype=x.dtype)
        return linear, self.flow(t, x, u) - shift(x)

    def disturbance_matrix(self):
        return everywhere(self)


class AbstractStateAffine(AbstractFlowPlant):
    """x' = A(u) x + b(u), y = C x (paper 003, (10))."""

    @abc.abstractmethod
    def a(self, u: Float[Array, "*m"]) -> Float[Array, "n n"]: ...

    @abc.abstractmethod
    def b(self, u: Float[Array, "*m"]) -> Float[Array, " n"]: ...

    @abc.abstractmethod
    def c(self) -> Float[Array, "p n"]: ...

    def flow(self, t, x, u):
        return self.a(u) @ x + self.b(u)

    def h(self, x, u):
        return self.c().astype(x.dtype) @ x  # a plant without numbers knows no precision

    def split(self, t, x, u):
        return jnp.zeros((self.n, self.n), x.dtype), self.flow(t, x, u)

    def disturbance_matrix(self):
        return everywhere(self)


class AbstractLipschitz(AbstractFlowPlant):
    """x' = A x + B f(x) + g(y, u), y = C x (paper 004, (3)); f need not be globally Lipschitz, bounds on its Jacobian do."""

    @abc.abstractmethod
    def a(self) -> Float[Array, "n n"]: ...

    @abc.abstractmethod
    def b(self) -> Float[Array, "n r"]: ...

    @abc.abstractmethod
    def c(self) -> Float[Array, "p n"]: ...

    @abc.abstractmethod
    def f(self, x: Float[Array, " n"]) -> Float[Array, " r"]: ...

    @abc.abstractmethod
    def g(self, y: Float[Array, " p"], u: Float[Array, "*m"]) -> Float[Array, " n"]: ...

    def flow(self, t, x, u):
        return self.a() @ x + self.b() @ self.f(x) + self.g(self.h(x, u), u)

    def h(self, x, u):
        return self.c() @ x

    def split(self, t, x, u):
        return self.a(), self.b() @ self.f(x) + self.g(self.h(x, u), u)

    def disturbance_matrix(self):
        return self.b()
