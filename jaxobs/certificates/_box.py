"""What certificates about e' = (a + sum_k rho_k b_k c_k' - L output) e, rho in a box, share: checks, the matrix at a rho."""

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Protocol, runtime_checkable

from jaxobs.certificates import exact
from jaxobs.certificates.base import FloatMatrix

LARGEST = 12  # states and outputs: a hostile file could otherwise keep the check busy
CHANNELS = 64


@runtime_checkable
class Box(Protocol):
    """a (n, n), b (n, r), c (r, n), output (p, n), gain L (n, p), lower and upper (r,); step 1 for e+ in place of e';
    tied (r,): channels with equal numbers have one parameter, () if none are."""

    @property
    def a(self) -> FloatMatrix: ...
    @property
    def b(self) -> FloatMatrix: ...
    @property
    def c(self) -> FloatMatrix: ...
    @property
    def output(self) -> FloatMatrix: ...
    @property
    def gain(self) -> FloatMatrix: ...
    @property
    def lower(self) -> tuple[float, ...]: ...
    @property
    def upper(self) -> tuple[float, ...]: ...
    @property
    def step(self) -> int: ...
    @property
    def tied(self) -> tuple[int, ...]: ...


def problem(box: Box, points: Sequence[tuple[float, ...]]) -> str | None:
    """What is wrong with the stored numbers, among them the parameters `points` that shall lie in the box; or None."""
    n, r, p = len(box.a), len(box.lower), len(box.output)
    if not (1 <= n <= LARGEST and r <= CHANNELS and 1 <= p <= LARGEST):
        return f"{n} states, {r} channels, {p} outputs: expected 1 to {LARGEST}, {CHANNELS} and {LARGEST}"
    if box.step not in (0, 1):
        return f"step = {box.step}: expected 0 (continuous time) or 1 (discrete time)"
    for name, rows, columns in (("a", n, n), ("b", n, r), ("c", r, n), ("output", p, n), ("gain", n, p)):
        value = getattr(box, name)
        if len(value) != rows or any(len(row) != columns for row in value):
            return f"{name} is not of shape {(rows, columns)}"
        if not all(math.isfinite(x) for row in value for x in row):
            return f"{name} has an entry that is not finite"
    if not (len(box.upper) == r and all(math.isfinite(x) for x in (*box.lower, *box.upper))):
        return "the bounds are not finite numbers, one pair for each channel"
    tied = box.tied or tuple(range(r))
    if len(tied) != r:
        return f"{len(tied)} ties for {r} channels"
    for rho in points:
        if not (len(rho) == r and all(lo <= x <= hi for lo, x, hi in zip(box.lower, rho, box.upper, strict=True))):
            return f"rho = {rho!r} does not lie within the bounds"
        if any(rho[k] != rho[tied.index(tied[k])] for k in range(r)):
            return f"rho = {rho!r} has different values for tied channels"
    return None


def parts(box: Box) -> tuple[exact.Matrix, list[exact.Matrix], list[list[float]]]:
    """(F_0, the F_k, the ends of every parameter) of F(rho) = F_0 + sum_k rho_k F_k; tied channels are one parameter."""
    tied, b, c = box.tied or tuple(range(len(box.lower))), exact.matrix(box.b), exact.matrix(box.c)
    names, n = list(dict.fromkeys(tied)), len(box.a)
    slopes = []
    for name in names:
        own = [k for k, other in enumerate(tied) if other == name]
        slopes.append([[sum((b[i][k] * c[k][j] for k in own), Fraction(0)) for j in range(n)] for i in range(n)])
    ends = [sorted({box.lower[tied.index(name)], box.upper[tied.index(name)]}) for name in names]
    return closed(box, [0.0] * len(tied)), slopes, ends


def closed(box: Box, rho: Sequence[float]) -> exact.Matrix:
    """F(rho) = a + b diag(rho) c - L output."""
    weighted = [[Fraction(x) * entry for entry in row] for x, row in zip(rho, exact.matrix(box.c), strict=True)]
    f = exact.subtract(exact.matrix(box.a), exact.product(exact.matrix(box.gain), exact.matrix(box.output)))
    return exact.add(f, exact.product(exact.matrix(box.b), weighted)) if weighted else f


def dynamics(box: Box) -> str:
    """The first assumption of every such certificate."""
    moved = "e+ = (a + sum_k rho_k b_k c_k' - L output) e" if box.step else "e' = (a + sum_k rho_k(t) b_k c_k' - L output) e"
    return f"{moved} is the error of the observer, and every rho within [{box.lower!r}, {box.upper!r}] can occur"
