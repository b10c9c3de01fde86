"""One constant value of the parameters at which the error does not decay: a counterexample to a gain."""

import dataclasses
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import exact
from jaxobs.certificates._model import AbstractModel
from jaxobs.certificates.base import FloatMatrix
from jaxobs.certificates.routh import Count, frozen


@dataclasses.dataclass(frozen=True)
class FrozenInstability(AbstractModel):
    """For e' = F(rho) e (step = 1: e+ = F(rho) e) with F(rho) = a + sum_k rho_k b_k c_k' - L output, at the stored constant rho

        some eigenvalue of F(rho) has Re s > 0 (|z| > 1),

    counted by Routh's scheme in rational arithmetic, implies that errors grow exponentially while the parameters stay there.

    a (n, n), b (n, r), c (r, n), output (p, n), gain L (n, p), lower <= rho <= upper (r,). Source: Gantmacher, The Theory of
    Matrices II, chapter XV.
    """

    gain: FloatMatrix
    rho: tuple[float, ...]
    step: int = 0
    theorem: ClassVar[str] = "frozen-instability"

    def count(self) -> Count:
        """The eigenvalues of F(rho): inside, on and outside the stability boundary."""
        return frozen(self.matrix(), step=bool(self.step))

    def matrix(self) -> exact.Matrix:
        """F(rho)."""
        a, b, c, output, gain = (exact.matrix(x) for x in (self.a, self.b, self.c, self.output, self.gain))
        f = exact.subtract(a, exact.product(gain, output))
        weighted = [[Fraction(x) * entry for entry in row] for x, row in zip(self.rho, c, strict=True)]
        return exact.add(f, exact.product(b, weighted)) if weighted else f
