"""Output injection: the error is linear, and a Lyapunov matrix proves its rate."""

import dataclasses
import math
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import _chain, exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict


@dataclasses.dataclass(frozen=True)
class LinearError(AbstractCertificate):
    """For x' = A x + B phi(y, u), y = x_1, and z' = A z + B phi(y, u) + L (y - z_1): with K = A - L C,

        X > 0   and   -K'X - X K - 2 rate X > 0

    imply |e(t)| <= sqrt(cond X) e^{-rate t} |e(0)|, whatever phi is: no bound on it is needed.

    n states, gain L (n,), x (n, n), rate [1/s] >= 0. Source: Krener and Isidori, Systems & Control Letters 3 (1983) 47-52.
    """

    n: int
    gain: tuple[float, ...]
    x: FloatMatrix
    rate: float = 0.0
    theorem: ClassVar[str] = "linear-error"

    @property
    def claim(self) -> str:
        return (
            f"the error of the output injection observer with n = {self.n} and the gain L = {self.gain!r} decays "
            f"exponentially, at least like exp(-{self.rate!r} t), for every phi(y, u)"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (
            "the plant is x_i' = x_{i+1}, x_n' = phi(x_1, u), y = x_1: phi knows no other state",
            "the observer evaluates the same phi at the measured y",
            "continuous time, without measurement noise; gains in real arithmetic",
        )

    def verify(self) -> Verdict:
        problem = _chain.malformed(self.n, 0, self.gain, {"X": (self.x, self.n, self.n)})
        if problem is None and not (math.isfinite(self.rate) and self.rate >= 0):
            problem = "the rate must be nonnegative"
        if problem:
            return Verdict(False, {}, f"not certified: {problem}")
        x = exact.matrix(self.x)
        if not exact.is_positive_definite(x):
            return Verdict(False, {}, "not certified: X > 0 fails")
        xk = exact.product(x, exact.subtract(_chain.shift(self.n), _chain.injection(self.gain)))
        growth = exact.add(exact.add(xk, exact.transpose(xk)), exact.scale(2 * Fraction(self.rate), x))
        if not exact.is_positive_definite(exact.scale(Fraction(-1), growth)):
            return Verdict(False, {}, "not certified: K'X + X K + 2 rate X < 0 fails")
        return Verdict(True, {"decay_rate": self.rate}, "the Lyapunov inequality holds, in exact arithmetic")
