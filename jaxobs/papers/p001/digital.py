"""Section 3: the discrete tracker, Theorem 3, (29)-(31) and (33)."""

import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxobs.certificates import exact
from jaxobs.linalg import tracker_structure
from jaxobs.papers.claims import Statement
from jaxobs.papers.p001.paper import PAPER, SIZES, largest, nilpotent_exponential, structure
from jaxobs.papers.p001.paper import discrete_tracker as make_discrete
from jaxobs.papers.p001.paper import gain as gain_of
from jaxobs.papers.p001.paper import tracker as make_tracker

DT = Fraction(1, 10)


@PAPER.claim("(29) condition", "universal", printed="max eig(sqrt(sigma) e^{-A delta}) < 1")
def _():
    # A~ is strictly upper triangular, hence e^{-A~ delta} unipotent
    off = max(float(np.max(np.abs(np.tril(np.asarray(structure(n, q)[0], float))))) for n, q in SIZES)
    why = (
        "It holds for every delta, so it restricts nothing: e^{-A~ delta} is unipotent and all eigenvalues are sqrt(sigma) < 1."
    )
    return Statement(bool(off == 0), math.sqrt(0.9), why + " Shown for sigma = 0.9.")


@PAPER.claim("limit delta -> 0", "identity", printed="(30) tends to (4)")
def _():
    n, q, mu, start, t = 2, 1, 5.0, 0.5, 0.6
    whole = gain_of(make_tracker(n, q, mu, start), t)
    off = []
    for count in (60, 120, 240):
        dt = t / count
        gain = gain_of(make_discrete(n, q, mu, dt, start), float(count)) / dt
        off.append(float(np.max(np.abs(gain / whole - 1))))
    order = math.log(off[1] / off[2]) / math.log(2)
    why = (
        f"G_k / delta tends to the continuous gain: relative difference {off[0]:.3g}, {off[1]:.3g}, {off[2]:.3g} at delta = "
        f"0.01, 0.005, 0.0025, order {order:.3f}. Exactly sigma = e^(-mu delta), of which 1 - mu delta is the first order."
    )
    return Statement(bool(abs(order - 1) < 0.1), off[-1], why)


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
        "delta B y_k is the Euler step of the input, and xhat_{k+1} has not seen y_{k+1}; on slow signals the estimate is late "
        f"by (samples, n = 2, sigma = 0.9) {listed}. Exact is e^(A delta) with y held or joined by straight lines; the latter, "
        "with the injection on the full prediction, has no delay."
    )
    return Statement(all(abs(delay) < 1e-6 for _, delay in delays.values()), delays[1][1], why)


@PAPER.claim("(30) H_k", "identity", printed="the Lyapunov equation in sqrt(sigma) e^{-A delta}")
def _():
    n, q, dt, mu = 2, 1, 0.1, 4.0
    a, back = tracker_structure(n, q)[0], scipy.linalg.expm(-tracker_structure(n, q)[0] * dt)
    unit = np.eye(n + q)[0]
    h, off = 0.5 * np.eye(3) + dt * np.outer(unit, unit), 0.0
    tracker = make_discrete(n, q, mu, dt, 0.5)
    for k in range(30):
        ours = gain_of(tracker, float(k))
        expected = dt * np.linalg.solve(h, unit)
        off = max(off, float(np.max(np.abs(ours - expected)) / np.max(np.abs(expected))))
        h = math.exp(-mu * dt) * back.T @ h @ back + dt * np.outer(unit, unit)
    return Statement(
        bool(off < 1e-9 and a.shape == (3, 3)), off, "The recursion, step by step, against the closed form of the gain; k < 30."
    )


@PAPER.claim("(31) H_k", "identity", printed="delta sum sigma^k (...)")
def _():
    s, k = Fraction(4, 5), 4
    a, _, c = structure(2, 0)
    back, row = nilpotent_exponential(exact.scale(Fraction(-1), a), DT), exact.product(exact.transpose(c), c)
    h0 = exact.identity(2)
    h, total, step = h0, exact.zeros(2, 2), exact.identity(2)
    for j in range(k):
        h = exact.add(exact.scale(s, exact.product(exact.transpose(back), exact.product(h, back))), exact.scale(DT, row))
        total = exact.add(total, exact.scale(DT * s**j, exact.product(exact.transpose(step), exact.product(row, step))))
        step = exact.product(step, back)
    missing = exact.scale(s**k, exact.product(exact.transpose(step), exact.product(h0, step)))
    gap, rest = exact.subtract(h, total), exact.subtract(exact.subtract(h, total), missing)
    why = (
        f"The start is missing: H_k - sum = sigma^k e^(-A'k delta) H_0 e^(-A k delta), exactly (rest {largest(rest):g}); shown "
        "at k = 4, sigma = 0.8, H_0 = I. It fades. (The sum runs over its own upper limit k.)"
    )
    return Statement(bool(largest(gap) == 0), largest(gap), why)


@PAPER.claim("(33) delay", "identity", printed="y_k in xhat_{k+1}")
def _():
    value, delay = _printed_delay(3, 0, 0.9)
    why = (
        "xhat_{k+1} is corrected with y_k - C e^(A delta) xhat_k, whose second part predicts y_{k+1}: "
        f"it lags by {delay:.6f} samples at frequency 0 (gain {value:.6f}; n = 3, sigma = 0.9). With "
        "y_{k+1} there is no delay, and (34) is the gain for that."
    )
    return Statement(bool(abs(delay) < 1e-6), delay, why)


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
        f"y = 1 from xhat = 0 and a weak H_0 = (delta / 500) I: with H_k the first estimate of y is {printed:.4g}, with "
        f"H_{{k+1}}, which counts the sample at hand, {ours:.4g} (n = 3, sigma = 0.9). The gain of step k + 1 needs H_(k+1)."
    )
    return Statement(bool(printed < 2), printed, why)


@PAPER.claim("Theorem 3", "universal", printed="for all H_0 > 0 the derivatives are estimated")
def _():
    dt, mu, n = 0.02, 10.0, 3
    worst = 0.0
    for q in (0, 1):
        tracker = make_discrete(n, q, mu, dt, 0.3)

        def step(z, k, tracker=tracker):
            y = jnp.sin(k * dt)[None]
            return tracker.step(k, z, jnp.zeros((0,)), y), tracker.estimate(k, z, jnp.zeros((0,)), y)

        _, xhat = jax.lax.scan(step, tracker.init(jnp.zeros(n)), jnp.arange(500.0))
        t = dt * np.arange(500)
        error = np.abs(np.asarray(xhat) - np.stack([np.sin(t), np.cos(t), -np.sin(t)], axis=1))[250:]
        allowed = np.asarray(
            [math.comb(n + q, n - i) / mu ** (n - i) for i in range(n)]
        )  # the continuous bias under |y'''| <= 1
        worst = max(worst, float(np.max(error / allowed)))
    why = (
        "In the corrected form (y_{k+1}, H_{k+1}, straight lines between samples): without input V_k = eta'H_k eta obeys "
        "V_{k+1} = sigma V_k - delta (C eta-)^2 (1 - delta C H_{k+1}^-1 C') <= sigma V_k, for every H_0 > 0 and every delta. "
        "Measured: y = sin t, n = 3, q = 0 and 1, mu = 10, delta = 0.02. Shown: the largest error over the bias bound C(n+q, "
        "r) / mu^r of the continuous tracker."
    )
    return Statement(bool(worst < 1.1), worst, why)
