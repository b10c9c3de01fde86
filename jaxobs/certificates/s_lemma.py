"""A quadratic Lyapunov function for every phi with a norm-bounded slope: the S-lemma, in continuous time."""

import dataclasses
import math
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import _chain, exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict


@dataclasses.dataclass(frozen=True)
class SLemma(AbstractCertificate):
    """For x' = A x + B phi(x, u), B dphi/dx = M F N with |F| <= 1, observed through y = x_1 with the gain L: with K = A - L C,

        X > 0   and   [-K'X - X K - 2 rate X - tau N'N,  -X M;  -M'X,  tau I] > 0

    imply |e(t)| <= sqrt(cond X) e^{-rate t} |e(0)|. It is necessary too: no other quadratic form does it where none of these
    does. Behind q integrators A and C are the augmented ones, M has q zero rows above, N q zero columns to the left.

    n states, q integrators, gain L (n + q,), left M (n, r), right N (s, n), x (n + q, n + q), tau > 0, rate [1/s] >= 0.
    origin: where the slopes come from, a sentence.
    Source: Boyd et al., Linear Matrix Inequalities in System and Control Theory, section 5.1; its use instead of (5) is ours.
    """

    n: int
    q: int
    gain: tuple[float, ...]
    left: FloatMatrix
    right: FloatMatrix
    x: FloatMatrix
    tau: float
    rate: float = 0.0
    origin: str = "given"
    theorem: ClassVar[str] = "s-lemma"

    @property
    def claim(self) -> str:
        kind = "" if self.q == 0 else f" behind {self.q} integrators"
        return (
            f"the error of the chain observer with n = {self.n} and the gain L = {self.gain!r}{kind} decays "
            f"exponentially, at least like exp(-{self.rate!r} t), for every phi "
            f"with B dphi/dx = M F N, |F| <= 1, M = {self.left!r}, N = {self.right!r}"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (
            "the plant is x_i' = x_{i+1}, x_n' = phi(x, u), y = x_1, and the observer has the same phi",
            f"the slopes of phi stay within the stored bound for all x and all u that occur (bounds: {self.origin!r})",
            "continuous time, without measurement noise; gains in real arithmetic",
        )

    def verify(self) -> Verdict:
        size = self.n + self.q
        shapes = {"M": (self.left, self.n, None), "N": (self.right, None, self.n), "X": (self.x, size, size)}
        problem = _chain.malformed(self.n, self.q, self.gain, shapes)
        if problem is None and not (math.isfinite(self.tau) and self.tau > 0 and math.isfinite(self.rate) and self.rate >= 0):
            problem = "tau must be positive and the rate nonnegative"
        if problem:
            return Verdict(False, {}, f"not certified: {problem}")
        x, tau = exact.matrix(self.x), Fraction(self.tau)
        if not exact.is_positive_definite(x):
            return Verdict(False, {}, "not certified: X > 0 fails")
        m, n = _chain.augmented(self.left, self.right, self.q)
        xk = exact.product(x, exact.subtract(_chain.shift(size), _chain.injection(self.gain)))
        xm = exact.scale(Fraction(-1), exact.product(x, m))
        load = exact.add(exact.scale(2 * Fraction(self.rate), x), exact.scale(tau, exact.product(exact.transpose(n), n)))
        decrease = exact.scale(Fraction(-1), exact.add(exact.add(xk, exact.transpose(xk)), load))
        whole = exact.block([[decrease, xm], [exact.transpose(xm), exact.scale(tau, exact.identity(len(m[0])))]])
        try:
            exact.require_short(exact.work(exact.bits(whole), len(whole)))
        except exact.TooLong as error:
            return Verdict(False, {}, f"not certified: {error}")
        if not exact.is_positive_definite(whole):
            return Verdict(False, {}, "not certified: the matrix of the S-lemma is not positive definite")
        return Verdict(True, {"decay_rate": self.rate}, "the inequality of the S-lemma holds, in exact arithmetic")
