"""One constant value of the parameters at which the error does not decay: a counterexample to a gain."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates import _box, exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict
from jaxobs.certificates.routh import Count, frozen

LONGEST = 1536  # binary digits of F(rho): a hostile file could otherwise keep the check busy


@dataclasses.dataclass(frozen=True)
class FrozenInstability(AbstractCertificate):
    """For e' = F(rho) e (step = 1: e+ = F(rho) e) with F(rho) = a + sum_k rho_k b_k c_k' - L output, at the stored constant rho

        some eigenvalue of F(rho) has Re s > 0 (|z| > 1),

    counted by Routh's scheme in rational arithmetic, implies that errors grow exponentially while the parameters stay there.

    a (n, n), b (n, r), c (r, n), output (p, n), gain L (n, p), lower <= rho <= upper (r,). Source: Gantmacher, The Theory of
    Matrices II, chapter XV.
    """

    a: FloatMatrix
    b: FloatMatrix
    c: FloatMatrix
    output: FloatMatrix
    gain: FloatMatrix
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    rho: tuple[float, ...]
    step: int = 0
    tied: tuple[int, ...] = ()
    theorem: ClassVar[str] = "frozen instability"

    @property
    def claim(self) -> str:
        return f"with the gain L = {self.gain!r} and the constant parameters {self.rho!r} some errors grow exponentially"

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (_box.dynamics(self),)

    def count(self) -> Count:
        """The eigenvalues of F(rho): inside, on and outside the stability boundary."""
        return frozen(self.matrix(), step=bool(self.step))

    def matrix(self) -> exact.Matrix:
        """F(rho)."""
        return _box.closed(self, self.rho)

    def verify(self) -> Verdict:
        problem = _box.problem(self, [self.rho])
        if problem:
            return Verdict(False, {}, f"not shown: {problem}")
        if exact.bits(self.matrix()) > LONGEST:
            return Verdict(False, {}, f"not shown: F(rho) has more than {LONGEST} binary digits")
        count = self.count()
        margins = {"outside": float(count.outside), "border": float(count.border)}
        where = "outside the unit circle" if self.step else "in the open right half plane"
        if not count.outside:
            return Verdict(False, margins, f"not shown: no eigenvalue lies {where} at these parameters")
        return Verdict(True, margins, f"{count.outside} of {len(self.a)} eigenvalues lie {where}, in exact arithmetic")
