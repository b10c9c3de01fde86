"""Section 3: the discrete tracker, Theorem 3, (29)-(37)."""

import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxobs.certificates import exact
from jaxobs.linalg import tracker_structure
from jaxobs.observers import DiscreteTracker, Tracker
from jaxobs.observers._fading import fading_memory_gain
from jaxobs.papers.claims import Statement
from jaxobs.papers.p001.paper import PAPER, SIZES, largest, structure

SIGMAS = [Fraction(k, 29) for k in range(1, 24)]  # more points than any degree in sigma that is compared below
DT = Fraction(1, 10)


def _power(a: exact.Matrix, dt: Fraction) -> exact.Matrix:
    """e^{A dt} of a nilpotent A."""
    total, term = exact.identity(len(a)), exact.identity(len(a))
    for k in range(1, len(a)):
        term = exact.scale(dt / k, exact.product(term, a))
        total = exact.add(total, term)
    return total


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
    gain, f = _gain34(s, dt), _power(a, dt)
    return exact.subtract(f, exact.product(exact.product(gain, c), f)), gain


@PAPER.claim("(29) condition", "universal", printed="max eig(sqrt(sigma) e^{-A delta}) < 1")
def _():
    off = 0.0
    for n, q in SIZES:
        a = np.asarray(structure(n, q)[0], float)
        off = max(off, float(np.max(np.abs(np.tril(np.roll(a, 0), -1)))))  # A~ is strictly upper triangular: e^{-A delta} is unipotent
    why = "It holds for every delta, so it restricts nothing: e^{-A~ delta} is unipotent and all eigenvalues are sqrt(sigma) < 1."
    return Statement(off == 0, math.sqrt(0.9), why + " Shown for sigma = 0.9.")


@PAPER.claim("limit delta -> 0", "identity", printed="(30) tends to (4)")
def _():
    n, q, mu, start, t = 2, 1, 5.0, 0.5, 0.6
    whole = np.asarray(Tracker(n, q, mu, start).gain(jnp.asarray(t)))
    off = []
    for count in (60, 120, 240):
        dt = t / count
        gain = np.asarray(DiscreteTracker(n, q, mu, dt, start).gain(jnp.asarray(float(count)))) / dt
        off.append(float(np.max(np.abs(gain / whole - 1))))
    order = math.log(off[1] / off[2]) / math.log(2)
    why = (
        f"G_k / delta tends to the continuous gain: relative difference {off[0]:.3g}, {off[1]:.3g}, {off[2]:.3g} at delta = 0.01, 0.005, 0.0025, "
        f"order {order:.3f}. Exactly sigma = e^(-mu delta), of which 1 - mu delta is the first order."
    )
    return Statement(abs(order - 1) < 0.1, off[-1], why)


def _printed_delay(n: int, q: int, sigma: float) -> tuple[float, float]:
    """(gain, delay in samples) at frequency 0 of xhat_1 over y, in the system of Theorem 3 with its steady gain."""
    size = n + q
    a, _, b = tracker_structure(n, q)
    f, back = scipy.linalg.expm(a), scipy.linalg.expm(-a)
    h = scipy.linalg.solve_discrete_lyapunov(math.sqrt(sigma) * back.T, np.outer(np.eye(size)[0], np.eye(size)[0]))
    closed = f - np.outer(np.linalg.solve(h, np.eye(size)[0]), f[0])
    if q == 0:
        b = np.linalg.solve(h, np.eye(size)[0])
    resolvent = np.linalg.inv(np.eye(size) - closed)  # at z = 1
    value, slope = (resolvent @ b)[q], -(resolvent @ resolvent @ b)[q]
    return float(value), float(-slope / value)


@PAPER.claim("(30) input", "identity", printed="by exact discretisation of (4)")
def _():
    delays = {q: _printed_delay(2, q, 0.9) for q in (1, 2, 3)}
    listed = ", ".join(f"q = {q}: {delay:.4f}" for q, (_, delay) in delays.items())
    why = (
        "delta B y_k is the Euler step of the input, and xhat_{k+1} has not seen y_{k+1}; on slow signals the estimate is late by (samples, "
        f"n = 2, sigma = 0.9) {listed}. Exact is e^(A delta) with y held or joined by straight lines; the latter, with the "
        "injection on the full prediction, has no delay."
    )
    return Statement(False, delays[1][1], why)


@PAPER.claim("(30) H_k", "identity", printed="the Lyapunov equation in sqrt(sigma) e^{-A delta}")
def _():
    n, q, dt, mu = 2, 1, 0.1, 4.0
    a, back = tracker_structure(n, q)[0], scipy.linalg.expm(-tracker_structure(n, q)[0] * dt)
    unit = np.eye(n + q)[0]
    h, off = 0.5 * np.eye(3) + dt * np.outer(unit, unit), 0.0
    tracker = DiscreteTracker(n, q, mu, dt, 0.5)
    for k in range(30):
        ours = tracker_structure(n, q)[1] * np.asarray(tracker.gain(jnp.asarray(float(k))))
        expected = dt * np.linalg.solve(h, unit)
        off = max(off, float(np.max(np.abs(ours - expected)) / np.max(np.abs(expected))))
        h = math.exp(-mu * dt) * back.T @ h @ back + dt * np.outer(unit, unit)
    return Statement(off < 1e-9 and a.shape == (3, 3), off, "The recursion, step by step, against the closed form of the gain; k < 30.")


@PAPER.claim("(31) H_k", "identity", printed="delta sum sigma^k (...)")
def _():
    s, k = Fraction(4, 5), 4
    a, _, c = structure(2, 0)
    back, row = _power(exact.scale(Fraction(-1), a), DT), exact.product(exact.transpose(c), c)
    h0 = exact.identity(2)
    h, total, step = h0, exact.zeros(2, 2), exact.identity(2)
    for j in range(k):
        h = exact.add(
            exact.scale(s, exact.product(exact.transpose(back), exact.product(h, back))), exact.scale(DT, row)
        )
        total = exact.add(total, exact.scale(DT * s**j, exact.product(exact.transpose(step), exact.product(row, step))))
        step = exact.product(step, back)
    missing = exact.scale(s**k, exact.product(exact.transpose(step), exact.product(h0, step)))
    gap, rest = exact.subtract(h, total), exact.subtract(exact.subtract(h, total), missing)
    why = (
        f"The start is missing: H_k - sum = sigma^k e^(-A'k delta) H_0 e^(-A k delta), exactly (rest {largest(rest):g}); shown at k = 4, "
        "sigma = 0.8, H_0 = I. It fades. (The sum runs over its own upper limit k.)"
    )
    return Statement(largest(gap) == 0, largest(gap), why)


@PAPER.claim("A~ nilpotent", "identity", printed="A~^k = 0 for k >= n+q")
def _():
    off = 0.0
    for n, q in SIZES:
        a = power = structure(n, q)[0]
        for _ in range(n + q - 1):
            power = exact.product(power, a)
        off = max(off, largest(power))
    return Statement(off == 0, off, "In integers.")


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
    return Statement(bool(off < 1e-12), float(off), "The sum, 400 terms, put into (30): relative residual (n = 2, q = 1, sigma = 0.6).")


@PAPER.claim("H_inf for n = 3", "identity", printed="the 3 x 3 matrix above (34)")
def _():
    a, _, c = structure(3, 0)
    back, row = _power(exact.scale(Fraction(-1), a), DT), exact.product(exact.transpose(c), c)
    off = 0.0
    for s in SIGMAS:
        h = _h_infinity(s, DT)
        right = exact.add(exact.scale(s, exact.product(exact.transpose(back), exact.product(h, back))), exact.scale(DT, row))
        off = max(off, largest(exact.subtract(h, right)))
    why = f"All nine entries, in fractions, as fixed point of (30) at {len(SIGMAS)} sigmas: more than the degree, hence for all."
    return Statement(off == 0, off, why)


@PAPER.claim("(34) gain", "identity", printed="((1-s)(s^2+s+1), 3/2 (s-1)^2 (s+1)/delta, (1-s)^3/delta^2)")
def _():
    off = 0.0
    for s in SIGMAS:
        left = exact.product(_h_infinity(s, DT), _gain34(s, DT))
        off = max(off, largest(exact.subtract(left, [[DT], [Fraction(0)], [Fraction(0)]])))
    return Statement(off == 0, off, "H_inf times it is delta C', in fractions; it is the classical gain of the fading-memory filter.")


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
        off = max(off, float(np.max(np.abs(np.asarray(fading_memory_gain(size, jnp.asarray(dec), jnp.asarray(dt))) / expected - 1))))
    why = (
        "G_{i+1} = (i!/delta^i) sum_{j>i} C(n,j) (1-sigma)^j s1(j,i+1)/(j-1)!, s1 signed Stirling numbers of the first kind; for q > 0 with "
        "n + q for n and the signs of A~. Shown: relative difference from the sum (31), n = 2, 4, 5, 6, sigma = 0.7."
    )
    return Statement(off < 1e-6, off, why)


@PAPER.claim("(33) delay", "identity", printed="y_k in xhat_{k+1}")
def _():
    value, delay = _printed_delay(3, 0, 0.9)
    why = (
        f"xhat_{{k+1}} is corrected with y_k - C e^(A delta) xhat_k, whose second part predicts y_{{k+1}}: it lags by {delay:.6f} samples at "
        f"frequency 0 (gain {value:.6f}; n = 3, sigma = 0.9). With y_{{k+1}} there is no delay, and (34) is the gain for that."
    )
    return Statement(abs(delay) < 1e-6, delay, why)


@PAPER.claim("(33) H_k in the gain", "identity", printed="delta H_k^-1 C'")
def _():
    n, dt, s = 3, 0.01, 0.9
    weak, unit = dt / 500, np.eye(n)[0]
    f, back = scipy.linalg.expm(np.eye(n, k=1) * dt), scipy.linalg.expm(-np.eye(n, k=1) * dt)

    def highest(shifted: bool) -> float:
        h, x, top = weak * np.eye(n), np.zeros(n), 0.0
        for _ in range(200):
            after = s * back.T @ h @ back + dt * np.outer(unit, unit)
            x = f @ x + dt * np.linalg.solve(after if shifted else h, unit) * (1.0 - (f @ x)[0])
            h, top = after, max(top, abs(float(x[0])))
        return top

    printed, ours = highest(False), highest(True)
    why = (
        f"y = 1 from xhat = 0 and a weak H_0 = (delta / 500) I: with H_k the first estimate of y is {printed:.4g}, with H_{{k+1}}, which "
        f"counts the sample at hand, {ours:.4g} (n = 3, sigma = 0.9). The gain of step k + 1 needs H_(k+1)."
    )
    return Statement(printed < 2, printed, why)


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
        return Statement(off == 0, off, f"Over (z - sigma)^3, in fractions at {len(POINTS)} points (sigma, z).")

    @PAPER.claim(f"({number}) denominator", "identity", printed="z^3 + (3s-6) z^2 + (6-3s^2) z - 2 + s^3")
    def _():
        s = Fraction(9, 10)
        roots = np.roots([float(c) for c in (1, 3 * s - 6, 6 - 3 * s**2, s**3 - 2)])
        gain = [float(_numerator(0, t, DT, Fraction(1)) / _printed_denominator(t, Fraction(1))) for t in SIGMAS]
        off = max(abs(float(_transfer(i, t, DT, z) - _numerator(i, t, DT, z) / (z - t) ** 3)) for t, z in POINTS)
        why = (
            f"Right is (z - sigma)^3 (difference {off:g}, in fractions). The printed one has the root {max(abs(roots)):.6f} at sigma = 0.9, "
            f"outside the unit circle, and gives (35) the gain {gain[0]:g} at z = 1 for every sigma: a sign slip."
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
        off = max(off, abs(float(_transfer(1, s, DT, one))), abs(float(_transfer(2, s, DT, one))), *(abs(float(v - 1)) for v in values))
    why = "With the right denominators both filters have the gain 1 at z = 1, as differentiators need. Shown: the largest deviation."
    return Statement(off < 1e-6, off, why)


@PAPER.claim("Theorem 3", "universal", printed="for all H_0 > 0 the derivatives are estimated")
def _():
    dt, mu, n = 0.02, 10.0, 3
    worst = 0.0
    for q in (0, 1):
        tracker = DiscreteTracker(n, q, mu, dt, 0.3)

        def step(z, k, tracker=tracker):
            y = jnp.sin(k * dt)[None]
            return tracker.step(k, z, jnp.zeros((0,)), y), tracker.estimate(k, z, jnp.zeros((0,)), y)

        _, xhat = jax.lax.scan(step, tracker.init(jnp.zeros(n)), jnp.arange(500.0))
        t = dt * np.arange(500)
        error = np.abs(np.asarray(xhat) - np.stack([np.sin(t), np.cos(t), -np.sin(t)], axis=1))[250:]
        allowed = np.asarray([math.comb(n + q, n - i) / mu ** (n - i) for i in range(n)])  # the continuous bias under |y'''| <= 1
        worst = max(worst, float(np.max(error / allowed)))
    why = (
        "In the corrected form (y_{k+1}, H_{k+1}, straight lines between samples): y = sin t, n = 3, q = 0 and 1, mu = 10, delta = 0.02. "
        "Shown: the largest error over the bias bound C(n+q, r) / mu^r of the continuous tracker."
    )
    return Statement(worst < 1.1, worst, why)
