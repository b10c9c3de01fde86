"""A periodic switching of the parameters under which the error grows: a counterexample to a gain."""

import dataclasses
import math
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import _box, balls, exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict

LONGEST = 256  # segments, and repetitions: a hostile file could otherwise keep the check busy
LARGEST_EXPONENT = 2.0**30  # of e^{|F| t}


@dataclasses.dataclass(frozen=True)
class SwitchingInstability(AbstractCertificate):
    """For e' = F(rho) e with F(rho) = a + sum_k rho_k b_k c_k' - L output, and M = e^{F_N t_N} ... e^{F_1 t_1} over one period
    of the stored switching (step = 1: e+ = F(rho) e and M = F_N ... F_1),

        |tr M^repeats| > n

    implies an eigenvalue of M outside the unit circle, since |tr M^k| <= n (spectral radius)^k: some error grows exponentially
    while the parameters switch like that. Integer arithmetic with a bound on every rounding and on the remainder of the series.

    Shapes as in FrozenInstability; points (N, r) the values of rho in their order; durations (N,) [s] > 0, with step = 1 whole
    numbers of steps.
    """

    a: FloatMatrix
    b: FloatMatrix
    c: FloatMatrix
    output: FloatMatrix
    gain: FloatMatrix
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    points: FloatMatrix
    durations: tuple[float, ...]
    repeats: int = 1
    step: int = 0
    tied: tuple[int, ...] = ()
    theorem: ClassVar[str] = "switching instability"

    @property
    def claim(self) -> str:
        return (
            f"with the gain L = {self.gain!r} some errors grow exponentially when the parameters take the values "
            f"{self.points!r} for the times {self.durations!r}, again and again"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (_box.dynamics(self), "the parameters can switch at once between any two values")

    def verify(self) -> Verdict:
        problem = self._malformed()
        if problem:
            return Verdict(False, {}, f"not shown: {problem}")
        try:
            matrices = balls.balanced([_box.closed(self, rho) for rho in self.points])
            factors = [self._factor(f, Fraction(time)) for f, time in zip(matrices, self.durations, strict=True)]
            raised = balls.power(balls.chain(factors), self.repeats)
        except OverflowError as error:
            return Verdict(False, {}, f"not shown: {error}")
        n = len(self.a)
        trace = abs(sum(raised.middle[i][i] for i in range(n))) - n * raised.radius
        if not balls.trace_exceeds(raised, n):
            return Verdict(False, {}, f"not shown: |tr M^{self.repeats}| > {n} fails or drowns in rounding")
        growth = (math.log(trace) - balls.BITS * math.log(2) - math.log(n)) / (self.repeats * sum(self.durations))
        why = f"|tr M^{self.repeats}| > {n} over the stored period, with every rounding bounded"
        return Verdict(True, {"growth_rate": growth}, why)

    def _factor(self, f: exact.Matrix, time: Fraction) -> balls.Ball:
        return balls.power(balls.enclose(f), int(time)) if self.step else balls.exponential(f, time)

    def _malformed(self) -> str | None:
        problem = _box.problem(self, self.points)
        if problem:
            return problem
        if not (1 <= len(self.points) == len(self.durations) <= LONGEST and 1 <= self.repeats <= LONGEST):
            return (
                f"{len(self.points)} points, {len(self.durations)} durations, {self.repeats} repeats: expected 1 to {LONGEST}"
            )
        if not all(math.isfinite(t) and t > 0 for t in self.durations):
            return "a duration is not a positive number"
        if self.step and not all(t == int(t) <= LONGEST for t in self.durations):
            return f"a duration is not a whole number of steps up to {LONGEST}"
        for rho, time in zip(self.points, self.durations, strict=True):
            size = max(sum(abs(entry) for entry in row) for row in _box.closed(self, rho)) * Fraction(time)
            if not self.step and size > LARGEST_EXPONENT:
                return f"|F| t = {exact.to_float(size):.3g} is more than {LARGEST_EXPONENT:.3g}: give shorter segments"
        return None
