"""A decay rate for slopes that are bounded on a box only, with the errors from which the estimate never leaves it."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractUncertainError
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class Regional(AbstractUncertainError):
    """For e' = F(rho) e with lower <= rho <= upper as long as x and xhat = x - e both lie in B = {outer_lower <= H x <=
    outer_upper}, H = faces, and a state that stays in S = {inner_lower <= H x <= inner_upper}: with the half-widths

        w_j = min(outer_upper_j - inner_upper_j, inner_lower_j - outer_lower_j) > 0,

        P > 0,   F'P + P F + 2 rate P < 0 at all corners,   [P, h_j; h_j', w_j^2 / level] > 0 for all rows h_j' of H

    imply that every e(0) with e(0)'P e(0) <= level, so every one with |e(0)| <= radius where level I - radius^2 P > 0, keeps
    xhat in B for ever and decays: |e(t)| <= sqrt(cond P) e^{-rate t} |e(0)|.

    Proof. e'P e <= level implies |h_j'e|^2 <= level h_j'P^-1 h_j < w_j^2 (Schur), so xhat is in B, and B, convex, holds the
    segment between x and xhat: the bounds apply, e'P e falls, and xhat cannot reach the border of B.

    p (n, n), rate [1/s] >= 0, faces (m, n), the four bounds (m,), level > 0, radius >= 0; else as in Corners. Source: Boyd et
    al., Linear Matrix Inequalities in System and Control Theory, 1994, section 5.1 (invariant ellipsoids in polytopes).
    """

    p: FloatMatrix
    rate: float
    faces: FloatMatrix
    inner_lower: tuple[float, ...]
    inner_upper: tuple[float, ...]
    outer_lower: tuple[float, ...]
    outer_upper: tuple[float, ...]
    level: float
    radius: float
    theorem: ClassVar[str] = "regional"
