"""The HG/LMI observer of a chain, (31)-(32) of paper 002: the last j0 slopes by corners, the others by high gain."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates.base import AbstractCertificate, FloatMatrix


@dataclasses.dataclass(frozen=True)
class HighGainLmi(AbstractCertificate):
    """With K = T(theta)^-1 L, T(theta) = diag(theta^i), and witnesses P, lam, nu, constant,

        P > 0,   nu I - P > 0,   theta >= sigma,   theta^{1+j0} lam > 2 constant nu,
        (A + B psi' - K C)'P + P (A + B psi' - K C) + lam I < 0   at the 2^j0 corners psi of the box at sigma, (27),
        constant^2 >= sum_{i <= n-j0} max(|lower_i|, |upper_i|)^2 theta^{2(i-n+j0)},   lower_i <= 0 <= upper_i for i > n - j0

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
    theorem: ClassVar[str] = "hg-lmi"
