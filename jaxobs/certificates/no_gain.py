"""That no common quadratic Lyapunov function exists: a ray of the dual cone, for one gain, for all, or all up to a size."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractModel
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class NoGain(AbstractModel):
    """For F(rho) = a + sum_k rho_k b_k c_k' - L output and multipliers X_c >= 0, not all zero, at points rho_c of the box,

        S = sum_c F_c X_c + X_c F_c' + 2 rate X_c      (step = 1: sum_c F_c X_c F_c' - rate^2 X_c),      g = sum_c X_c output',

    S >= 0 says that no P > 0 has F_c'P + P F_c + 2 rate P < 0 (F_c'P F_c < rate^2 P) at all of them: else tr(P S) < 0. With L
    the stored gain, it is said of that gain. Without one (gain = (), so L = 0 in F): if g = 0, S is the same for all L, and it
    is said of every gain; if

        [S - t radius^2 I, g; g', t I] >= 0,  t > 0,

    then S - L g' - g L' >= S - t L L' - g g'/t >= 0 for L L' <= radius^2 I, and it is said of every gain with |L| <= radius.
    It does not say that errors grow: another kind of Lyapunov function may exist. From a single point with one gain it says
    that some error decays no faster than at the rate. With step = 1 and g = 0 every X_c output' is 0, since the X_c are >= 0.

    a (n, n), b (n, r), c (r, n), output (p, n), gain (n, p) or (), lower, upper (r,), points (N, r), multipliers (N n, n), one
    below the other; step = 1: rate is the factor a step; radius = t = 0 where there is none. Source: Boyd, El Ghaoui, Feron and
    Balakrishnan, Linear Matrix Inequalities in System and Control Theory, 1994, section 2.2.1; Petersen, Systems and Control
    Letters 8 (1987) 351-357 (t).
    """

    gain: FloatMatrix
    points: FloatMatrix
    multipliers: FloatMatrix
    rate: float = 0.0
    step: int = 0
    radius: float = 0.0
    t: float = 0.0
    theorem: ClassVar[str] = "no-gain"
