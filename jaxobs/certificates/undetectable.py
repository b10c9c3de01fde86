"""A mode that the outputs do not see, and that does not decay as asked: what no gain can cure."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractModel


@dataclasses.dataclass(frozen=True)
class Undetectability(AbstractModel):
    """At the constant rho, A = a + sum_k rho_k b_k c_k' maps the subspace {v: output A^k v = 0 for all k} into itself, where

        A has an eigenvalue with Re s >= -rate      (step = 1: |z| >= rate),

    which is one of A - L output too, whatever L: no observer's error decays faster than that.

    a (n, n), b (n, r), c (r, n), output (p, n), lower <= rho <= upper (r,); step = 1: rate is the factor a step. The subspace
    is found by elimination, its eigenvalues are counted by Routh's scheme. Source: Hautus, Indagationes Mathematicae 32 (1970).
    """

    rho: tuple[float, ...]
    rate: float = 0.0
    step: int = 0
    theorem: ClassVar[str] = "undetectable"
