"""A floor on the size of every gain that does its work at constant parameters."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractModel
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class GainFloor(AbstractModel):
    """For one output C and A_c = a + sum_k rho_k b_k c_k' + rate I at the points rho_c of the box,

        det(s I - A_c + L C) = s^n + sum_k (alpha_ck + C B_ck L) s^{n-k},   B_c1 = I,  B_c,k+1 = A_c B_ck + alpha_ck I,

    has no root with Re s >= 0, so positive coefficients, if the error decays faster than e^{-rate t} at all constant rho. With
    weights w_ck >= 0, m = sum w_ck C B_ck and alpha = -sum w_ck alpha_ck > 0 then m L > alpha, so that

        |L| > level   if   level |m| <= alpha.

    One quadratic Lyapunov function for the box implies that decay: the floor holds for every gain that it certifies.

    a (n, n), b (n, r), c (r, n), output (1, n), lower, upper (r,), points (N, r), weights (N n,). Source: Gantmacher, The
    Theory of Matrices I, chapter IV (the coefficients, Faddeev and LeVerrier) and II, chapter XV (their signs, Stodola).
    """

    points: FloatMatrix
    weights: tuple[float, ...]
    rate: float
    level: float
    theorem: ClassVar[str] = "gain-floor"
