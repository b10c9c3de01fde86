"""Section 2.2: Theorem 2, its proof, and what peaks."""

import functools
import itertools
import math

import numpy as np
import scipy.linalg

from jaxobs.designs.tracker_bounds import Peak, peak, transition, transition_steady
from jaxobs.linalg import tracker_structure
from jaxobs.papers.claims import Statement
from jaxobs.papers.p001.paper import PAPER

N, Q, RATES = 3, 1, (20.0, 100.0, 200.0, 1000.0)


@functools.cache
def _table(start: float | tuple[float, ...] | None) -> list[Peak]:
    return [peak(N, Q, mu, None if start is None else np.asarray(start)) for mu in RATES]


def _at_rates(values) -> str:
    return ", ".join(f"{v:.5g}" for v in values) + f" at mu = {', '.join(f'{mu:g}' for mu in RATES)}"


@PAPER.claim("(24)-(25) V' <= -mu V", "universal", printed="V = eta'H eta")
def _():
    worst = -math.inf
    for mu in (3.0, 20.0):
        for t in (0.1, 0.5, 1.0):
            phi = transition(N, Q, mu, 1.0, t)
            back = scipy.linalg.expm(-tracker_structure(N, Q)[0] * t)
            v = phi.T @ (math.exp(-mu * t) * back.T)  # Phi'H Phi = Phi' e^{-mu t} e^{-A't} H(0), H(0) = I
            worst = max(worst, float(np.linalg.eigvalsh((v + v.T) / 2)[-1] * math.exp(mu * t)))
    why = "V' = -mu V - (C eta)^2. Shown: the largest V(t) e^{mu t} / V(0) over mu = 3, 20 and t = 0.1, 0.5, 1 (n = 3, q = 1)."
    return Statement(bool(worst <= 1 + 1e-9), worst, why)


@PAPER.claim("(26) ||eta||", "universal", printed="||eta||^2 <= e^{-mu t} ||H(0)|| ||eta(0)||^2 / lambda_min(H(t))")
def _():
    worst = 0.0
    for mu, t in ((3.0, 0.3), (3.0, 1.0), (10.0, 0.5)):
        phi = transition(N, Q, mu, 1.0, t)
        back = scipy.linalg.expm(-tracker_structure(N, Q)[0] * t)
        h = math.exp(-mu * t) * back.T @ np.linalg.inv(phi)
        worst = max(worst, float(np.linalg.norm(phi, 2) ** 2 * np.linalg.eigvalsh((h + h.T) / 2)[0] * math.exp(mu * t)))
    return Statement(
        bool(worst <= 1 + 1e-9), worst, "From (25). Shown: the largest ratio of both sides at three (mu, t), H(0) = I."
    )


@PAPER.claim("(27) epsilon", "universal", printed="lambda_min of the integral >= epsilon for all t > 0")
def _():
    eps = []
    for t in (1.0, 0.1, 0.01):
        nodes, weights = np.polynomial.legendre.leggauss(12)
        rows = [
            scipy.linalg.expm(-tracker_structure(2, 0)[0] * t * (1 + s) / 2)[0] * math.exp(-t * (1 + s) / 2) ** 0.5
            for s in nodes
        ]
        eps.append(float(np.linalg.eigvalsh(sum(w * t / 2 * np.outer(r, r) for w, r in zip(weights, rows, strict=True)))[0]))
    why = (
        f"The integral vanishes at t = 0: its smallest eigenvalue is {eps[0]:.3g}, {eps[1]:.3g}, {eps[2]:.3g} at t = 1, 0.1, "
        "0.01 (n = 2, q = 0, mu = 1). Positive for each t > 0, but no constant epsilon serves them all."
    )
    vanishes = all(0 < b < a / 100 for a, b in itertools.pairwise(eps))
    return Statement(False if vanishes else None, eps[-1], why)


@PAPER.claim("(28) bound", "universal", printed="||eta||^2 <= e^{-mu t} / (e^{-(mu+sqrt(n+q))t} + eps eps_0) ||eta(0)||^2")
def _():
    eps = 0.1
    why = (
        "With the constant epsilon of (27) it fails at t = 0, where it reads 1 <= 1 / (1 + eps eps_0) (shown for eps eps_0 = "
        "0.1). Right: ||eta||^2 <= min(kappa e^(rho t), e^(-mu t) lambda_max(H(0)) / eps(t)) ||eta(0)||^2, kappa = cond H(0), "
        "with eps(t) as it is; that mends the proof of Theorem 2."
    )
    return Statement(bool(1 / (1 + eps) >= 1), 1 / (1 + eps), why)


@PAPER.claim("(28) maximum", "identity", printed="sqrt(n+q) (mu e/sqrt(n+q))^(mu/(mu+sqrt(n+q))) / (e (mu+sqrt(n+q)))")
def _():
    off = 0.0
    for mu, c, r in ((20.0, 1e-3, 2.0), (50.0, 1e-6, 1.7)):
        t = np.linspace(0, 2, 200001)
        found = float(np.max(np.exp(-mu * t) / (np.exp(-(mu + r) * t) + c)))
        off = max(off, abs(r * (mu * c / r) ** (mu / (mu + r)) / (c * (mu + r)) / found - 1))
    why = (
        "The algebra is right while mu eps eps_0 < sqrt(n+q), so that the maximum lies at t >= 0. Shown: the relative "
        "difference from a grid. With eps fixed and mu large it lies at t < 0."
    )
    return Statement(bool(off < 1e-6), off, why)


@PAPER.claim("(28) limit", "identity", printed="1")
def _():
    bounds = [one.bound for one in _table(1.0)]
    why = f"The mended bound on sup ||eta|| / ||eta(0)|| tends to 1: {_at_rates(bounds)} (n = 3, q = 1, H(0) = I)."
    falling = all(b < a for a, b in itertools.pairwise(bounds))
    return Statement(falling and bounds[-1] < 1.05, bounds[-1], why)


@PAPER.claim("Theorem 2", "universal", printed="nonpeaking for H(0) = I / eps_0")
def _():
    table = _table(1.0)
    why = (
        f"True; the proof is mended at (28). sup ||eta|| / ||eta(0)|| is {_at_rates([one.value for one in table])} (n = 3, q = "
        "1, H(0) = I), below the bound there."
    )
    return Statement(all(one.value <= one.bound for one in table), table[2].value, why)


@PAPER.claim("(2) nonpeaking", "universal", printed="(2) is a nonpeaking differentiation system")
def _():
    table = [peak(N, 0, mu, 1.0) for mu in RATES]
    why = f"Theorem 2 with q = 0: {_at_rates([one.value for one in table])} (n = 3, H(0) = I)."
    return Statement(all(one.value <= one.bound for one in table), table[2].value, why)


@PAPER.claim("eps_0 in ]0, 1[", "universal", printed="a small positive parameter")
def _():
    table = _table(0.1)
    why = (
        f"Not needed: for eps_0 = 10 the peak is {_at_rates([one.value for one in table])}; the limit is 1 for every eps_0 > 0."
    )
    return Statement(all(one.value <= one.bound for one in table), table[-1].value, why)


@PAPER.claim("other H(0)", "universal", printed="a suitable choice of initial conditions")
def _():
    table = _table((1.0, 1.0, 1.0, 1e-4))
    why = (
        "Every fixed H(0) > 0 is nonpeaking uniformly in mu, with the limit bound sqrt(cond H(0)); it need not be small: "
        f"diag(1, 1, 1, 1e-4) peaks at {_at_rates([one.value for one in table])}, bounds "
        f"{', '.join(f'{one.bound:.4g}' for one in table)} (n = 3, q = 1)."
    )
    return Statement(all(one.value <= one.bound for one in table), max(one.value for one in table), why)


@PAPER.claim("static gains peak", "universal", printed="the peaking phenomenon of high-gain observers")
def _():
    table = _table(None)
    slope = math.log(table[2].value / table[0].value) / math.log(RATES[2] / RATES[0])
    why = (
        f"From H(0) = H_inf, the steady gain at once: {_at_rates([one.value for one in table])}, i.e. mu^{slope:.3f}, expected "
        f"mu^(n+q-1) (n = 3, q = 1); from H(0) = I at mu = 200: {_table(1.0)[2].value:.4g}."
    )
    return Statement(bool(abs(slope - (N + Q - 1)) < 0.1), table[2].value, why)


@PAPER.claim("large mu and the transient", "universal", printed="large mu does not affect the transient behaviour")
def _():
    mu = 60.0

    def settled(phi) -> float:
        ts = np.linspace(0, 2, 1001)
        return float(ts[np.asarray([np.linalg.norm(phi(t), 2) for t in ts]) > 0.05][-1])

    gentle, steady = settled(lambda t: transition(N, Q, mu, 1.0, t)), settled(lambda t: transition_steady(N, Q, mu, t))
    why = (
        f"It does not peak, at a price: ||eta|| stays below 5 % of ||eta(0)|| from {gentle:.4g} s on with H(0) = I, from "
        f"{steady:.4g} s with the steady gain (n = 3, q = 1, mu = 60)."
    )
    return Statement(bool(gentle > steady), gentle, why)
