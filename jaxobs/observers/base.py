"""The contract of an observer: data plus one formula."""

import abc
from typing import TYPE_CHECKING, Any, ClassVar

import equinox as eqx
from jaxtyping import Array, Float, Int

from jaxobs._module import Module, Scalar
from jaxobs.plants import AbstractPlant

State = Any  # any pytree: xhat alone; xhat and integrators; xhat and S(t)
Input = Float[Array, "m ..."]


class AbstractObserver(Module):
    """n estimated states from m inputs and p outputs.

    At sample k first xhat_k = estimate(t or k, z_k, u_k, y_k), the estimate that uses y_k, then z moves on.
    """

    if TYPE_CHECKING:  # a type checker takes an AbstractVar for a constructor argument
        n: ClassVar[int]
        m: ClassVar[int]
        p: ClassVar[int]
    else:
        n: eqx.AbstractVar[int]
        m: eqx.AbstractVar[int]
        p: eqx.AbstractVar[int]

    @abc.abstractmethod
    def init(self, xhat0: Float[Array, " n"]) -> State:
        """The observer's state z that starts from the guess xhat0."""


class AbstractModelled(Module):
    """n, m and p are those of the observer's `model`: a mixin, before the kind of observer among the bases."""

    model: eqx.AbstractVar[AbstractPlant]

    @property
    def n(self) -> int:
        return self.model.n

    @property
    def m(self) -> int:
        return self.model.m

    @property
    def p(self) -> int:
        return self.model.p


class AbstractFlowObserver(AbstractObserver):
    """z' = flow(t, z, u, y).

    An observer with a stiff linear part also has split(t, z, u, y) -> (A, b) with flow = A z + b, A constant.
    """

    @abc.abstractmethod
    def flow(self, t: Scalar, z: State, u: Input, y: Float[Array, " p"]) -> State: ...

    @abc.abstractmethod
    def estimate(self, t: Scalar, z: State, u: Input, y: Float[Array, " p"]) -> Float[Array, " n"]:
        """xhat, with the measurement of this sample in hand."""

    @abc.abstractmethod
    def predict(self, t: Scalar, z: State, u: Input) -> Float[Array, " p"]:
        """The output expected before y is seen: y - predict is the innovation, and a lost sample is replaced by it."""


class AbstractStepObserver(AbstractObserver):
    """z+ = step(k, z, u, y). An observer made for one sampling period has it as `dt`; it is checked against the data."""

    @abc.abstractmethod
    def step(self, k: Int[Array, ""], z: State, u: Input, y: Float[Array, " p"]) -> State: ...

    @abc.abstractmethod
    def estimate(self, k: Int[Array, ""], z: State, u: Input, y: Float[Array, " p"]) -> Float[Array, " n"]:
        """xhat, with the measurement of this sample in hand."""

    @abc.abstractmethod
    def predict(self, k: Int[Array, ""], z: State, u: Input) -> Float[Array, " p"]:
        """The output expected before y is seen: y - predict is the innovation, and a lost sample is replaced by it."""


Observer = AbstractFlowObserver | AbstractStepObserver
