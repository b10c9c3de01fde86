"""What the three theorems on chains with bounded slopes share: matrices, the constant k_j0, what is malformed."""

import itertools
import math
from collections.abc import Iterator, Sequence
from fractions import Fraction

from jaxobs.certificates import exact
from jaxobs.certificates.base import FloatMatrix

LARGEST = 10  # states; so at most 1,024 corners

PLANT = "the plant is x_i' = x_{i+1}, x_n' = f(x, u), y = x_1, and the observer has the same f"
TIME = "continuous time, without measurement noise; gains in real arithmetic"


def bounded(lower: Sequence[float], upper: Sequence[float]) -> str:
    return (
        f"f(a, u) - f(b, u) = sum_j psi_j (a_j - b_j) with psi_j in [lower_j, upper_j], lower = {tuple(lower)!r}, "
        f"upper = {tuple(upper)!r}, for all a, b and every u that occurs (given, not proved)"
    )


def vertices(lower: Sequence[float], upper: Sequence[float], j0: int, sigma: float) -> Iterator[list[Fraction]]:
    """The rows psi^sigma of (27): psi_i / sigma^{n+1-i} for the last j0 slopes at either bound, 0 for the others."""
    n, s = len(lower), Fraction(sigma)
    ends = [sorted({Fraction(lo), Fraction(hi)}) for lo, hi in zip(lower[n - j0 :], upper[n - j0 :], strict=True)]
    for corner in itertools.product(*ends):
        yield [Fraction(0)] * (n - j0) + [psi / s ** (j0 - k) for k, psi in enumerate(corner)]


def slopes(
    lower: Sequence[float], upper: Sequence[float], j0: int, sigma: float, p: exact.Matrix
) -> tuple[list[exact.Matrix], list[list[float]]]:
    """What psi_i of the last j0 slopes adds to -(F'P + P F) at the scale sigma, a unit of it, and the two ends of psi_i."""
    n, s = len(p), Fraction(sigma)
    matrices = []
    for k in range(n - j0, n):  # psi_k e_n e_k' / sigma^{n-k}
        pb = [-row[-1] / s ** (n - k) for row in p]
        matrices.append([[(j == k) * pb[i] + (i == k) * pb[j] for j in range(n)] for i in range(n)])
    return matrices, [sorted({lo, hi}) for lo, hi in zip(lower[n - j0 :], upper[n - j0 :], strict=True)]


def error_matrix(k: Sequence[Fraction], row: Sequence[Fraction]) -> exact.Matrix:
    """A + B psi' - K C of (22)-(23): A the shift, B = e_n, C = e_1'."""
    n = len(k)
    f = [[Fraction(int(j == i + 1)) for j in range(n)] for i in range(n)]
    f[-1] = [entry + psi for entry, psi in zip(f[-1], row, strict=True)]
    for i in range(n):
        f[i][0] -= k[i]
    return f


def between(p: exact.Matrix, nu: Fraction) -> bool:
    """0 < P < nu I."""
    return exact.is_positive_definite(p) and exact.is_positive_definite(
        exact.subtract(exact.scale(nu, exact.identity(len(p))), p)
    )


def decrease(f: exact.Matrix, p: exact.Matrix, lam: Fraction) -> exact.Matrix:
    """-(F'P + P F) - lam I, which (31) asks to be positive definite."""
    pf = exact.product(p, f)
    return exact.subtract(
        exact.scale(Fraction(-1), exact.add(pf, exact.transpose(pf))), exact.scale(lam, exact.identity(len(p)))
    )


def constant_squared(lower: Sequence[float], upper: Sequence[float], j0: int, theta: float) -> Fraction:
    """The sharp k_j0^2 of (18) and (30): sum over i <= n - j0 of max(|lower_i|, |upper_i|)^2 theta^{2(i - n + j0)}."""
    last, t = len(lower) - j0, Fraction(theta)
    sizes = [max(abs(Fraction(lo)), abs(Fraction(hi))) for lo, hi in zip(lower[:last], upper[:last], strict=True)]
    return sum((m**2 / t ** (2 * (last - i)) for i, m in enumerate(sizes, start=1)), Fraction(0))


def scaled_gain(gain: Sequence[float], theta: float) -> list[Fraction]:
    """K with L = T(theta) K, exactly: the claim is about the L that is carried out."""
    return [Fraction(entry) / Fraction(theta) ** i for i, entry in enumerate(gain, start=1)]


def malformed(
    gain: Sequence[float], lower: Sequence[float], upper: Sequence[float], j0: int, p: FloatMatrix, numbers: dict[str, float]
) -> str | None:
    """What is wrong with the stored numbers, before anything is decided."""
    n = len(lower)
    if not 1 <= n <= LARGEST:
        return f"{n} states: expected 1 to {LARGEST}"
    if not (len(gain) == len(upper) == len(p) == n and all(len(row) == n for row in p)):
        return f"gain, lower, upper and P are not all of size {n}"
    if not 0 <= j0 <= n:
        return f"j0 = {j0} is outside 0..{n}"
    if not all(math.isfinite(x) for x in (*gain, *lower, *upper, *itertools.chain(*p), *numbers.values())):
        return "a stored number is not finite"
    if any(lo > hi for lo, hi in zip(lower, upper, strict=True)):
        return "a lower bound exceeds its upper bound"
    if numbers["theta"] < 1:
        return f"theta = {numbers['theta']:.6g} is less than 1"
    if not (numbers["lam"] > 0 and numbers["nu"] > 0 and numbers["constant"] >= 0):
        return "lambda and nu must be positive, the constant not negative"
    return None


def rate(theta: Fraction, j0: int, constant: Fraction, lam: Fraction, nu: Fraction) -> Fraction:
    """V' <= -2 rate V with V = ehat'P ehat: (theta lambda - 2 k nu / theta^{j0}) / (2 nu)."""
    return (theta * lam - 2 * constant * nu / theta**j0) / (2 * nu)
