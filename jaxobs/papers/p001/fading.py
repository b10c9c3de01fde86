"""Section 3: the steady discrete gain and its transfer functions, (32) and (34)-(37)."""

import math
from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxobs.certificates import exact
from jaxobs.linalg import tracker_structure
from jaxobs.observers._fading import fading_memory_gain
from jaxobs.papers.claims import Statement
from jaxobs.papers.p001.paper import PAPER, SIZES, largest, nilpotent_exponential, structure

SIGMAS = [Fraction(k, 29) for k in range(1, 24)]  # more points than any degree in sigma that is compared below
DT = Fraction(1, 10)


def _gain34(s: Fraction, dt: Fraction) -> exact.Matrix:
    return [[(1 - s) * (s * s + s + 1)], [Fraction(3, 2) * (s - 1) ** 2 * (s + 1) / dt], [(1 - s) ** 3 / dt**2]]


def _h_infinity(s: Fraction, dt: Fraction) -> exact.Matrix:
    """The printed 3 x 3 closed form above (34)."""
    h = [
        [dt / (1 - s), -(dt**2) * s / (1 - s) ** 2, dt**3 * s * (s + 1) / (2 * (1 - s) ** 3)],
        [0, dt**3 * s * (s + 1) / (1 - s) ** 3, -(dt**4) * s * (s**2 + 4 * s + 1) / (2 * (1 - s) ** 4)],
        [0, 0, dt**5 * s * (s**3 + 11 * s**2 + 11 * s + 1) / (4 * (1 - s) ** 5)],
    ]
    return [[Fraction(h[min(i, j)][max(i, j)]) for j in range(3)] for i in range(3)]


def _closed(s: Fraction, dt: Fraction) -> tuple[exact.Matrix, exact.Matrix]:
    """((I - G C) e^{A dt}, G) of (33) with the gain (34)."""
    a, _, c = structure(3, 0)
    gain, f = _gain34(s, dt), nilpotent_exponential(a, dt)
    return exact.subtract(f, exact.product(exact.product(gain, c), f)), gain


@PAPER.claim("A~ nilpotent", "identity", printed="A~^k = 0 for k >= n+q")
def _():
    off = 0.0
    for n, q in SIZES:
        a = power = structure(n, q)[0]
        for _ in range(n + q - 1):
            power = exact.product(power, a)
        off = max(off, largest(power))
    return Statement(bool(off == 0), off, "In integers.")


@PAPER.claim("(32) H_inf", "identity", printed="double sum over i, j")
def _():
    n, q, s, dt = 2, 1, 0.6, 0.1
    a, size = tracker_structure(n, q)[0], 3
    unit = np.eye(size)[0]
    powers = [np.linalg.matrix_power(a * dt, i) for i in range(size)]
    total = np.zeros((size, size))
    for k in range(400):
        for i in range(size):
            for j in range(size):
                weight = s**k * float(-k) ** (i + j) / (math.factorial(i) * math.factorial(j))
                total += dt * weight * powers[i].T @ np.outer(unit, unit) @ powers[j]
    back = scipy.linalg.expm(-a * dt)
    off = np.max(np.abs(s * back.T @ total @ back + dt * np.outer(unit, unit) - total)) / np.max(np.abs(total))
    return Statement(
        bool(off < 1e-12), float(off), "The sum, 400 terms, put into (30): relative residual (n = 2, q = 1, sigma = 0.6)."
    )


@PAPER.claim("H_inf for n = 3", "identity", printed="the 3 x 3 matrix above (34)")
def _():
    a, _, c = structure(3, 0)
    back, row = nilpotent_exponential(exact.scale(Fraction(-1), a), DT), exact.product(exact.transpose(c), c)
    off = 0.0
    for s in SIGMAS:
        h = _h_infinity(s, DT)
        right = exact.add(exact.scale(s, exact.product(exact.transpose(back), exact.product(h, back))), exact.scale(DT, row))
        off = max(off, largest(exact.subtract(h, right)))
    why = (
        f"All nine entries, in fractions, as fixed point of (30) at {len(SIGMAS)} sigmas: more than the degree, hence for all."
    )
    return Statement(bool(off == 0), off, why)


@PAPER.claim("(34) gain", "identity", printed="((1-s)(s^2+s+1), 3/2 (s-1)^2 (s+1)/delta, (1-s)^3/delta^2)")
def _():
    off = 0.0
    for s in SIGMAS:
        left = exact.product(_h_infinity(s, DT), _gain34(s, DT))
        off = max(off, largest(exact.subtract(left, [[DT], [Fraction(0)], [Fraction(0)]])))
    return Statement(
        bool(off == 0), off, "H_inf times it is delta C', in fractions; it is the classical gain of the fading-memory filter."
    )


@PAPER.claim("(34) for every n", "identity", printed="properties of the sums of geometric series")
def _():
    off, dt, dec = 0.0, 0.1, 0.3
    for size in (2, 4, 5, 6):
        a = np.eye(size, k=1)
        back, unit = scipy.linalg.expm(-a * dt), np.eye(size)[0]
        h = np.zeros((size, size))
        for k in range(400):
            r = np.linalg.matrix_power(back, k)[0]
            h += dt * (1 - dec) ** k * np.outer(r, r)
        d = np.sqrt(np.diag(h))
        expected = dt * np.linalg.solve(h / np.outer(d, d), unit / d) / d
        off = max(
            off, float(np.max(np.abs(np.asarray(fading_memory_gain(size, jnp.asarray(dec), jnp.asarray(dt))) / expected - 1)))
        )
    why = (
        "G_{i+1} = (i!/delta^i) sum_{j>i} C(n,j) (1-sigma)^j s1(j,i+1)/(j-1)!, s1 signed Stirling "
        "numbers of the first kind; for q > 0 with n + q for n and the signs of A~. Shown: relative "
        "difference from the sum (31), n = 2, 4, 5, 6, sigma = 0.7."
    )
    return Statement(bool(off < 1e-6), off, why)


def _numerator(i: int, s: Fraction, dt: Fraction, z: Fraction) -> Fraction:
    """The printed numerators of (35)-(37)."""
    if i == 0:
        return (1 - s**3) * z**2 + (3 * s**3 - 3 * s) * z - 3 * s**3 + 3 * s**2
    if i == 1:
        return (z - 1) / (2 * dt) * ((-3 * s + 3 * s**3 + 3 - 3 * s**2) * z - 1 - 5 * s**3 + 9 * s**2 - 3 * s)
    return (z - 1) ** 2 / dt**2 * (1 - s**3 + 3 * s**2 - 3 * s)


def _printed_denominator(s: Fraction, z: Fraction) -> Fraction:
    return z**3 + (3 * s - 6) * z**2 + (6 - 3 * s**2) * z - 2 + s**3


def _transfer(i: int, s: Fraction, dt: Fraction, z: Fraction) -> Fraction:
    """C_i (z I - (I - G C) F)^-1 G by Cramer's rule."""
    closed, gain = _closed(s, dt)
    m = [[(z if r == c else Fraction(0)) - closed[r][c] for c in range(3)] for r in range(3)]
    other = [[gain[r][0] if c == i else m[r][c] for c in range(3)] for r in range(3)]
    return _det(other) / _det(m)


def _det(m: exact.Matrix) -> Fraction:
    return (
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1])
        - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
        + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    )


POINTS = [(s, z) for s in SIGMAS[::3] for z in (Fraction(2), Fraction(-1, 3), Fraction(5, 2), Fraction(3), Fraction(1, 7))]


def _register(number: int) -> None:
    i = number - 35

    @PAPER.claim(f"({number}) numerator", "identity", printed=f"numerator of Xhat_{i + 1}(z)/Y(z)")
    def _():
        off = max(abs(float(_transfer(i, s, DT, z) * (z - s) ** 3 - _numerator(i, s, DT, z))) for s, z in POINTS)
        return Statement(bool(off == 0), off, f"Over (z - sigma)^3, in fractions at {len(POINTS)} points (sigma, z).")

    @PAPER.claim(f"({number}) denominator", "identity", printed="z^3 + (3s-6) z^2 + (6-3s^2) z - 2 + s^3")
    def _():
        s = Fraction(9, 10)
        roots = np.roots([float(c) for c in (1, 3 * s - 6, 6 - 3 * s**2, s**3 - 2)])
        gain = [float(_numerator(0, t, DT, Fraction(1)) / _printed_denominator(t, Fraction(1))) for t in SIGMAS]
        off = max(abs(float(_transfer(i, t, DT, z) - _numerator(i, t, DT, z) / (z - t) ** 3)) for t, z in POINTS)
        why = (
            f"Right is (z - sigma)^3 (difference {off:g}, in fractions). The printed one has the root {max(abs(roots)):.6f} at "
            f"sigma = 0.9, outside the unit circle, and gives (35) the gain {gain[0]:g} at z = 1 for every sigma: a sign slip."
        )
        return Statement(bool(max(abs(roots)) < 1), float(max(abs(roots))), why)


for _number in (35, 36, 37):
    _register(_number)


@PAPER.claim("forward differences", "identity", printed="(z-1)/delta and (z-1)^2/delta^2 times IIR filters")
def _():
    off = 0.0
    for s in SIGMAS[::4]:
        one, close = Fraction(1), Fraction(1) + Fraction(1, 10**9)
        values = [_transfer(1, s, DT, close) / ((close - 1) / DT), _transfer(2, s, DT, close) / ((close - 1) / DT) ** 2]
        off = max(
            off,
            abs(float(_transfer(1, s, DT, one))),
            abs(float(_transfer(2, s, DT, one))),
            *(abs(float(v - 1)) for v in values),
        )
    why = (
        "With the right denominators both filters have the gain 1 at z = 1, as differentiators need. Shown: the largest "
        "deviation."
    )
    return Statement(bool(off < 1e-6), off, why)
