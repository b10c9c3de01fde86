"""One quadratic Lyapunov function at all corners of a box of parameters: continuous time, and discrete time."""

import dataclasses
import math
import operator
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import _box, exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict

LARGEST = 12  # parameters: a hostile file could otherwise keep the check busy


@dataclasses.dataclass(frozen=True)
class Corners(AbstractCertificate):
    """For e' = F(rho) e with F(rho) = a + sum_k rho_k b_k c_k' - L output and lower <= rho(t) <= upper,

        P > 0   and   F'P + P F + 2 rate P < 0   at all corners

    imply |e(t)| <= sqrt(cond P) e^{-rate t} |e(0)| for every such rho(t), since the inequality is affine in rho.

    a (n, n), b (n, r) with columns b_k, c (r, n), lower and upper (r,), output (p, n), gain L (n, p), p (n, n), rate >= 0 [1/s]
    origin: where the bounds come from, a sentence. tied (r,): channels with equal numbers have one parameter; () if none are.
    Source: paper 004, theorems 4.1 and 5.1; 003, lemma 1; 002, (31) at j0 = n.
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
    origin: str = "given"
    tied: tuple[int, ...] = ()
    theorem: ClassVar[str] = "corners"

    @property
    def step(self) -> int:
        return 0

    @property
    def claim(self) -> str:
        return f"the error decays at least like exp(-{self.rate!r} t), for {_described(self)}"

    @property
    def assumptions(self) -> tuple[str, ...]:
        return ("e' = (a + sum_k rho_k(t) b_k c_k' - L output) e is the error of the observer", *_bounds(self))

    def verify(self) -> Verdict:
        problem = _malformed(self, self.rate)
        if problem or self.rate < 0:
            return Verdict(False, {}, f"not certified: {problem or 'the rate is negative: no decay'}")
        p, rate = exact.matrix(self.p), Fraction(self.rate)
        if not exact.is_positive_definite(p):
            return Verdict(False, {}, "not certified: P > 0 fails")

        def decrease(f: exact.Matrix) -> exact.Matrix:
            pf = exact.product(p, f)
            return exact.scale(Fraction(-1), exact.add(pf, exact.transpose(pf)))

        constant, slopes, ends = _box.parts(self)
        start = exact.combine(Fraction(1), decrease(constant), -2 * rate, p)
        try:
            _, corners = exact.at_corners(start, [decrease(slope) for slope in slopes], ends)
        except exact.TooLong as error:
            return Verdict(False, {}, f"not certified: {error}")
        for corner, matrix in corners:
            if not exact.is_positive_definite(matrix):
                return Verdict(False, {}, f"not certified: F'P + P F + 2 rate P < 0 fails at {_named(self, corner)}")
        return Verdict(True, {"decay_rate": self.rate}, "all corner inequalities hold, in exact arithmetic")


@dataclasses.dataclass(frozen=True)
class StepCorners(AbstractCertificate):
    """For e+ = F(rho) e with F(rho) = a + sum_k rho_k b_k c_k' - L output and lower <= rho_k <= upper,

        P > 0   and   F'P F < factor^2 P   at all corners

    imply |e_k| <= sqrt(cond P) factor^k |e_0| for every sequence rho, since F'P F is convex in rho.

    Shapes as in Corners; factor in ]0, 1]. Source: paper 004, theorem 5.2 with (16).
    """

    a: FloatMatrix
    b: FloatMatrix
    c: FloatMatrix
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    output: FloatMatrix
    gain: FloatMatrix
    p: FloatMatrix
    factor: float
    origin: str = "given"
    tied: tuple[int, ...] = ()
    theorem: ClassVar[str] = "step corners"

    @property
    def step(self) -> int:
        return 1

    @property
    def claim(self) -> str:
        return f"the error decays at least like {self.factor!r}^k, for {_described(self)}"

    @property
    def assumptions(self) -> tuple[str, ...]:
        return ("e+ = (a + sum_k rho_k b_k c_k' - L output) e is the error of the observer", *_bounds(self))

    def verify(self) -> Verdict:
        problem = _malformed(self, self.factor)
        if problem or not 0 < self.factor <= 1:
            return Verdict(False, {}, f"not certified: {problem or 'the factor is outside ]0, 1]'}")
        p, square = exact.matrix(self.p), Fraction(self.factor) ** 2
        if not exact.is_positive_definite(p):
            return Verdict(False, {}, "not certified: P > 0 fails")
        before = exact.cleared(p)
        try:
            constant, slopes, ends = _box.parts(self)
            count = math.prod(map(len, ends))
            common, corners = exact.at_corners(constant, slopes, ends)
            for corner, f in corners:
                decrease = _decrease(f, before, square, common)
                exact.require_short(exact.work(exact.bits(decrease), len(p), count))
                if not exact.is_positive_definite(decrease):
                    return Verdict(False, {}, f"not certified: F'P F < factor^2 P fails at {_named(self, corner)}")
        except exact.TooLong as error:
            return Verdict(False, {}, f"not certified: {error}")
        return Verdict(True, {"decay_factor": self.factor}, "all corner inequalities hold, in exact arithmetic")


def _decrease(f: list[list[int]], p: list[list[int]], square: Fraction, common: int) -> list[list[int]]:
    """square P - (F / common)'P (F / common) times a positive integer, in integers."""
    columns = list(zip(*f, strict=True))
    pf = list(zip(*([sum(map(operator.mul, row, column)) for column in columns] for row in p), strict=True))
    before, after = square.numerator * common**2, square.denominator
    return [
        [before * x - after * sum(map(operator.mul, column, image)) for x, image in zip(row, pf, strict=True)]
        for row, column in zip(p, columns, strict=True)
    ]


def _named(one: Corners | StepCorners, corner: tuple[float, ...]) -> str:
    """The corner, a number a channel, from a number a parameter."""
    tied = one.tied or tuple(range(len(one.lower)))
    own = dict(zip(dict.fromkeys(tied), corner, strict=True))
    return f"the corner {tuple(own[name] for name in tied)}"


def _malformed(one: Corners | StepCorners, rate: float) -> str | None:
    problem = _box.problem(one, [one.lower, one.upper])
    if problem:
        return problem
    if len(set(one.tied or range(len(one.lower)))) > LARGEST:
        return f"more than {LARGEST} parameters"
    n = len(one.a)
    if len(one.p) != n or any(len(row) != n for row in one.p) or not all(math.isfinite(x) for row in one.p for x in row):
        return f"p is not a finite matrix of shape {(n, n)}"
    return None if math.isfinite(rate) else "the rate is not finite"


def _described(one: Corners | StepCorners) -> str:
    return f"the gain L = {one.gain!r} and all parameters in [{one.lower!r}, {one.upper!r}]" + (
        f", those tied {one.tied!r} equal" if len(set(one.tied)) < len(one.tied) else ""
    )


def _bounds(one: Corners | StepCorners) -> tuple[str, ...]:
    return (
        f"the parameters stay within the stored bounds at all times (bounds: {one.origin!r})",
        "no measurement noise; gains in real arithmetic",
    )
