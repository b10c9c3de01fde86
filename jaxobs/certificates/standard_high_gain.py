"""The standard high-gain observer of a chain, (15)-(16) of paper 002, and its form for f without the last states, (19)-(20)."""

import dataclasses
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import _chain_lmi as chain
from jaxobs.certificates import exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict


@dataclasses.dataclass(frozen=True)
class StandardHighGain(AbstractCertificate):
    """With K = T(theta)^-1 L, T(theta) = diag(theta^i), and witnesses P, lam, nu, constant,

        P > 0,   nu I - P > 0,   (A - K C)'P + P (A - K C) + lam I < 0,   theta^{1+j0} lam > 2 constant nu,
        constant^2 >= sum_{i <= n-j0} max(|lower_i|, |upper_i|)^2 theta^{2(i-n+j0)},   lower_i = upper_i = 0 for i > n - j0

    the error decays exponentially for every f with slopes psi_i in [lower_i, upper_i]. j0 = 0: theorem 2.1; else 3.2.

    gain L (n,), theta >= 1, lower, upper (n,), p (n, n). Source: paper 002, (15)-(16) and (19)-(20).
    """

    gain: tuple[float, ...]
    theta: float
    j0: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    constant: float
    p: FloatMatrix
    lam: float
    nu: float
    theorem: ClassVar[str] = "standard high gain"

    @property
    def claim(self) -> str:
        return (
            f"the error of the observer with gain L = {self.gain!r} (theta = {self.theta!r}) decays exponentially for every f "
            f"with slopes in [{self.lower!r}, {self.upper!r}]"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (chain.PLANT, chain.bounded(self.lower, self.upper), chain.TIME)

    def verify(self) -> Verdict:
        numbers = {"theta": self.theta, "lam": self.lam, "nu": self.nu, "constant": self.constant}
        problem = chain.malformed(self.gain, self.lower, self.upper, self.j0, self.p, numbers)
        if problem:
            return Verdict(False, {}, f"not certified: {problem}")
        last = len(self.lower) - self.j0
        if any(x != 0 for x in (*self.lower[last:], *self.upper[last:])):
            return Verdict(False, {}, f"not certified: f depends on its last {self.j0} states, (17) fails")
        theta, k, lam, nu = (Fraction(x) for x in (self.theta, self.constant, self.lam, self.nu))
        if k**2 < chain.constant_squared(self.lower, self.upper, self.j0, self.theta):
            return Verdict(False, {}, f"not certified: the constant {self.constant:.9g} is too small for the slopes, (18)")
        p = exact.matrix(self.p)
        if not chain.between(p, nu):
            return Verdict(False, {}, f"not certified: 0 < P < nu I fails for nu = {self.nu:.9g}")
        f = chain.error_matrix(chain.scaled_gain(self.gain, self.theta), [Fraction(0)] * len(p))
        if not exact.is_positive_definite(chain.decrease(f, p, lam)):
            return Verdict(False, {}, f"not certified: (A - K C)'P + P (A - K C) + lam I < 0 fails for lam = {self.lam:.9g}")
        margins = {"decay_rate": exact.to_float(chain.rate(theta, self.j0, k, lam, nu))}
        if not theta ** (1 + self.j0) * lam > 2 * k * nu:
            return Verdict(False, margins, "not certified: theta^{1+j0} > 2 k nu / lam fails")
        return Verdict(True, margins, "the inequalities hold for the stored gain and slopes, in exact arithmetic")
