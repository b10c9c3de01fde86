"""A guaranteed energy gain beside a decay rate, each by a Lyapunov matrix of its own."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractUncertainError
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class L2Level(AbstractUncertainError):
    """For e' = F(rho) e + process w - G(rho) noise v, F and G as in H2Level: P proves the rate as in Corners, and

        [ -(F'Q + Q F) - E'E    -Q process      Q G noise ]
        [         *              level^2 I          0     ]  > 0,   Q > 0,   at all corners
        [         *                  *          level^2 I ]

    prove that the energy of E e is at most level^2 times that of (w, v), from e(0) = 0, for every rho(t) within the bounds.

    Shapes as in H2Level. Source: Boyd et al., Linear Matrix Inequalities in System and Control Theory, 1994, section 6.3.2.
    """

    p: FloatMatrix
    rate: float
    weight: FloatMatrix
    process: FloatMatrix
    noise: FloatMatrix
    level: float
    q: FloatMatrix
    taus_q: tuple[float, ...] = ()
    theorem: ClassVar[str] = "l2"
