"""The HG/LMI observer of a chain, (31)-(32) of paper 002: the last j0 slopes by corners, the others by high gain."""

import dataclasses
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import _chain_lmi as chain
from jaxobs.certificates import exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict


@dataclasses.dataclass(frozen=True)
class HighGainLmi(AbstractCertificate):
    """With K = T(theta)^-1 L, T(theta) = diag(theta^i), and witnesses P, lam, nu, constant,

        P > 0,   nu I - P > 0,   theta >= sigma,   theta^{1+j0} lam > 2 constant nu,
        (A + B psi' - K C)'P + P (A + B psi' - K C) + lam I < 0   at the 2^j0 corners psi of the box at sigma, (27),
        constant^2 >= sum_{i <= n-j0} max(|lower_i|, |upper_i|)^2 theta^{2(i-n+j0)},   lower <= 0 <= upper

    the error decays exponentially for every f with slopes psi_i in [lower_i, upper_i] (theorem 3.3; j0 = n: LPV/LMI).

    gain L (n,), theta >= 1, sigma > 0, lower, upper (n,), p (n, n). Source: paper 002, (26)-(27) and (31)-(32).
    """

    gain: tuple[float, ...]
    theta: float
    sigma: float
    j0: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    constant: float
    p: FloatMatrix
    lam: float
    nu: float
    theorem: ClassVar[str] = "HG/LMI"

    @property
    def claim(self) -> str:
        return (
            f"the error of the observer with gain L = {self.gain!r} (theta = {self.theta!r}, j0 = {self.j0}) decays "
            f"exponentially for every f with slopes in [{self.lower!r}, {self.upper!r}]"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (chain.PLANT, chain.bounded(self.lower, self.upper), chain.TIME)

    def verify(self) -> Verdict:
        numbers = {"theta": self.theta, "lam": self.lam, "nu": self.nu, "constant": self.constant, "sigma": self.sigma}
        problem = chain.malformed(self.gain, self.lower, self.upper, self.j0, self.p, numbers)
        if problem or not 0 < self.sigma <= self.theta:
            return Verdict(False, {}, f"not certified: {problem or 'sigma is outside ]0, theta]'}")
        if any(lo > 0 or hi < 0 for lo, hi in zip(self.lower, self.upper, strict=True)):
            return Verdict(False, {}, "not certified: a pair of bounds excludes 0, (28) needs it inside")
        theta, k, lam, nu = (Fraction(x) for x in (self.theta, self.constant, self.lam, self.nu))
        if k**2 < chain.constant_squared(self.lower, self.upper, self.j0, self.theta):
            return Verdict(False, {}, f"not certified: the constant {self.constant:.9g} is too small for the slopes, (30)")
        p = exact.matrix(self.p)
        if not chain.between(p, nu):
            return Verdict(False, {}, f"not certified: 0 < P < nu I fails for nu = {self.nu:.9g}")
        scaled = chain.scaled_gain(self.gain, self.theta)
        start = chain.decrease(chain.error_matrix(scaled, [Fraction(0)] * len(p)), p, lam)
        try:
            _, corners = exact.at_corners(start, *chain.slopes(self.lower, self.upper, self.j0, self.sigma, p))
        except exact.TooLong as error:
            return Verdict(False, {}, f"not certified: {error}")
        for psi, matrix in corners:
            if not exact.is_positive_definite(matrix):
                return Verdict(False, {}, f"not certified: (31) fails at the corner psi = {list(psi)} for lam = {self.lam:.9g}")
        margins = {"decay_rate": exact.to_float(chain.rate(theta, self.j0, k, lam, nu))}
        if not theta ** (1 + self.j0) * lam > 2 * k * nu:
            return Verdict(False, margins, "not certified: theta^{1+j0} > 2 k nu / lam fails, (32)")
        return Verdict(
            True, margins, f"(31) at {2**self.j0} corners and (32) hold for the stored gain and slopes, in exact arithmetic"
        )
