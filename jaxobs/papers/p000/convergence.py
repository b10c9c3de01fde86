"""(4)-(6), (22)-(36): theorem 1, its constants, corollary 1."""

import math
from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from jaxobs import chain_bounds, linalg
from jaxobs.certificates import exact
from jaxobs.designs import NormBounded, riccati, riccati_gamma, s_lemma_riccati
from jaxobs.observers import HighGain
from jaxobs.papers.claims import Statement
from jaxobs.papers.p000 import experiment
from jaxobs.papers.p000.paper import PAPER
from jaxobs.papers.p000.weights import SAMPLES, riccati_pair
from jaxobs.plants import Pendulum

ALPHAS, GAMMA, RHO = jnp.asarray(experiment.ALPHAS), experiment.GAMMA, experiment.RHO


def _array(x: float) -> jnp.ndarray:
    return jnp.asarray(float(x))


@PAPER.claim("(4)-(6) Theorem 1", "universal", printed="(5) implies exponential convergence")
def _():
    _, certificate = riccati(Pendulum(), alphas=experiment.ALPHAS, gamma=GAMMA, lipschitz=RHO)
    verdict = certificate.verify()
    rate = verdict.margins["decay_rate_of_V"]
    why = f"at gamma = {GAMMA:g}, rho = {RHO:g} the inequalities behind (5) hold in exact arithmetic, V' <= -{rate:.4g} V"
    return Statement(verdict.holds, rate, why)


@PAPER.claim("(5) with equality", "universal", printed="rho <= ..., equality included", long=True)
def _():
    """At equality V' = 0 would need e1 = 0, e parallel to B, and e an eigenvector of P: but P_1n = alpha_n gamma^n > 0. The
    worst V' over all phi with (4) is a continuous function of e alone, of degree 2, hence at most -c V with one c > 0.
    """
    smallest = riccati_gamma(alphas=experiment.ALPHAS, lipschitz=RHO)
    gamma = smallest * (1 - 1e-9)
    worst = _worst_rate(smallest)
    edge = float(linalg.largest_lipschitz(ALPHAS, _array(smallest))) - RHO
    _, certificate = s_lemma_riccati(Pendulum(), alphas=experiment.ALPHAS, slope=NormBounded.lipschitz(2, RHO), gamma=gamma)
    why = (
        f"the last lines of the proof ask for <, but <= is enough: at equality (gamma = {smallest:.6g}, largest rho minus rho "
        f"{edge:.1g}) V' <= -|Ce|^2, and the other inequalities are equalities together only for e parallel to B, which is no "
        "eigenvector of P as P_1n = alpha_n gamma^n > 0. So the worst V' over all phi with (4), also in time, is a continuous "
        f"function of e, of degree 2 and negative: V' <= {worst:.4g} V there. Just below that gamma the S-lemma certifies P, "
        "exactly"
    )
    return Statement(certificate.verify().holds and worst < 0, smallest, why)


@PAPER.claim("(22)-(23)", "identity", printed="A'P^-1 + P^-1 A - 2C'C = -P^-1 Q P^-1 - C'C")
def _():
    worst = 0.0
    for alphas in SAMPLES:
        p, q = (np.asarray(m) for m in riccati_pair(jnp.asarray(alphas), _array(1.0)))
        n = len(alphas)
        a, c, inverse = np.eye(n, k=1), np.eye(1, n), np.linalg.inv(p)
        left = a.T @ inverse + inverse @ a - 2 * c.T @ c
        worst = max(
            worst, float(np.max(np.abs(left + inverse @ q @ inverse + c.T @ c)) / np.max(np.abs(inverse @ q @ inverse)))
        )
    return Statement(worst < 1e-12, worst, "largest relative residual, n = 2..4")


@PAPER.claim("(24)", "universal", printed="V' <= -(lambda_min - 2 rho sqrt(p_nn lambda_max(P))) V")
def _():
    worst = _worst_rate(GAMMA)
    bound = -float(chain_bounds.decay_rate(ALPHAS, _array(GAMMA), _array(RHO)))
    why = (
        f"the largest V'/V at gamma = {GAMMA:g} is {worst:.4g}, the bound {bound:.4g}; the term -|Ce|^2 and two worst cases "
        "are left out"
    )
    return Statement(worst <= bound, worst, why)


def _worst_rate(gamma: float) -> float:
    """The largest V'/V over e and |phi - phihat| <= rho |e|, at e = P^1/2 v: found on a fine circle of directions."""
    p, q = (np.asarray(m) for m in riccati_pair(ALPHAS, _array(gamma)))
    inverse = np.linalg.inv(p)
    angle = np.linspace(0, np.pi, 200_001)
    e = np.linalg.cholesky(p) @ np.stack([np.cos(angle), np.sin(angle)])
    v = np.sum(e * (inverse @ e), axis=0)
    fall = np.sum(e * (inverse @ q @ inverse @ e), axis=0) + e[0] ** 2
    return float(np.max((-fall + 2 * RHO * np.linalg.norm(e, axis=0) * np.abs(inverse[1] @ e)) / v))


@PAPER.claim("(24) arbitrary rate", "universal", printed="arbitrary rate of convergence")
def _():
    wanted = 1000.0
    gamma = 2 * max(wanted / float(chain_bounds.metric_rate(ALPHAS)), riccati_gamma(alphas=experiment.ALPHAS, lipschitz=RHO))
    rate = float(chain_bounds.decay_rate(ALPHAS, _array(gamma), _array(RHO)))
    why = f"the certified rate of V grows like gamma: {rate:.4g} at gamma = {gamma:.4g}"
    return Statement(rate > wanted, rate, why)


@PAPER.claim("any rho", "universal", printed="for any rho there is a gamma with (5)")
def _():
    """(5) reads gamma l~ / (2 sqrt((P~^-1)_nn lambda_max(S P~ S))) > rho with S <= I for gamma >= 1: the left side is
    unbounded.
    """
    rhos = [10.0**k for k in range(-2, 5)]
    found = [[riccati_gamma(alphas=a, lipschitz=r) for r in rhos] for a in SAMPLES]
    ends = np.asarray(found)[:, -1]
    why = f"smallest gamma for rho = 1e4: {ends.min():.6g} to {ends.max():.6g} over {len(SAMPLES)} sets of alphas, n = 2..4"
    return Statement(bool(np.all(np.isfinite(found)) and np.all(np.diff(found) > 0)), float(ends.max()), why)


@PAPER.claim("(25)", "identity", printed="p_nn = (P~^-1)_nn / gamma^{2n-1}")
def _():
    worst = 0.0
    for alphas in SAMPLES:
        p = exact.chain_riccati([Fraction(a) for a in alphas])
        scaled = [[Fraction(6) ** (i + j + 1) * x for j, x in enumerate(row)] for i, row in enumerate(p)]
        worst = max(worst, float(abs(exact.inverse_corner(scaled) * 6 ** (2 * len(p) - 1) - exact.inverse_corner(p))))
    return Statement(worst == 0, worst, "difference, exactly, at gamma = 6, n = 2..4")


@PAPER.claim("(26)", "universal", printed="|P^1/2| <= sqrt(n) |P^1/2|_inf")
def _():
    """For the symmetric root |R|_2 = spectral radius <= |R|_inf (largest row sum): sqrt(n) is not even needed."""
    worst = 0.0
    for alphas in SAMPLES:
        for gamma in (0.3, 1.0, 6.0):
            p, _ = riccati_pair(jnp.asarray(alphas), _array(gamma))
            values, vectors = np.linalg.eigh(np.asarray(p))
            root = (vectors * np.sqrt(values)) @ vectors.T
            worst = max(worst, math.sqrt(values[-1]) / np.max(np.sum(np.abs(root), axis=1)))
    why = (
        "with the largest row sum as norm; a symmetric matrix has |R| <= |R|_inf even without sqrt(n): the ratio is at most "
        f"{worst:.4g}"
    )
    return Statement(bool(worst <= math.sqrt(2)), worst, why)


@PAPER.claim("(26) constant", "universal", printed="sqrt(p_nn lambda_max(P)) remains constant as gamma increases")
def _():
    """Read as a limit, as the paper's own remark after (70) does."""
    p = linalg.chain_riccati(ALPHAS)
    at = {g: _root_of_product(g) for g in (1.0, 6.0, 100.0, 1e4)}
    limit = float(jnp.sqrt(p[-1, -1] * jnp.linalg.inv(p)[-1, -1]))
    numbers = ", ".join(f"{value:.6g} at gamma = {g:g}" for g, value in at.items())
    why = (
        f"in the limit, as the remark after (70) says, which is all that the proof needs: {limit:.6g} for alphas (3, 2), "
        f"{numbers}"
    )
    values = list(at.values())
    return Statement(values == sorted(values, reverse=True) and abs(values[-1] / limit - 1) < 1e-6, limit, why)


def _root_of_product(gamma: float) -> float:
    """sqrt(p_nn lambda_max(P)) at alphas (3, 2)."""
    p, _ = riccati_pair(ALPHAS, _array(gamma))
    return float(jnp.sqrt(jnp.linalg.inv(p)[-1, -1] * jnp.linalg.eigvalsh(p)[-1]))


@PAPER.claim("(27)", "identity", printed="P_ii = c_ii Q_ii / gamma")
def _():
    worst = 0.0
    for alphas in SAMPLES:
        c = np.asarray(chain_bounds.diagonal_ratios(jnp.asarray(alphas)))
        for gamma in (0.5, 6.0):
            p, q = (np.diagonal(np.asarray(m)) for m in riccati_pair(jnp.asarray(alphas), _array(gamma)))
            worst = max(worst, float(np.max(np.abs(c * q / gamma / p - 1))))
    return Statement(worst < 1e-14, worst, "c_ii = P~_ii / q_i; largest relative difference, n = 2..4")


@PAPER.claim("(28) lambda_n", "universal", printed="Q > (gamma / lambda_n) P for a lambda_n that depends on n")
def _():
    """lambda_n > 1 / l~, l~ = lambda_min(P~^-1/2 Q~ P~^-1/2); decided exactly at 1 / lambda_n = 0.9999 l~."""
    holds, found = True, []
    for alphas in SAMPLES:
        rate = float(chain_bounds.metric_rate(jnp.asarray(alphas)))
        found.append(1 / rate)
        exactly = [Fraction(a) for a in alphas]
        q, p = exact.diagonal(exact.chain_weights(exactly)), exact.chain_riccati(exactly)
        holds &= exact.is_positive_definite(exact.combine(Fraction(1), q, -Fraction(0.9999 * rate), p))
    same_n = [f for f, a in zip(found, SAMPLES, strict=True) if len(a) == 2]
    why = (
        f"true, but it does not follow from the diagonals (27) alone, and lambda_n depends on the alphas too: {same_n[0]:.5g} "
        f"for (3, 2), {same_n[1]:.5g} for (2, 1)"
    )
    return Statement(holds, found[0], why)


@PAPER.claim("(29)", "universal", printed="P^-1/2 Q P^-1/2 > (gamma / lambda_n) I", long=True)
def _():
    worst = min(
        float(jnp.linalg.eigvalsh(chain_bounds.normalised_weight(jnp.asarray(a), _array(g)))[0])
        / (g * float(chain_bounds.metric_rate(jnp.asarray(a))))
        for a in SAMPLES
        for g in (0.3, 1.0, 3.0)
    )
    return Statement(
        worst > 0.9999, worst, "(28) by congruence; lambda_min / (gamma l~) is 1, so any 1 / lambda_n < l~ will do"
    )


@PAPER.claim("(30)", "universal", printed="the difference of (29) at gamma1 and gamma2 is > (gamma1 - gamma2) / lambda_n I")
def _():
    low, ratio = 0.659, 1.05
    gap = chain_bounds.normalised_weight(ALPHAS, _array(low * ratio)) - chain_bounds.normalised_weight(ALPHAS, _array(low))
    slope = float(jnp.linalg.eigvalsh(gap)[0]) / (low * (ratio - 1))
    sharp = float(chain_bounds.metric_rate(ALPHAS))
    one_over = (slope + sharp) / 2
    why = (
        f"two lower bounds do not bound a difference: with 1 / lambda_n = {one_over:.4g}, allowed by (28) for alphas (3, 2) "
        f"(below {sharp:.4g}), the difference at gamma = {low * ratio:.4g} and {low:g} is only {slope:.4g} (gamma1 - gamma2). "
        "(31), which is what is needed, holds: the eigenvalues are proportional to gamma"
    )
    return Statement(slope > one_over, slope, why)


@PAPER.claim("(31)", "universal", printed="lambda_min(P^-1/2 Q P^-1/2) increases with gamma")
def _():
    """P = D P~ D / gamma and Q = D Q~ D: lambda_min(P^-1 Q) = gamma lambda_min(P~^-1 Q~)."""
    gammas = np.geomspace(0.5, 5, 9)
    least = [
        [float(jnp.linalg.eigvalsh(chain_bounds.normalised_weight(jnp.asarray(a), _array(g)))[0]) / g for g in gammas]
        for a in SAMPLES
    ]
    spread = float(np.max(np.ptp(least, axis=1) / np.min(least, axis=1)))
    return Statement(
        spread < 1e-7, spread, "it is proportional to gamma: relative spread of lambda_min / gamma over a decade, n = 2..4"
    )


@PAPER.claim("(32)", "identity", printed="the plant is x' = (A + DeltaA(x, u)) x")
def _():
    plant, at = Pendulum(), _array(0.5)[None]
    rest = float(plant.phi(jnp.zeros(2), at))
    why = (
        f"if phi(0, u) = 0 for every u; the paper assumes it for u = 0. The pendulum has phi(0, 0.5) = {rest:g}, which (32) "
        "makes 0: the term B phi(0, u) is missing. The error equation, where it cancels, is of this form"
    )
    return Statement(rest == 0, rest, why)


@PAPER.claim("(33)-(36) Corollary 1", "universal", printed="int beta e'Q^-1 e + (C e)^2 <= e(0)'P^-1 e(0)")
def _():
    """With beta = c_1 gamma l~; the left side at t = infinity, of the pendulum, over directions of e(0)."""
    beta = float(chain_bounds.optimality_weight(ALPHAS, _array(GAMMA), _array(RHO)))
    worst = max(_cost(beta, GAMMA, angle) / _budget(angle) for angle in np.linspace(0, np.pi, 7)[:-1])
    _, certificate = riccati(Pendulum(), alphas=experiment.ALPHAS, gamma=GAMMA, lipschitz=RHO)
    why = (
        f"beta = {beta:.4g} at gamma = {GAMMA:g}, rho = {RHO:g}: V' + beta e'Q^-1 e + (C e)^2 <= 0 by (23) and (28), (5) being "
        f"certified; on the pendulum the left side is at most {worst:.3g} of the right one"
    )
    return Statement(certificate.verify().holds and beta > 0 and worst < 1, worst, why)


@PAPER.claim("Corollary 1: optimality", "universal", printed="observer (6) minimizes this quadratic cost")
def _():
    beta = float(chain_bounds.optimality_weight(ALPHAS, _array(GAMMA), _array(RHO)))
    own, other = _cost(beta, GAMMA, math.pi / 2), _cost(beta, 2 * GAMMA, math.pi / 2)
    why = (
        f"(33) bounds a cost, other gains may cost less: from e(0) = (0, 1) its left side is {own:.4g} for the observer at "
        f"gamma = {GAMMA:g}, and {other:.4g} with the gain of twice that gamma. For phi = 0 the observer is the Kalman filter "
        "of (Q, 1), optimal against white noise in that sense"
    )
    return Statement(own <= other, other / own, why)


def _cost(beta: float, gamma: float, angle: float) -> float:
    """int beta e'Q^-1 e + (C e)^2 along the pendulum's error from the unit e(0) at this angle; Q of (71), the gain that of
    gamma.
    """
    period = 1e-3
    guess = np.asarray(experiment.START) - np.asarray([math.cos(angle), math.sin(angle)])
    path = experiment.run(HighGain(Pendulum(), ALPHAS, _array(gamma)), end=4.0, period=period, guess=guess)
    e = np.asarray(path.x - path.xhat)
    q = np.diagonal(np.asarray(riccati_pair(ALPHAS, _array(GAMMA))[1]))
    return float(np.trapezoid(beta * np.sum(e**2 / q, axis=1) + e[:, 0] ** 2, dx=period))


def _budget(angle: float) -> float:
    e = np.asarray([math.cos(angle), math.sin(angle)])
    return float(e @ np.linalg.solve(np.asarray(riccati_pair(ALPHAS, _array(GAMMA))[0]), e))
