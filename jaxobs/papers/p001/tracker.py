"""Section 2.1: the tracker, its Lyapunov equation, Theorem 1."""

import math
from fractions import Fraction

import numpy as np
import scipy.integrate
import scipy.linalg

from jaxobs.certificates import exact
from jaxobs.designs import tracker_bounds
from jaxobs.linalg import tracker_steady, tracker_structure
from jaxobs.papers.claims import Statement
from jaxobs.papers.p001.paper import PAPER, SIZES, largest, right_side, steady, structure
from jaxobs.papers.p001.paper import gain as gain_of
from jaxobs.papers.p001.paper import tracker as make_tracker

MU = Fraction(7, 2)


@PAPER.claim("(2) poles", "identity", printed="static form -mu P - A'P - P A + C'C = 0")
def _():
    """The characteristic polynomial of A - P^-1 C'C is (s + mu)^n."""
    off = 0.0
    for n in (2, 3, 5):
        gain = np.asarray([math.comb(n, i) * 2.0**i for i in range(1, n + 1)])
        residual = np.linalg.solve(np.asarray(steady(n, 0, Fraction(2)), float), np.eye(n)[0]) - gain
        off = max(off, float(np.max(np.abs(residual / gain))))
    return Statement(
        bool(off < 1e-9), off, "P^-1 C' = (C(n, i) mu^i): all n poles lie at -mu. Largest relative residual, n = 2, 3, 5."
    )


@PAPER.claim("(3) and (4) agree", "identity", printed="(4) is (3) in matrix form")
def _():
    off, rng = 0.0, np.random.default_rng(0)
    for n, q in ((2, 1), (3, 2), (2, 3)):
        mu = 3.0
        tracker, eta, y = make_tracker(n, q, mu, tracker_steady(n, q, mu)), rng.normal(size=n + q), 0.7
        k = np.linalg.solve(tracker_steady(n, q, mu), np.eye(n + q)[0])
        xi, xhat = eta[:q], eta[q:]
        written = np.concatenate([np.append(xi[1:], y - xhat[0]) - k[:q] * xi[0], np.append(xhat[1:], 0) - k[q:] * xi[0]])
        ours = right_side(tracker, eta, 0.0, y)
        off = max(off, float(np.max(np.abs(ours - written)) / np.max(np.abs(written))))
    return Statement(bool(off < 1e-12), off, "(3), row by row, against the tracker's right-hand side.")


@PAPER.claim("(7) H(t)", "identity", printed="explicit solution of the Lyapunov equation")
def _():
    off = 0.0
    for n, q in ((3, 0), (2, 1)):
        a, _, c = (np.asarray(m, float) for m in structure(n, q))
        mu, start, t = 4.0, 0.3, 0.6

        def integrand(s, a=a, c=c, mu=mu):
            row = c @ scipy.linalg.expm(-a * s)
            return math.exp(-mu * s) * row.T @ row

        back = scipy.linalg.expm(-a * t)
        h = math.exp(-mu * t) * start * back.T @ back + scipy.integrate.quad_vec(integrand, 0, t, epsabs=1e-13)[0]
        gain = np.linalg.solve(h, c[0])
        ours = gain_of(make_tracker(n, q, mu, start), t)
        off = max(off, float(np.max(np.abs(ours - gain)) / np.max(np.abs(gain))))
    return Statement(bool(off < 1e-9), off, "The gain of (7) by quadrature against the closed form that the tracker uses.")


@PAPER.claim("(7) H(t) > 0", "universal", printed="H(t) is always positive definite")
def _():
    lows = []
    for n, q in SIZES:
        for tau in (0.01, 1.0, 30.0):
            h = np.linalg.inv(tracker_bounds.transition(n, q, 1.0, 1.0, tau))  # H = e^{-t} e^{-A't} H(0) Phi^-1
            back = scipy.linalg.expm(-tracker_structure(n, q)[0] * tau)
            h = math.exp(-tau) * back.T @ h
            d = np.sqrt(np.diag(h))
            lows.append(float(np.linalg.eigvalsh((h + h.T) / 2 / np.outer(d, d))[0]))
    why = (
        "The first term of (7) is a congruence of H(0) > 0 and the second is >= 0: proved for every t. Shown: the smallest "
        "eigenvalue of H(t) scaled to unit diagonal, over (n, q) and mu t = 0.01, 1, 30."
    )
    return Statement(bool(min(lows) > 0), min(lows), why)


@PAPER.claim("(8) integral", "identity", printed="int_0^inf e^{-mu(t-tau)} ... dtau")
def _():
    rate, longer = 2.0, [math.expm1(2.0 * end) / 2.0 for end in (5.0, 10.0)]  # n = 1: int_0^end e^{mu tau} dtau
    why = (
        f"With tau from 0 to infinity at fixed t the integral diverges (n = 1, mu = {rate:g}: {longer[0]:.3g} up to tau = 5, "
        f"{longer[1]:.3g} up to 10). Meant is s = t - tau: int_0^inf e^{{-mu s}} e^{{-A's}} C'C e^{{-As}} ds, as the result "
        "shows."
    )
    return Statement(False if longer[1] > 100 * longer[0] else None, longer[1], why)


@PAPER.claim("(8) H_inf", "identity", printed="(H~)_ij / mu^(i+j-1)")
def _():
    off = 0.0
    for n, q in SIZES:
        scaled, unit = steady(n, q, MU), steady(n, q, Fraction(1))
        off = max(off, *(abs(float(scaled[i][j] * MU ** (i + j + 1) - unit[i][j])) for i in range(n + q) for j in range(n + q)))
        off = max(off, largest(_lyapunov(n, q, MU)))
    why = (
        "In closed form (H~)_ij = (-1)^(i+j) s_i s_j C(i+j-2, i-1), s = 1 on xi and -1 on xhat; residual of (11) in fractions."
    )
    return Statement(bool(off == 0), off, why)


def _lyapunov(n: int, q: int, mu: Fraction) -> exact.Matrix:
    """-mu H - A'H - H A + C'C for the closed form."""
    a, _, c = structure(n, q)
    h = steady(n, q, mu)
    ah = exact.product(exact.transpose(a), h)
    return exact.subtract(
        exact.product(exact.transpose(c), c), exact.add(exact.scale(mu, h), exact.add(ah, exact.transpose(ah)))
    )


@PAPER.claim("(9)-(10) error equation", "identity", printed="z' = (A~ - H^-1 C'C) z + B_xi d - B y^(n)")
def _():
    n, q, mu = 3, 2, 3.0
    tracker = make_tracker(n, q, mu, 0.5)
    rng = np.random.default_rng(1)
    xi, xhat, x, d, top = rng.normal(size=q), rng.normal(size=n), rng.normal(size=n), 0.3, 1.7  # top is y^(n)
    eta, elapsed = np.concatenate([xi, xhat]), 0.4
    moved = right_side(tracker, eta, elapsed, x[0] + d)
    left = np.asarray(moved) - np.concatenate([np.zeros(q), np.append(x[1:], top)])
    a, _, b = tracker_structure(n, q)
    gain = gain_of(tracker, elapsed)
    z = np.concatenate([xi, xhat - x])
    right = a @ z - gain * z[0] + b * d - np.eye(n + q)[-1] * top
    off = float(np.max(np.abs(left - right)) / np.max(np.abs(right)))
    return Statement(bool(off < 1e-12), off, "For q > 0; without integrators d enters through H^-1 C' instead of B_xi.")


@PAPER.claim("(11) H_inf", "identity", printed="-mu H - A'H - H A + C'C = 0")
def _():
    off = max(largest(_lyapunov(n, q, MU)) for n, q in SIZES)
    return Statement(bool(off == 0), off, f"Exact, at mu = {MU}, for (n, q) = {SIZES}.")


@PAPER.claim("(5) V'", "identity", printed="V' = z'(A0'H + H A0 + 2 H dH C'C) z + 2 d B'H z - 2 y^(n) B'H z")
def _():
    n, q, mu, t = 2, 1, 3.0, 0.5
    (a, _, b), c = tracker_structure(n, q), np.eye(n + q)[0]
    h, rng = tracker_steady(n, q, mu), np.random.default_rng(2)
    z, d, top = rng.normal(size=n + q), 0.7, -1.1
    gain = gain_of(make_tracker(n, q, mu, 0.4), t)
    moved = (a - np.outer(gain, c)) @ z + b * d - np.eye(n + q)[-1] * top
    best = np.linalg.solve(h, c)
    a0 = a - np.outer(best, c)
    right = z @ (a0.T @ h + h @ a0 + 2 * h @ np.outer(best - gain, c)) @ z + 2 * d * b @ h @ z - 2 * top * h[-1] @ z
    off = abs(2 * z @ h @ moved / right - 1)
    return Statement(bool(off < 1e-10), off, "Numbered (5) although it follows (11).")


@PAPER.claim("(12) V' bound", "universal", printed="V' <= -(mu - 2||.||) V + ...")
def _():
    off = 0.0
    for n, q in SIZES:
        a, _, c = structure(n, q)
        h = steady(n, q, MU)
        gain = [[Fraction(x)] for x in _steady_gain(n, q, MU)]
        a0 = exact.subtract(a, exact.product(gain, c))
        both = exact.product(exact.transpose(a0), h)
        left = exact.add(both, exact.transpose(both))
        right = exact.scale(Fraction(-1), exact.add(exact.scale(MU, h), exact.product(exact.transpose(c), c)))
        off = max(off, largest(exact.subtract(left, right)))
    why = (
        "A0'H + H A0 = -mu H - C'C exactly (residual shown, in fractions), so even (C z)^2 is left over; the rest is "
        "Cauchy-Schwarz."
    )
    return Statement(bool(off == 0), off, why)


def _steady_gain(n: int, q: int, mu: Fraction) -> list[Fraction]:
    return [(1 if i <= q or q == 0 else -1) * math.comb(n + q, i) * mu**i for i in range(1, n + q + 1)]


@PAPER.claim("(13) scaling", "identity", printed="H = mu D H~ D, D = diag(mu^-i)")
def _():
    off = 0.0
    for n, q in SIZES:
        d = exact.diagonal([1 / MU ** (i + 1) for i in range(n + q)])
        right = exact.scale(MU, exact.product(d, exact.product(steady(n, q, Fraction(1)), d)))
        off = max(off, largest(exact.subtract(steady(n, q, MU), right)))
    return Statement(bool(off == 0), off, "In fractions.")


@PAPER.claim("(14) V between its bounds", "universal", printed="mu l ||D z||^2 <= V <= mu L ||D z||^2")
def _():
    n, q = 3, 1
    low, high = np.linalg.eigvalsh(tracker_steady(n, q))[[0, -1]]
    why = f"V = mu (D z)'H~(D z) by (13); n = 3, q = 1: eigenvalues of H~ from {low:.4g} to {high:.6g}, their ratio shown."
    return Statement(bool(0 < low < high), float(high / low), why)
