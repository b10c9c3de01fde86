"""A periodic switching of the parameters under which the error grows: a counterexample to a gain."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractModel
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class SwitchingInstability(AbstractModel):
    """For e' = F(rho) e with F(rho) = a + sum_k rho_k b_k c_k' - L output, and M = e^{F_N t_N} ... e^{F_1 t_1} over one period
    of the stored switching (step = 1: e+ = F(rho) e and M = F_N ... F_1),

        |tr M^repeats| > n

    implies an eigenvalue of M outside the unit circle, since |tr M^k| <= n (spectral radius)^k: some error grows exponentially
    while the parameters switch like that. Integer arithmetic with a bound on every rounding and on the remainder of the series.

    Shapes as in FrozenInstability; points (N, r) the values of rho in their order; durations (N,) [s] > 0, with step = 1 whole
    numbers of steps. scale (n,): powers of two of coordinates in which rows and columns are of like size, so that fewer digits
    are lost to rounding; () for none.
    """

    gain: FloatMatrix
    points: FloatMatrix
    durations: tuple[float, ...]
    repeats: int = 1
    step: int = 0
    scale: tuple[int, ...] = ()
    theorem: ClassVar[str] = "switching-instability"
