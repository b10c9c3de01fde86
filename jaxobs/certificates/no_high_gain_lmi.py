"""A proof of absence: the HG/LMI conditions (31)-(32) of paper 002 have no solution at this theta, nor at any smaller one."""

import dataclasses
import itertools
import math
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import _chain_lmi as chain
from jaxobs.certificates import exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict


@dataclasses.dataclass(frozen=True)
class NoHighGainLmi(AbstractCertificate):
    """With multipliers X_c >= 0, one a corner psi_c of the box at theta, F_c = A + B psi_c' - K C, and a witness W >= 0,

        W + sum_c (F_c X_c + X_c F_c') >= 0   and   theta^{1+j0} tr W <= 2 constant sum_c tr X_c   (sum of traces > 0)

    no P, lam satisfy (31)-(32) with any sigma <= theta' <= theta: tracing (31) with the X_c gives lam sum tr X_c < tr(P W)
    <= lambda_max(P) tr W. Without a gain the claim is for every K: then X_c C' = 0 is asked, and K drops out.

    gain K (n,) in the coordinates of T(theta), or () for any; multipliers: the X_c one below the other in the order of the
    corners (2^j0 n, n); w (n, n). It says that no certificate of this kind exists, never that an observer is unstable.
    """

    gain: tuple[float, ...]
    theta: float
    j0: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    constant: float
    multipliers: FloatMatrix
    w: FloatMatrix
    theorem: ClassVar[str] = "no HG/LMI"

    @property
    def claim(self) -> str:
        whose = f"the gain K = {self.gain!r}" if self.gain else "any gain K"
        return (
            f"(31)-(32) with j0 = {self.j0} and the constant {self.constant!r} have no solution for {whose} at theta = "
            f"{self.theta!r} or less, for slopes in [{self.lower!r}, {self.upper!r}]"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return ("none: a statement on matrices; another certificate may exist, and the observer may converge",)

    def verify(self) -> Verdict:
        problem = self._malformed()
        if problem:
            return Verdict(False, {}, f"not certified: {problem}")
        n = len(self.lower)
        gain = [Fraction(x) for x in self.gain] or [Fraction(0)] * n
        rows = exact.matrix(self.multipliers)
        try:
            exact.require_short(exact.work(exact.bits(rows), n, len(rows) // n))
        except exact.TooLong as error:
            return Verdict(False, {}, f"not certified: {error}")
        total, mass = exact.zeros(n, n), Fraction(0)
        for c, corner in enumerate(chain.vertices(self.lower, self.upper, self.j0, self.theta)):
            x = rows[c * n : (c + 1) * n]
            if not _semidefinite(x):
                return Verdict(False, {}, f"not certified: the multiplier of corner {c} is not positive semidefinite")
            if not self.gain and any(row[0] for row in x):
                return Verdict(False, {}, f"not certified: the multiplier of corner {c} does not cancel the gain")
            fx = exact.product(chain.error_matrix(gain, corner), x)
            total = exact.add(total, exact.add(fx, exact.transpose(fx)))
            mass += sum(x[i][i] for i in range(n))
        w = exact.matrix(self.w)
        if not (_semidefinite(w) and _semidefinite(exact.add(w, total))):
            return Verdict(False, {}, "not certified: W >= 0 or W + sum (F X + X F') >= 0 fails")
        trace = sum((w[i][i] for i in range(n)), Fraction(0))
        margins = {"largest_lambda": exact.to_float(trace / mass) if mass else math.inf}
        if not (mass > 0 and Fraction(self.theta) ** (1 + self.j0) * trace <= 2 * Fraction(self.constant) * mass):
            return Verdict(False, margins, "not certified: theta^{1+j0} tr W <= 2 k sum tr X fails")
        return Verdict(True, margins, "the multipliers refute (31)-(32), in exact arithmetic")

    def _malformed(self) -> str | None:
        n = len(self.lower)
        numbers = {"theta": self.theta, "lam": 1.0, "nu": 1.0, "constant": self.constant}
        problem = chain.malformed(self.gain or self.lower, self.lower, self.upper, self.j0, self.w, numbers)
        if problem:
            return problem
        count = math.prod(len({lo, hi}) for lo, hi in zip(self.lower[n - self.j0 :], self.upper[n - self.j0 :], strict=True))
        if len(self.multipliers) != count * n or any(len(row) != n for row in self.multipliers):
            return f"{len(self.multipliers)} rows of multipliers: expected {count} blocks of shape {(n, n)}"
        if not all(math.isfinite(x) for x in itertools.chain(*self.multipliers)):
            return "a multiplier is not finite"
        if any(lo > 0 or hi < 0 for lo, hi in zip(self.lower, self.upper, strict=True)):
            return "a pair of bounds excludes 0: smaller theta would not have larger boxes"
        return None


def _semidefinite(x: exact.Matrix) -> bool:
    """Symmetric, and positive definite once the rows that are zero are left out (a sufficient test)."""
    if x != exact.transpose(x):
        return False
    kept = [i for i, row in enumerate(x) if any(row)]
    return not kept or exact.is_positive_definite([[x[i][j] for j in kept] for i in kept])
