"""A guaranteed energy gain beside a decay rate, each by a Lyapunov matrix of its own."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates.base import AbstractCertificate, FloatMatrix


@dataclasses.dataclass(frozen=True)
class L2Level(AbstractCertificate):
    """For e' = F(rho) e + process w - G(rho) noise v, F and G as in H2Level: P proves the rate as in Corners, and

        [ -(F'Q + Q F) - E'E    -Q process      Q G noise ]
        [         *              level^2 I          0     ]  > 0,   Q > 0,   at all corners
        [         *                  *          level^2 I ]

    prove that the energy of E e is at most level^2 times that of (w, v), from e(0) = 0, for every rho(t) within the bounds.

    Shapes as in H2Level. Source: Boyd et al., Linear Matrix Inequalities in System and Control Theory, 1994, section 6.3.2.
    """

    a: FloatMatrix
    b: FloatMatrix
    c: FloatMatrix
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    output: FloatMatrix
    gain: FloatMatrix
    p: FloatMatrix
    rate: float
    weight: FloatMatrix
    process: FloatMatrix
    noise: FloatMatrix
    level: float
    q: FloatMatrix
    x: FloatMatrix = ()
    origin: str = "given"
    tied: tuple[int, ...] = ()
    inner: FloatMatrix = ()
    left: FloatMatrix = ()
    right: FloatMatrix = ()
    tau: float = 0.0
    taus: tuple[float, ...] = ()
    taus_q: tuple[float, ...] = ()
    theorem: ClassVar[str] = "l2"
