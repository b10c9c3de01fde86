"""Inputs u(t)."""

import abc
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from jaxobs._module import Module, Scalar


class AbstractSignal(Module):
    """t -> u(t), shape (m,); signals that supply r derivatives return (m, r + 1): u, u', ..., u^(r)."""

    if TYPE_CHECKING:  # a type checker takes an AbstractVar for a constructor argument
        m: ClassVar[int]
    else:
        m: eqx.AbstractVar[int]

    @abc.abstractmethod
    def __call__(self, t: Scalar) -> Float[Array, "m ..."]: ...
