"""What shall be proved of a tuned observer: a log-barrier to stay behind on the way, an exact certificate at the end."""

import abc
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Scalar
from jaxobs.certificates import AbstractCertificate
from jaxobs.observers import Observer


class Start(NamedTuple):
    """Where a search for a proof starts. fixed: constants, a pytree; free: what is searched along with the gains, of one shape
    for all observers of a kind; rate: the largest one (the least factor a step) that was proved there in floats, possibly
    negative (above 1); infinite if none is known."""

    fixed: Any
    free: Any
    rate: float


class AbstractCertifier(abc.ABC):
    """A theorem for an observer and a decay rate, in the three forms that a search needs.

    start(observer, rate)                   on the host: from what witnesses the search starts
    barrier(observer, fixed, free, rate)    in JAX: the mean of -log of the eigenvalues of what is positive definite if and only
                                            if the witnesses prove the rate; NaN where it is not
    prove(observer, fixed, free, rate)      on the host: the exact certificate; Infeasible where it does not hold

    unit: of the rate, "1/s", or "a step" for a factor, of which less is faster. Source: Boyd and Vandenberghe, Convex
    Optimization, section 11.6 (log-determinant barriers).
    """

    unit: str = "1/s"

    @abc.abstractmethod
    def start(self, observer: Observer, rate: float) -> Start: ...

    def recentred(self, fixed: Any, free: Any) -> tuple[Any, Any]:
        """The same witnesses in coordinates in which they are alike in size: a search is better conditioned there."""
        return fixed, free

    @abc.abstractmethod
    def barrier(self, observer: Observer, fixed: Any, free: Any, rate: Scalar) -> Scalar: ...

    @abc.abstractmethod
    def prove(self, observer: Observer, fixed: Any, free: Any, rate: float) -> AbstractCertificate: ...


def minus_log_det(m: Float[Array, "corners k k"]) -> Scalar:
    """-sum log det over matrices (corners, k, k), by their pivots; NaN where one is not positive definite.

    Written out, for the small k here: compiled, it is one loop over the corners, where a factorisation is a library call.
    """
    total = jnp.zeros((), m.dtype)
    while m.shape[-1] > 0:
        pivot = m[:, 0, 0]
        total = total - jnp.sum(jnp.log(jnp.where(pivot > 0, pivot, jnp.nan)))
        column = m[:, 1:, 0]
        m = m[:, 1:, 1:] - column[:, :, None] * column[:, None, :] / pivot[:, None, None]
    return total


def blocks(rows: list[list[Array]]) -> Array:
    """The matrix of these blocks, along the last two axes."""
    return jnp.concatenate([jnp.concatenate(row, -1) for row in rows], -2)
