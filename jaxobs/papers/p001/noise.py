"""What Section 2.1 says of noise: the claims on mu and q in ordinary units, at equal mu, equal bias, equal bandwidth."""

import itertools
import math

import numpy as np
import scipy.linalg

from jaxobs.designs.tracker import (
    equal_bandwidth,
    equal_bias,
    relative_tone,
    relative_white,
    response,
    tracker_gains,
)
from jaxobs.linalg import tracker_steady, tracker_structure
from jaxobs.papers.claims import Statement
from jaxobs.papers.p001.paper import PAPER

N, ORDERS = 3, (0, 1, 2, 3)


def _listed(values: list[list[float]]) -> str:
    return "; ".join(f"x{i}: " + ", ".join(f"{v:.4g}" for v in row) for i, row in enumerate(values, start=1))


def _falling(values: list[list[float]]) -> bool:
    return all(b < a for row in values for a, b in itertools.pairwise(row))


def _white(ratio) -> list[list[float]]:
    return [[relative_white(N, q, i, ratio(N, q, i)) for q in ORDERS] for i in range(1, N + 1)]


def _tone(ratio) -> list[list[float]]:
    return [[relative_tone(N, q, i, 20.0, ratio(N, q, i)) for q in ORDERS] for i in range(1, N + 1)]


@PAPER.claim("noise and mu", "universal", printed="mu large dwindles the effect of noise")
def _():
    """The largest errors from the steady tracker at each mu, not from the scaling law."""
    low, high = (_largest_error(3, 1, mu, 2) for mu in (20.0, 200.0))
    why = (
        "Said of the norm of H_inf, which itself shrinks with mu. In ordinary units the error of xhat_i grows like mu^(i-1) "
        "under bounded noise and mu^(i-1/2) under white noise, whatever q: n = 3, q = 1, |d| <= 1, xhat_2 errs by up to "
        f"{low:.4g} at mu = 20 and {high:.4g} at 200; the ratio is shown."
    )
    return Statement(bool(high < low), high / low, why)


def _steady_error(n: int, q: int, mu: float) -> tuple[np.ndarray, np.ndarray]:
    """(F, b) of z' = F z + b d with the steady gain at this mu."""
    (a, _, b), c, grade = tracker_structure(n, q), np.eye(n + q)[0], mu ** np.arange(1.0, n + q + 1)
    gain = grade * np.linalg.solve(tracker_steady(n, q, mu) * np.outer(grade, grade), grade * c)
    return a - np.outer(gain, c), b if q else gain


def _largest_error(n: int, q: int, mu: float, state: int) -> float:
    """int |h_i| dt of xhat_i, by the trapezoidal rule: what |d| <= 1 can do at most."""
    f, z = _steady_error(n, q, mu)
    dt = 0.002 / mu
    step, response = scipy.linalg.expm(f * dt), []
    for _ in range(15_000):
        response.append(abs(z[q + state - 1]))
        z = step @ z
    return float(np.trapezoid(response, dx=dt))


@PAPER.claim("(2) noise", "universal", printed="the proportional term amplifies noise enormously for mu large")
def _():
    """Variances from the Lyapunov equation of the tracker (2) at each mu, in coordinates graded by mu."""
    ratio = [w**2 for w in tracker_gains(3, 0).white]
    variance = []
    for mu in (20.0, 200.0):
        (f, b), grade = _steady_error(3, 0, mu), mu ** np.arange(1.0, 4.0)
        covariance = scipy.linalg.solve_continuous_lyapunov(f * np.outer(1 / grade, grade), -np.outer(b / grade, b / grade))
        variance.append(float(covariance[2, 2]) * grade[2] ** 2)
    why = (
        "As mu^(2i-1) in the variance of xhat_i under white noise, without (q = 0) and with integrators alike. Shown: the "
        "variance of xhat_3 at mu = 200 over that at mu = 20; at mu = 1 the variances of q = 0 are "
        f"{', '.join(f'{r:.4g}' for r in ratio)}."
    )
    return Statement(bool(variance[1] > variance[0]), float(variance[1] / variance[0]), why)


@PAPER.claim("noise and q: bounded", "universal", printed="d is attenuated more and more by increasing q")
def _():
    table = [[tracker_gains(N, q).worst[i] for q in ORDERS] for i in range(N)]
    why = (
        "Said of the norm of H_inf, where mu^-(q+1/2) enters. The largest |error| of xhat_i under |d| <= 1 at equal mu (n = 3, "
        f"q = 0..3, times mu^(i-1)): {_listed(table)}. For xhat_1 it grows with q."
    )
    return Statement(_falling(table), table[0][1] / table[0][0], why)


@PAPER.claim("noise and q: white, equal mu", "universal", printed="attenuated more and more by increasing q")
def _():
    table = _white(lambda n, q, i: 1.0)
    return Statement(
        _falling(table), table[0][3] / table[0][2], f"rms error over that of q = 0 (n = 3, q = 0..3): {_listed(table)}."
    )


@PAPER.claim("noise and q: white, equal bias", "universal", printed="attenuated more and more by increasing q")
def _():
    table = _white(equal_bias)
    rates = [[equal_bias(N, q, i) for q in ORDERS] for i in range(1, N + 1)]
    why = (
        f"At mu_q that gives xhat_i the bias of q = 0 (mu_q / mu_0: {_listed(rates)}): {_listed(table)} of the rms error of q "
        f"= 0. q = 1 is worth at most {1 - min(row[1] for row in table):.1%} and q = 2 less than q = 1."
    )
    return Statement(_falling(table), min(row[1] for row in table), why)


@PAPER.claim("noise and q: white, equal bandwidth", "universal", printed="attenuated more and more by increasing q")
def _():
    table = _white(equal_bandwidth)
    rates = [[equal_bandwidth(N, q, i) for q in ORDERS] for i in range(1, N + 1)]
    first = [[relative_white(N, q, i, equal_bandwidth(N, q, 1)) for q in ORDERS] for i in range(1, N + 1)]
    why = (
        f"At the mu_q with the same -3 dB point of Xhat_i / (s^(i-1) Y) (mu_q / mu_0: {_listed(rates)}): {_listed(table)}; at "
        f"one mu_q for all, that of xhat_1: {_listed(first)}. What q is worth depends on whose bandwidth is kept."
    )
    return Statement(_falling(table), table[0][1], why)


@PAPER.claim("noise and q: tones", "universal", printed="attenuated more and more by increasing q")
def _():
    equal, bias, band = (_tone(ratio) for ratio in (lambda n, q, i: 1.0, equal_bias, equal_bandwidth))
    why = (
        f"A tone at 20 mu_0, amplitude over that of q = 0: equal mu {_listed(equal)}; equal bias "
        f"{_listed(bias)}; equal bandwidth {_listed(band)}. True of tones well above the bandwidth, "
        "by every measure: the roll-off is 20 (q+1) dB a decade."
    )
    return Statement(all(map(_falling, (equal, bias, band))), 1 / bias[0][1], why)


@PAPER.claim("transfer functions", "identity", printed="(4) in steady state")
def _():
    off, mu, n, q = 0.0, 3.0, 3, 2
    (a, _, b), size = tracker_structure(n, q), n + q
    closed = a - np.outer(np.linalg.solve(tracker_steady(n, q, mu), np.eye(size)[0]), np.eye(size)[0])
    for omega in (0.1, 2.0, 50.0):
        whole = np.abs(np.linalg.solve(1j * omega * np.eye(size) - closed, b.astype(complex)))[q:]
        ours = [float(response(n, q, i, np.asarray(omega / mu))) * mu ** (i - 1) for i in range(1, n + 1)]
        off = max(off, float(np.max(np.abs(np.asarray(ours) / whole - 1))))
    why = (
        "Not printed: Xhat_i / Y = s^(i-1) sum_{j<=n-i} C(N,j) mu^(N-j) s^j / (s+mu)^N. Shown: the largest relative difference "
        "from the resolvent (n = 3, q = 2, mu = 3)."
    )
    return Statement(bool(off < 1e-9), off, why)


@PAPER.claim("robust against any perturbation", "universal", printed="any perturbation of the signal")
def _():
    gains = [float(response(N, q, 1, np.asarray(0.0))) for q in ORDERS]
    listed = ", ".join(f"{g:g}" for g in gains)
    why = (
        f"Robust is not made precise: open. Fast perturbations are filtered, see the tones. A constant offset of y passes to "
        f"xhat_1 with the gain 1 for every q (q = 0..3: {listed}), neither amplified nor removed; below the bandwidth noise "
        "cannot be told from signal."
    )
    return Statement(None, max(gains), why)


@PAPER.claim("loss of asymptotic convergence", "universal", printed="main disadvantage")
def _():
    bias = tracker_gains(N, 1).bias
    listed = ", ".join(f"{b:g} / mu^{N - i}" for i, b in enumerate(bias))
    why = f"Under a constant y^(n) = 1 the error of xhat_i tends to C(n+q, r) / mu^r, r = n-i+1; n = 3, q = 1: {listed}."
    return Statement(all(math.isfinite(b) and b > 0 for b in bias), bias[0], why)


@PAPER.claim("mu regulates precision", "universal", printed="mu large augments the precision")
def _():
    ratio = (200 / 20) ** -3.0
    worst, bias = tracker_gains(N, 1).worst_bias, tracker_gains(N, 1).bias
    why = (
        "Of the part of the error that the signal causes: mu^-(n-i+1), and never more than under a constant y^(n) (worst "
        f"{', '.join(f'{w:.6g}' for w in worst)}, constant {', '.join(f'{b:g}' for b in bias)}; n = 3, q = 1). Shown: error of "
        "xhat_1 at mu = 200 over that at 20. The noise's part grows: see best_rate for the balance."
    )
    return Statement(bool(np.allclose(worst, bias)), ratio, why)
