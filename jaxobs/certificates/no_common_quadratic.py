"""Up to three values of the parameters that share no quadratic Lyapunov function: what no LMI of this kind can certify."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates import _box, exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict
from jaxobs.certificates.common_quadratic import common_quadratic

LONGEST = 768  # binary digits of an F(rho): a hostile file could otherwise keep the check busy


@dataclasses.dataclass(frozen=True)
class NoCommonQuadratic(AbstractCertificate):
    """For n = 2 and F(rho) = a + sum_k rho_k b_k c_k' - L output, there is no P > 0 with

        F'P + P F < 0     (step = 1: F'P F < P)     at the stored values of rho, one to three of them.

    It does not say that the error grows: another kind of Lyapunov function may exist.

    Shapes as in FrozenInstability, n = 2; points (1 to 3, r), within the bounds. Source: Helly's theorem with the plane of all
    P = [[1, x], [x, y]]; for two matrices the criterion of Shorten and Narendra, Int. J. Adapt. Control 16 (2002).
    """

    a: FloatMatrix
    b: FloatMatrix
    c: FloatMatrix
    output: FloatMatrix
    gain: FloatMatrix
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    points: FloatMatrix
    step: int = 0
    tied: tuple[int, ...] = ()
    theorem: ClassVar[str] = "no common quadratic"

    @property
    def claim(self) -> str:
        return (
            f"with the gain L = {self.gain!r} no quadratic Lyapunov function decreases strictly "
            f"at all of the parameters {self.points!r}"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (_box.dynamics(self),)

    def verify(self) -> Verdict:
        problem = _box.problem(self, self.points)
        if problem is None and not (len(self.a) == 2 and 1 <= len(self.points) <= 3):
            problem = f"{len(self.a)} states and {len(self.points)} points: expected 2 states and 1 to 3 points"
        if problem:
            return Verdict(False, {}, f"not shown: {problem}")
        matrices = [_box.closed(self, rho) for rho in self.points]
        if max(map(exact.bits, matrices)) > LONGEST:
            return Verdict(False, {}, f"not shown: an F(rho) has more than {LONGEST} binary digits")
        decision = common_quadratic(matrices, step=bool(self.step))
        if decision.exists:
            return Verdict(False, {}, "not shown: the points share a quadratic Lyapunov function")
        return Verdict(True, {}, "the points share no quadratic Lyapunov function, in exact arithmetic")
