"""What the world does: x' = f(x, u) or x+ = f(x, u), with outputs y = h(x, u)."""

import abc
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxobs._module import Module, Scalar, dtype_of


class AbstractPlant(Module):
    """n states, m inputs (m = 0: u has shape (0,)), p outputs, and the output map y = h(x, u)."""

    if TYPE_CHECKING:  # a type checker takes an AbstractVar for a constructor argument
        n: ClassVar[int]
        m: ClassVar[int]
        p: ClassVar[int]
    else:
        n: eqx.AbstractVar[int]
        m: eqx.AbstractVar[int]
        p: eqx.AbstractVar[int]

    @abc.abstractmethod
    def h(self, x: Float[Array, " n"], u: Float[Array, "*m"]) -> Float[Array, " p"]: ...

    @abc.abstractmethod
    def disturbance_matrix(self) -> Float[Array, "n w"]:
        """E, through which a process disturbance d enters: x' = f + E d, or x+ = f + E d."""


class AbstractFlowPlant(AbstractPlant):
    """x' = flow(t, x, u)."""

    @abc.abstractmethod
    def flow(self, t: Scalar, x: Float[Array, " n"], u: Float[Array, "*m"]) -> Float[Array, " n"]: ...


class AbstractStepPlant(AbstractPlant):
    """x+ = step(k, x, u)."""

    @abc.abstractmethod
    def step(self, k: Int[Array, ""], x: Float[Array, " n"], u: Float[Array, "*m"]) -> Float[Array, " n"]: ...


def everywhere(plant: AbstractPlant) -> Float[Array, "n n"]:
    """E = I: a disturbance on every state, for plants that know nothing better."""
    return jnp.eye(plant.n, dtype=dtype_of(plant))
