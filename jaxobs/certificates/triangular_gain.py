"""Theorem 1 of paper 003 with its constants: a constant gain for a triangular system whose couplings keep their signs."""

import dataclasses
import itertools
import math
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict

LARGEST = 12  # states: 2^11 corners


@dataclasses.dataclass(frozen=True)
class TriangularGain(AbstractCertificate):
    """The error e of z' = F(u, z) + L (y - z_1), in the coordinates eps_i = e_i / theta^i, obeys

        eps' = (M(a) + N) eps,  M(a) = theta A(a) - (L_i theta^{1-i})_i C,   |N_ij| <= beta_ij = slopes_ij theta^{j-i}, j <= i,

    a_i = dF_i/dz_{i+1} in [lower_i, upper_i]. With P > 0, p_i its i-th column, weights w_ij > 0, and at every corner of the box

        -(M'P + P M) - 2 rate P - sum_{j <= i} beta_ij (w_ij p_i p_i' + e_j e_j' / w_ij) > 0,

    eps'P eps falls at least like e^{-2 rate t}. lower, upper (n - 1,); slopes (n, n), lower triangular, bounds of |dF_i/dz_j|;
    gain (n,); p, weights (n, n); theta > 0; rate [1/s]. origin: where the bounds come from. Source: paper 003, lemma 1 and
    theorem 1; the print needs one K and P for all signs, here each a_i keeps its own.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    slopes: FloatMatrix
    gain: tuple[float, ...]
    p: FloatMatrix
    weights: FloatMatrix
    theta: float
    rate: float
    origin: str = "given"
    theorem: ClassVar[str] = "triangular gain"

    @property
    def claim(self) -> str:
        return (
            f"the error decays at least like exp(-{self.rate!r} t) with the gain L = {self.gain!r}, for all couplings between "
            f"{self.lower!r} and {self.upper!r} and slopes up to {self.slopes!r}"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (
            "the plant is z_i' = F_i(u, z_1, ..., z_{i+1}), y = z_1, and the observer has the same F",
            f"the derivatives of F stay within the stored bounds, for every u and z that occur (bounds: {self.origin})",
            "no measurement noise; gains in real arithmetic",
        )

    def verify(self) -> Verdict:
        problem = self._malformed()
        if problem:
            return Verdict(False, {}, f"not certified: {problem}")
        p, n, theta = exact.matrix(self.p), len(self.gain), Fraction(self.theta)
        if not exact.is_positive_definite(p):
            return Verdict(False, {}, "not certified: P > 0 fails")
        rest = exact.scale(-2 * Fraction(self.rate), p)
        for i in range(n):
            for j in range(i + 1):
                w, beta = Fraction(self.weights[i][j]), Fraction(self.slopes[i][j]) * theta ** (j - i)
                rest = [[rest[k][m] - beta * w * p[k][i] * p[m][i] for m in range(n)] for k in range(n)]
                rest[j][j] -= beta / w

        def decrease(m: exact.Matrix) -> exact.Matrix:
            pm = exact.product(p, m)
            return exact.scale(Fraction(-1), exact.add(pm, exact.transpose(pm)))

        injection, couplings = self._parts(theta)
        ends = [sorted({lo, hi}) for lo, hi in zip(self.lower, self.upper, strict=True)]
        try:
            _, corners = exact.at_corners(exact.add(rest, decrease(injection)), [decrease(m) for m in couplings], ends)
        except exact.TooLong as error:
            return Verdict(False, {}, f"not certified: {error}")
        for corner, matrix in corners:
            if not exact.is_positive_definite(matrix):
                return Verdict(False, {}, f"not certified: the inequality fails at the corner a = {corner}")
        return Verdict(True, {"decay_rate": self.rate}, "all corner inequalities hold, in exact arithmetic")

    def _parts(self, theta: Fraction) -> tuple[exact.Matrix, list[exact.Matrix]]:
        """M(a) = the first + sum_i a_i (the i-th of the others)."""
        n = len(self.gain)
        injection = [
            [-Fraction(gain) * theta**-i if j == 0 else Fraction(0) for j in range(n)] for i, gain in enumerate(self.gain)
        ]
        couplings = [exact.zeros(n, n) for _ in range(n - 1)]
        for i, m in enumerate(couplings):
            m[i][i + 1] = theta
        return injection, couplings

    def _malformed(self) -> str | None:
        n = len(self.gain)
        if not 1 <= n <= LARGEST:
            return f"{n} states: expected 1 to {LARGEST}"
        if not len(self.lower) == len(self.upper) == n - 1:
            return f"{len(self.lower)} and {len(self.upper)} bounds for {n} states"
        for name in ("slopes", "p", "weights"):
            value = getattr(self, name)
            if len(value) != n or any(len(row) != n for row in value):
                return f"{name} is not of shape {(n, n)}"
        rows = itertools.chain(*self.slopes, *self.p, *self.weights)
        numbers = (*self.lower, *self.upper, *self.gain, self.theta, self.rate, *rows)
        if not all(math.isfinite(x) for x in numbers):
            return "a stored number is not finite"
        if not (self.theta > 0 and all(w > 0 for row in self.weights for w in row) and self.rate >= 0):
            return "theta and the weights must be positive, the rate not negative"
        if any(lo > hi for lo, hi in zip(self.lower, self.upper, strict=True)):
            return "a lower bound exceeds its upper bound"
        if any(self.slopes[i][j] < 0 or (j > i and self.slopes[i][j] != 0) for i in range(n) for j in range(n)):
            return "the slopes are not lower triangular and >= 0"
        return None
