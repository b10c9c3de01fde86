"""The five forms that designs ask for. A form derives flow, h and the linear part from what is specific to the system.

Each form also answers `split(t, x, u) -> (A, b)` with flow = A x + b, A constant: what stiff integrators take exactly. Those
with a part that is linear in x for given u answer `pair(u) -> (A(u), C)`: what Lyapunov gains and Gramians are made of.
"""

import abc
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar, dtype_of, refuse
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

    def pair(self, u):
        """(A, C) of the chain alone, without phi."""
        return jnp.eye(self.n, k=1, dtype=u.dtype), jnp.eye(1, self.n, dtype=u.dtype)

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

    def pair(self, u: Float[Array, "*m"]) -> tuple[Float[Array, "n n"], Float[Array, "1 n"]]:
        """(A(u), C), (9): the couplings above the diagonal, without g."""
        a = self.a(u)
        return jnp.diag(a, k=1), jnp.eye(1, self.n, dtype=a.dtype)

    def disturbance_matrix(self):
        return everywhere(self)


class AbstractBlockTriangular(AbstractFlowPlant):
    """x_i' = A_i(u) x_{i+1} + g_i(u, x_1, ..., x_i) with blocks x_i in R^{n_i}, n_1 >= n_2 >= ... >= n_q, y = x_1 in R^{n_1}

    (paper 003, (4) with couplings that are linear in x_{i+1}, and (8) for several outputs). (5) asks that A_i(u), n_i by
    n_{i+1}, has rank n_{i+1}; where it loses rank for some u, what can be seen depends on the input.
    """

    if TYPE_CHECKING:
        blocks: ClassVar[tuple[int, ...]]
    else:
        blocks: eqx.AbstractVar[tuple[int, ...]]

    def __check_init__(self):
        good = all(a >= b >= 1 for a, b in itertools.pairwise((*self.blocks, 1)))
        if not good:
            fix = "Order the states so that each block is seen through the one before it."
            raise refuse(self, "blocks", self.blocks, "sizes n_1 >= n_2 >= ... >= 1", fix)

    @property
    def n(self):
        return sum(self.blocks)

    @property
    def p(self):
        return self.blocks[0]

    @abc.abstractmethod
    def a(self, u: Float[Array, "*m"]) -> Sequence[Float[Array, "_ _"]]:
        """The couplings A_1(u), ..., A_{q-1}(u)."""

    @abc.abstractmethod
    def g(self, x: Float[Array, " n"], u: Float[Array, "*m"]) -> Float[Array, " n"]:
        """Lower triangular by blocks: g_i may depend on x_1, ..., x_i only."""

    def flow(self, t, x, u):
        edges = list(itertools.accumulate(self.blocks))
        ahead = [a @ x[begin:end] for a, begin, end in zip(self.a(u), edges[:-1], edges[1:], strict=True)]
        return jnp.concatenate([*ahead, jnp.zeros((self.blocks[-1],), x.dtype)]) + self.g(x, u)

    def h(self, x, u):
        return x[: self.blocks[0]]

    def pair(self, u: Float[Array, "*m"]) -> tuple[Float[Array, "n n"], Float[Array, "p n"]]:
        """(A(u), C): the couplings above the diagonal, without g."""
        a = jnp.zeros((self.n, self.n), u.dtype)
        edges = [0, *itertools.accumulate(self.blocks)]
        for i, coupling in enumerate(self.a(u)):
            a = a.at[edges[i] : edges[i + 1], edges[i + 1] : edges[i + 2]].set(coupling)
        return a, jnp.eye(self.p, self.n, dtype=u.dtype)

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

    def pair(self, u: Float[Array, "*m"]) -> tuple[Float[Array, "n n"], Float[Array, "p n"]]:
        return self.a(u), self.c().astype(u.dtype)

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


def require_output(plant: AbstractFlowPlant, output: Float[Array, "..."]) -> None:
    """An output matrix C given by the user: (p, n), p >= 1."""
    if output.ndim != 2 or output.shape[1] != plant.n or output.shape[0] == 0:
        fix = f"One row an output, one column a state: [{[1.0] + [0.0] * (plant.n - 1)}] for y = x_1."
        raise refuse(plant, "output", f"shape {output.shape}", f"shape (p, {plant.n})", fix)
