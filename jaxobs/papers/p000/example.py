"""Section 4: the pendulum, (66)-(71), the figures and the remarks on the sampling period."""

import math
from fractions import Fraction
from functools import lru_cache

import jax.numpy as jnp
import numpy as np

from jaxobs import chain_bounds, linalg
from jaxobs.certificates import exact
from jaxobs.designs import Rung, ladder, riccati_gamma
from jaxobs.integrators import Euler
from jaxobs.observers import StepLuenberger
from jaxobs.papers.claims import Bound, Point, Statement, Value
from jaxobs.papers.p000 import discrete, experiment
from jaxobs.papers.p000.paper import PAPER
from jaxobs.papers.p000.weights import riccati_pair
from jaxobs.plants import Discretised, Pendulum

GAMMA, RHO = experiment.GAMMA, experiment.RHO
SHARP = math.sqrt(1.25)


def _matrices() -> tuple[np.ndarray, np.ndarray]:
    """(P, Q) at alphas (3, 2), gamma = 6."""
    p, q = riccati_pair(jnp.asarray(experiment.ALPHAS), jnp.asarray(GAMMA))
    return np.asarray(p), np.asarray(q)


def _exact(gamma: Fraction) -> tuple[list[Fraction], exact.Matrix, exact.Matrix]:
    """(diagonal of Q, P, P^-1) at alphas (3, 2)."""
    alphas = [Fraction(int(a)) for a in experiment.ALPHAS]
    q = [w * gamma ** (2 * i) for i, w in enumerate(exact.chain_weights(alphas), start=1)]
    p = [[x * gamma ** (i + j + 1) for j, x in enumerate(row)] for i, row in enumerate(exact.chain_riccati(alphas))]
    determinant = p[0][0] * p[1][1] - p[0][1] * p[1][0]
    return q, p, exact.scale(1 / determinant, [[p[1][1], -p[0][1]], [-p[1][0], p[0][0]]])


SAMPLES = [Fraction(1, 2), Fraction(1), Fraction(6)]  # three gammas decide a monomial


@PAPER.claim("(66)-(67) poles", "identity", printed="s^2 + 3s + 2 has s = -1 and s = -2")
def _():
    roots = sorted(np.roots([1.0, *experiment.ALPHAS]).real)
    return Statement(bool(np.allclose(roots, [-2, -1], rtol=0, atol=1e-12)), f"{roots[0]:g}, {roots[1]:g}")


@PAPER.claim("(68) Q", "identity", printed="diag(5 gamma^2, 4 gamma^4)")
def _():
    return Statement(all(_exact(g)[0] == [5 * g**2, 4 * g**4] for g in SAMPLES), "equal", "exactly, at three gammas")


@PAPER.claim("(68) P", "identity", printed="[3 gamma, 2 gamma^2; 2 gamma^2, 6 gamma^3]")
def _():
    agree = all(_exact(g)[1] == [[3 * g, 2 * g**2], [2 * g**2, 6 * g**3]] for g in SAMPLES)
    return Statement(agree, "equal", "exactly, at three gammas")


@PAPER.claim("(68) P^-1 (1,1), (1,2), (2,2)", "identity", printed="3/(7 gamma), -1/(7 gamma^2), 3/(14 gamma^3)")
def _():
    agree = True
    for g in SAMPLES:
        inverse = _exact(g)[2]
        agree &= [inverse[0][0], inverse[0][1], inverse[1][1]] == [
            Fraction(3, 7) / g,
            -Fraction(1, 7) / g**2,
            Fraction(3, 14) / g**3,
        ]
    return Statement(agree, "equal", "exactly, at three gammas")


@PAPER.claim("(68) P^-1 (2,1)", "identity", printed="1/(7 gamma^2)", scan=True)
def _():
    found = _exact(Fraction(1))[2][1][0]
    return Statement(found == Fraction(1, 7), str(found), "at gamma = 1: the minus sign of the entry (1,2) is lost")


@PAPER.claim("(69) p_nn", "identity", printed="3/(14 gamma^3)")
def _():
    agree = all(exact.inverse_corner(_exact(g)[1]) == Fraction(3, 14) / g**3 for g in SAMPLES)
    return Statement(agree, "equal", "exactly, at three gammas")


@PAPER.claim("(69) lambda_max(P)", "identity", printed="3/2 g + 3 g^3 + sqrt(36 g^6 - 20 g^4 + 9 g^2) / 2")
def _():
    """The printed numbers are the larger root of lambda^2 - tr P lambda + det P: trace and discriminant, exactly."""
    agree = True
    for g in SAMPLES:
        p = _exact(g)[1]
        trace, determinant = p[0][0] + p[1][1], p[0][0] * p[1][1] - p[0][1] ** 2
        agree &= trace == 3 * g + 6 * g**3 and trace**2 - 4 * determinant == 36 * g**6 - 20 * g**4 + 9 * g**2
    return Statement(agree, "equal", "trace and discriminant of P, exactly, at three gammas")


def _root_70(gamma: float) -> float:
    """(70) as printed."""
    return math.sqrt(3 / 28 * (6 + 3 / gamma**2 + math.sqrt(36 - 20 / gamma**2 + 9 / gamma**4)))


@PAPER.claim("(70)", "identity", printed="sqrt(3/28 (6 + 3/g^2 + sqrt(36 - 20/g^2 + 9/g^4)))")
def _():
    worst = 0.0
    for gamma in (0.5, 1.0, 6.0, 100.0):
        p = np.asarray([[3 * gamma, 2 * gamma**2], [2 * gamma**2, 6 * gamma**3]])
        worst = max(worst, abs(math.sqrt(np.linalg.inv(p)[1, 1] * np.linalg.eigvalsh(p)[-1]) / _root_70(gamma) - 1))
    return Statement(worst < 1e-9, worst, "largest relative difference at gamma = 0.5, 1, 6, 100")


@PAPER.claim("(70) limit", "universal", printed="the limit for gamma to infinity is independent of gamma")
def _():
    """(P~^-1)_nn lambda_max(S P~ S) -> (P~^-1)_nn P~_nn, S = diag(gamma^{i-n})."""
    p = linalg.chain_riccati(jnp.asarray(experiment.ALPHAS))
    limit = float(jnp.sqrt(p[-1, -1] * jnp.linalg.inv(p)[-1, -1]))
    gap = abs(_root_70(1e6) - limit)
    return Statement(gap < 1e-9, limit, f"sqrt(P~_nn (P~^-1)_nn) = {limit:.7g}; (70) at gamma = 1e6 differs by {gap:.1g}")


def _root_entry(i: int, j: int) -> Value:
    values, vectors = np.linalg.eigh(_matrices()[0])
    return Value(float(((vectors / np.sqrt(values)) @ vectors.T)[i, j]))


@PAPER.claim("(71) P^-1/2 (1,1)", "value", printed="0.2669")
def _():
    return _root_entry(0, 0)


@PAPER.claim("(71) P^-1/2 (1,2)", "value", printed="-0.0134")
def _():
    return _root_entry(0, 1)


@PAPER.claim("(71) P^-1/2 (2,2)", "value", printed="0.0285")
def _():
    return _root_entry(1, 1)


@PAPER.claim("(71) lambda_min", "value", printed="3.5620")
def _():
    return Value(GAMMA * float(chain_bounds.metric_rate(jnp.asarray(experiment.ALPHAS))))


@PAPER.claim("(71) 2 sqrt(p_nn lambda_max)", "value", printed="2.2713")
def _():
    p, _ = _matrices()
    return Value(2 * math.sqrt(np.linalg.inv(p)[1, 1] * np.linalg.eigvalsh(p)[-1]))


@PAPER.claim("(71) largest rho", "value", printed="1.5683")
def _():
    return Value(float(linalg.largest_lipschitz(jnp.asarray(experiment.ALPHAS), jnp.asarray(GAMMA))))


@PAPER.claim("Lipschitz for bounded u", "universal", printed="sin x1 + u cos x1 is Lipschitz for any bounded u")
def _():
    """The slope cos x1 - u sin x1 has the maximum sqrt(1 + u^2), at tan x1 = -u."""
    worst = 0.0
    for u in (0.0, 0.5, 3.0, 100.0):
        at = math.atan(-u)
        worst = max(worst, abs(math.cos(at) - u * math.sin(at) - math.hypot(1, u)) / math.hypot(1, u))
    return Statement(worst < 1e-12, SHARP, f"the constant is sqrt(1 + max u^2), attained: {SHARP:.6g} for |u| <= 1/2")


@PAPER.claim("rho = 3/2", "bound", printed="1.5")
def _():
    smaller = riccati_gamma(alphas=experiment.ALPHAS, lipschitz=SHARP)
    why = f"sup |cos x1 - u sin x1| over |u| <= 1/2 is sqrt(1.25): (5) then holds for gamma > {smaller:.5g}"
    return Bound(SHARP, "upper", why)


@PAPER.claim("gamma = 6", "feasible", printed="6")
def _():
    smallest = riccati_gamma(alphas=experiment.ALPHAS, lipschitz=RHO)
    return Point(smallest < GAMMA, smallest, f"(5) holds for gamma > {smallest:.7g} at rho = 3/2")


@lru_cache
def rungs(q: int = 0) -> tuple[Rung, ...]:
    """The ladder of certificates for the pendulum with rho = 3/2 and the slopes of |u| <= 1/2; alphas (3, 2), or C(4, k) for q
    = 2.
    """
    alphas = experiment.ALPHAS if q == 0 else discrete.C4
    slopes = [(-SHARP, SHARP), (0.0, 0.0)]
    return ladder(Pendulum(), alphas=alphas, lipschitz=RHO, states=(1,), slopes=slopes, q=q)


def _smallest(place: int, why: str) -> Bound:
    rung = rungs()[place]
    proved = rung.certificate is not None and rung.certificate.verify().holds
    behind = f"; with q = 2, C(4, k): {value:.6g}" if (value := rungs(2)[place].smallest_gamma) is not None else ""
    where = f"certified exactly at {rung.gamma:.5g}" if proved else "without a certificate"
    return Bound(float(rung.smallest_gamma or 0.0), "upper", f"needs {rung.needs}: {why}; {where}{behind}")


@PAPER.claim("gamma = 6: (5)", "bound", printed="6", long=True)
def _():
    return _smallest(0, "the paper's condition")


@PAPER.claim("gamma = 6: S-lemma, same P", "bound", printed="6", long=True)
def _():
    return _smallest(1, "one worst case instead of two")


@PAPER.claim("gamma = 6: S-lemma, free P", "bound", printed="6", long=True)
def _():
    return _smallest(2, "P need not solve the Riccati equation")


@PAPER.claim("gamma = 6: structure", "bound", printed="6", long=True)
def _():
    return _smallest(3, "the M and N of section 4")


@PAPER.claim("gamma = 6: box corners", "bound", printed="6", long=True)
def _():
    return _smallest(4, "the slopes lie in an interval")


@PAPER.claim("gamma = 6: output injection", "bound", printed="6", long=True)
def _():
    return _smallest(5, "phi(y, u) makes the error linear, so every gamma > 0 will do")


def _late(observer, period: float = experiment.PERIOD, noisy: bool = False) -> float:
    """RMS of x_2 - xhat_2 over t >= 10 s."""
    path = experiment.run(observer, noisy=noisy, period=period)
    late = np.asarray(path.ts) >= experiment.AFTER
    return float(np.sqrt(np.mean(np.asarray(path.x - path.xhat)[late, 1] ** 2)))


@PAPER.claim("Figure 1", "figure", printed="x2 and its estimate by the high-gain observer")
def _():
    rms = _late(experiment.plain())
    return Statement(rms < 1e-9, rms, "recomputed, x(0) = (1, 0), estimate from 0 (ours): RMS error of x_2 over t >= 10 s")


@PAPER.claim("Figure 2", "figure", printed="the noisy output")
def _():
    path = experiment.run(experiment.plain(), noisy=True)
    spread = float(np.std(np.asarray(path.y)[:, 0] - np.asarray(path.x)[:, 0]))
    why = (
        f"the paper names neither level nor sampling of the noise; ours: Gaussian, {experiment.SIGMA:g}, held "
        f"{experiment.PERIOD:g} s"
    )
    return Statement(abs(spread / experiment.SIGMA - 1) < 0.1, spread, why)


@PAPER.claim("Figure 3", "figure", printed="x2 and its estimate by the robust observer, q = 2, C(4, k)")
def _():
    rms = _late(experiment.integral(), noisy=True)
    law = experiment.SIGMA * math.sqrt(experiment.PERIOD * GAMMA**3 / 32)
    why = (
        f"recomputed at gamma = 6 (ours, the paper leaves it open): RMS error of x_2 over t >= 10 s, {law:.3g} by the noise law"
    )
    return Statement(abs(rms / law - 1) < 0.2, rms, why)


@PAPER.claim("Conclusions: filtered estimates", "figure", printed="nicer estimates than a classical Luenberger observer")
def _():
    robust, classical = _late(experiment.integral(), noisy=True), _late(experiment.plain(), noisy=True)
    why = (
        f"RMS error of x_2 at equal gamma = 6: {robust:.3g} against {classical:.3g} with alphas (3, 2). The rows on noise say "
        "what is left at equal speed"
    )
    return Statement(robust < classical, classical / robust, why)


def _sampled(gain: np.ndarray, delta: float) -> StepLuenberger:
    return StepLuenberger(Discretised(Pendulum(), Euler(), jnp.asarray(delta)), jnp.asarray(gain)[:, None])


@PAPER.claim(
    "sampling: bandwidth, Shannon",
    "universal",
    printed="the choice of delta also depends on the bandwidth of the states",
    long=True,
)
def _():
    """(53) at gamma = 6, and (51) with the printed X for 0.525, on the pendulum itself: RMS error of x_2 over t >= 10 s."""
    gains = {0.01: discrete.riccati_gain(0.01), 0.0915: discrete.riccati_gain(0.0915), 0.525: discrete.printed_gain(0.525)}
    errors = {d: _late(_sampled(gains[d], d), d) for d in sorted(gains)}
    x2 = np.asarray(experiment.run(experiment.plain(), end=100.0).x)[:, 1]
    band = float(chain_bounds.bandwidth(jnp.asarray(x2), jnp.asarray(experiment.PERIOD)))
    shannon = float(chain_bounds.shannon_period(jnp.asarray(band)))
    said = ", ".join(f"{error:.2g} at delta = {d:g}" for d, error in errors.items())
    why = (
        f"theorem 2 is about the Euler model. On the pendulum an error of x_2 remains: {said} (RMS, no noise). 99 % of the "
        f"power of x_2 lies below {band:.3g} rad/s, so Shannon allows {shannon:.3g} s: the Euler model is what limits delta"
    )
    return Statement(bool(np.all(np.diff(list(errors.values())) > 0)), errors[0.525], why)
