"""One quadratic Lyapunov function at all corners of a box of parameters: continuous time, and discrete time."""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict

LARGEST = 12  # states, and channels: a hostile file could otherwise keep the check busy


@dataclasses.dataclass(frozen=True)
class Corners(AbstractCertificate):
    """For e' = F(rho) e with F(rho) = a + sum_k rho_k b_k c_k' - L output and lower <= rho(t) <= upper,

        P > 0   and   F'P + P F + 2 rate P < 0   at all corners

    imply |e(t)| <= sqrt(cond P) e^{-rate t} |e(0)| for every such rho(t), since the inequality is affine in rho.

    a (n, n), b (n, r) with columns b_k, c (r, n), lower and upper (r,), output (p, n), gain L (n, p), p (n, n), rate [1/s].
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
    def claim(self) -> str:
        return f"the error decays at least like exp(-{self.rate!r} t), for {_described(self)}"

    @property
    def assumptions(self) -> tuple[str, ...]:
        return ("e' = (a + sum_k rho_k(t) b_k c_k' - L output) e is the error of the observer", *_bounds(self))

    def verify(self) -> Verdict:
        problem = _malformed(self, self.rate)
        if problem:
            return Verdict(False, {}, f"not certified: {problem}")
        p, rate = exact.matrix(self.p), Fraction(self.rate)
        if not exact.is_positive_definite(p):
            return Verdict(False, {}, "not certified: P > 0 fails")
        for corner, f in _closed(self):
            pf = exact.product(p, f)
            decrease = exact.scale(Fraction(-1), exact.add(exact.add(pf, exact.transpose(pf)), exact.scale(2 * rate, p)))
            if not exact.is_positive_definite(decrease):
                return Verdict(False, {}, f"not certified: F'P + P F + 2 rate P < 0 fails at the corner {corner}")
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
        for corner, f in _closed(self):
            after = exact.product(exact.transpose(f), exact.product(p, f))
            if not exact.is_positive_definite(exact.subtract(exact.scale(square, p), after)):
                return Verdict(False, {}, f"not certified: F'P F < factor^2 P fails at the corner {corner}")
        return Verdict(True, {"decay_factor": self.factor}, "all corner inequalities hold, in exact arithmetic")


def _closed(certificate: Corners | StepCorners) -> Iterator[tuple[tuple[float, ...], exact.Matrix]]:
    """Every corner with its matrix F."""
    one = certificate
    b, c = exact.matrix(one.b), exact.matrix(one.c)
    start = exact.subtract(exact.matrix(one.a), exact.product(exact.matrix(one.gain), exact.matrix(one.output)))
    first = _first(one)
    own = sorted(set(first))
    for values in itertools.product(*(sorted({one.lower[k], one.upper[k]}) for k in own)):
        f, corner = start, tuple(values[own.index(k)] for k in first)
        for k, rho in enumerate(corner):
            f = exact.add(f, [[Fraction(rho) * row[k] * entry for entry in c[k]] for row in b])
        yield corner, f


def _first(one: Corners | StepCorners) -> list[int]:
    """For each channel, the first one with the same parameter: itself, if it is not tied."""
    return [one.tied.index(k) for k in one.tied] if one.tied else list(range(len(one.lower)))


def _malformed(one: Corners | StepCorners, rate: float) -> str | None:
    n, r, p = len(one.a), len(one.lower), len(one.output)
    if not (1 <= n <= LARGEST and r <= LARGEST and 1 <= p <= LARGEST):
        return f"{n} states, {r} channels, {p} outputs: expected 1 to {LARGEST}"
    shapes = {"a": (n, n), "b": (n, r), "c": (r, n), "output": (p, n), "gain": (n, p), "p": (n, n)}
    for name, (rows, columns) in shapes.items():
        value = getattr(one, name)
        if len(value) != rows or any(len(row) != columns for row in value):
            return f"{name} is not of shape {(rows, columns)}"
        if not all(math.isfinite(x) for row in value for x in row):
            return f"{name} has an entry that is not finite"
    if len(one.upper) != r or not all(math.isfinite(x) for x in (*one.lower, *one.upper, rate)):
        return "the bounds or the rate are not finite numbers, one pair for each channel"
    if any(lo > hi for lo, hi in zip(one.lower, one.upper, strict=True)):
        return "a lower bound exceeds its upper bound"
    if one.tied and len(one.tied) != r:
        return f"tied has {len(one.tied)} numbers for {r} channels"
    bounds = zip(one.tied, one.lower, one.upper, strict=False)
    if len(set(bounds)) != len(set(one.tied)):
        return "tied channels have different bounds"
    if len(one.tied) not in (0, r):
        return f"{len(one.tied)} numbers in tied for {r} channels"
    if any((one.lower[k], one.upper[k]) != (one.lower[j], one.upper[j]) for k, j in enumerate(_first(one))):
        return "tied channels have different bounds"
    return None


def _described(one: Corners | StepCorners) -> str:
    return (
        f"the gain L = {one.gain!r} and all parameters in [{one.lower!r}, {one.upper!r}]"
        + (f", those tied {one.tied!r} equal" if len(set(one.tied)) < len(one.tied) else "")
        + (f", tied {one.tied!r}" if one.tied else "")
    )


def _bounds(one: Corners | StepCorners) -> tuple[str, ...]:
    return (
        f"the parameters stay within the stored bounds at all times (bounds: {one.origin})",
        "no measurement noise; gains in real arithmetic",
    )
