"""A proof of absence: the HG/LMI conditions (31)-(32) of paper 002 have no solution at this theta, nor at any smaller one."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates.base import AbstractCertificate, FloatMatrix


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
    theorem: ClassVar[str] = "no-hg-lmi"
