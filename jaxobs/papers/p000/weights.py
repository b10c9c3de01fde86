"""(8)-(21), Lemmas 3 and 4: the weights q_i, the Riccati equation and its solution P(gamma)."""

import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import chain_bounds, hurwitz, linalg
from jaxobs.certificates import exact
from jaxobs.papers.claims import Statement
from jaxobs.papers.p000.paper import PAPER

SAMPLES = ([3.0, 2.0], [2.0, 1.0], [3.0, 3.0, 1.0], [4.0, 6.0, 4.0, 1.0], [4.5, 7.0, 4.5, 1.0])


riccati_pair = jax.jit(chain_bounds.riccati_pair)


def printed_weights(alphas: list[float]) -> list[float]:
    """(8) as printed, at gamma = 1: q_i = alpha_i^2 + 2 sum_{k=i}^{n-1} (-1)^{k+i-1} alpha_{k+1} alpha_{k-1}, 2 <= i <= n -
    1.
    """
    a, n = [1.0, *alphas], len(alphas)
    inner = [_printed_sum(a, i) for i in range(2, n)]
    return [a[1] ** 2 - 2 * a[2] * a[0], *inner, a[n] ** 2]


def _printed_sum(a: list[float], i: int) -> float:
    return a[i] ** 2 + 2 * sum((-1) ** (k + i - 1) * a[k + 1] * a[k - 1] for k in range(i, len(a) - 1))


def _listed(numbers) -> str:
    return ", ".join(f"{float(x):.6g}" for x in numbers)


def _pair(alphas: list[float], gamma: float) -> tuple[np.ndarray, np.ndarray]:
    p, q = riccati_pair(jnp.asarray(alphas), jnp.asarray(gamma))
    return np.asarray(p), np.asarray(q)


def _chain(n: int) -> tuple[np.ndarray, np.ndarray]:
    return np.eye(n, k=1), np.eye(1, n)


def _residual(a: np.ndarray, p: np.ndarray, c: np.ndarray, q: np.ndarray) -> float:
    """|a P + P a' - P C'C P + Q| relative to |Q|, in the largest entry."""
    return float(np.max(np.abs(a @ p + p @ a.T - p @ c.T @ c @ p + q)) / np.max(np.abs(q)))


@PAPER.claim("(8) q_i", "identity", printed="q_i = alpha_i^2 + 2 sum_{k=i}^{n-1} (-1)^{k+i-1} alpha_{k+1} alpha_{k-1}")
def _():
    alphas = [4.0, 6.0, 4.0, 1.0]
    right = [float(q) for q in exact.chain_weights([Fraction(a) for a in alphas])]
    up_to_3 = all(
        printed_weights(s) == [float(q) for q in exact.chain_weights([Fraction(a) for a in s])] for s in SAMPLES if len(s) < 4
    )
    why = (
        f"for C(4, k): {_listed(printed_weights(alphas))} as printed, {_listed(right)} by (17), which is right; the second "
        f"index should fall as the first rises, alpha_{{2i-k-1}}. Up to n = 3 both agree: {up_to_3}"
    )
    return Statement(printed_weights(alphas) == right, _listed(right), why)


@PAPER.claim("(10)", "universal", printed="(10) makes all q_i positive")
def _():
    alphas = [1.0, 0.7, 0.24]
    a = [1.0, *alphas]
    printed = [_printed_sum(a, i) for i in range(1, 4)]
    right = exact.chain_weights([Fraction(x) for x in alphas])
    fails = hurwitz.is_hurwitz(alphas) and min(printed) > 0 and min(right) < 0
    why = (
        f"the same index as in (8), at i = 1 from n = 3 on: for the Hurwitz alphas {_listed(alphas)} the sums of (10) are "
        f"{_listed(printed)}, but q = {_listed(right)}. With the q_i of (17) all is well"
    )
    return Statement(not fails, float(min(right)), why)


@PAPER.claim("(10) pole placement", "universal", printed="poles can be placed arbitrarily in the left half plane")
def _():
    alphas = [1.0, 1.0]
    q1 = exact.chain_weights([Fraction(a) for a in alphas])[0]
    why = (
        "within (10), which theorem 1 asks for and which is more than Hurwitz: for n = 2 it means |Im| < |Re|, and s^2 + s + 1 "
        f"has q_1 = {float(q1):g}. It restricts this certificate only: the observer itself works with any Hurwitz polynomial "
        "if gamma is large enough"
    )
    return Statement(bool(q1 > 0), float(q1), why)


@PAPER.claim("Riccati solvable", "universal", printed="the solution of the algebraic Riccati equation always exists")
def _():
    rng = np.random.default_rng(0)
    good = 0
    for _ in range(40):
        poles = -rng.uniform(0.2, 5, int(rng.integers(1, 4))) * np.exp(1j * rng.uniform(0, 0.78))
        alphas = [Fraction(float(a)) for a in np.poly(np.concatenate([poles, poles.conj()])).real[1:]]
        weights, p = exact.chain_weights(alphas), exact.chain_riccati(alphas)
        good += min(weights) > 0 and exact.is_positive_definite(p) and exact.riccati_residual_is_zero(p, weights)
    why = (
        f"in closed form, rational in alpha; for {good} of 40 random alphas with (10), n = 2, 4, 6, exactly. (A, C) is "
        "observable"
    )
    return Statement(good == 40, f"{good} of 40", why)


@PAPER.claim("(11)-(13)", "identity", printed="P1 - P2 solves (13)")
def _():
    worst = 0.0
    for alphas in SAMPLES:
        (p1, q1), (p2, q2) = _pair(alphas, 2.0), _pair(alphas, 1.0)
        a, c = _chain(len(alphas))
        x, closed = p1 - p2, a - p2 @ c.T @ c
        worst = max(worst, _residual(closed, x, c, q1 - q2))
    return Statement(worst < 1e-13, worst, "the largest residual, relative, of (13) at gamma = 2 and 1, n = 2..4")


@PAPER.claim("(14)", "identity", printed="Xi X + X Xi' - X C'C'X + Q = 0", scan=True)
def _():
    (p1, q1), (p2, q2) = _pair([3.0, 2.0], 2.0), _pair([3.0, 2.0], 1.0)
    a, c = _chain(2)
    residual = _residual(a - p2 @ c.T @ c, p1 - p2, c, q1 - q2)
    shapes_fit = c.T.shape[1] == c.T.shape[0]
    return Statement(shapes_fit, residual, f"C'C' has no product; with C'C the relative residual is {residual:.2g}")


@PAPER.claim("Lemma 3", "universal", printed="gamma1 > gamma2 implies P1 > P2", long=True)
def _():
    """P1 - P2 is the stabilising solution of (14): Xi - X C'C = A - P1 C'C is Hurwitz, and Q1 - Q2 > 0 is diagonal."""
    proved = 0
    for alphas in SAMPLES:
        p = exact.chain_riccati([Fraction(a) for a in alphas])
        for ratio in (Fraction(1001, 1000), Fraction(2), Fraction(100)):
            larger = [[ratio ** (i + j + 1) * x for j, x in enumerate(row)] for i, row in enumerate(p)]
            proved += exact.is_positive_definite(exact.subtract(larger, p))
    total = 3 * len(SAMPLES)
    least = min(float(chain_bounds.growth(jnp.asarray(alphas), jnp.asarray(2.0))) for alphas in SAMPLES)
    why = (
        f"P1 - P2 is positive definite, exactly, in {proved} of {total} cases; at gamma1 = 2 gamma2 P1 >= {least:.4g} P2 or "
        "better. The proof also uses that Q1 - Q2 > 0 (true by (10)) and that P1 - P2 is the stabilising solution (A - P1 C'C "
        "is Hurwitz)"
    )
    return Statement(proved == total and least > 1, least, why)


@PAPER.claim("(6) (15) Lemma 4", "identity", printed="P C' = (alpha_i gamma^i)")
def _():
    holds = True
    for alphas in SAMPLES:
        exactly = [Fraction(a) for a in alphas]
        p = exact.chain_riccati(exactly)
        holds &= [row[0] for row in p] == exactly and exact.riccati_residual_is_zero(p, exact.chain_weights(exactly))
    return Statement(
        holds,
        f"{len(SAMPLES)} sets of alphas",
        "the closed form solves the Riccati equation and has this first column, exactly, n = 2..4",
    )


@PAPER.claim("(16) last index", "identity", printed="p_{n^2+n/2}", scan=True)
def _():
    n = 4
    entries = len([1 for i in range(n) for j in range(i + 1)])
    why = f"a symmetric matrix has n(n+1)/2 entries, {entries} for n = 4, not n^2 + n/2 = {n**2 + n // 2}: a bracket is lost"
    return Statement(entries == n**2 + n // 2, float(entries), why)


@PAPER.claim("(17)", "identity", printed="q_i = alpha_i^2 - 2 alpha_{i+1} alpha_{i-1} + 2 alpha_{i+2} alpha_{i-2} - ...")
def _():
    """Against alpha(s) alpha(-s) = (-1)^n [s^2n + sum_i (-1)^i q_i s^{2n-2i}]."""
    worst = 0.0
    for alphas in SAMPLES:
        a, n = np.asarray([1.0, *alphas]), len(alphas)
        product = (-1) ** n * np.polymul(a, a * (-1.0) ** (n - np.arange(n + 1)))
        weights = np.asarray(hurwitz.q_from_alphas(alphas))
        worst = max(worst, float(np.max(np.abs((-1.0) ** np.arange(1, n + 1) * product[2::2] - weights))))
    return Statement(worst < 1e-12, worst, "largest difference from the coefficients of alpha(s) alpha(-s), n = 2..4")


@PAPER.claim("(18)", "identity", printed="p_i = alpha_i gamma^i")
def _():
    gamma, worst = 6.0, 0.0
    for alphas in SAMPLES:
        expected = np.asarray(alphas) * gamma ** np.arange(1, len(alphas) + 1)
        worst = max(worst, float(np.max(np.abs(_pair(alphas, gamma)[0][0] / expected - 1))))
    return Statement(worst < 1e-14, worst, "largest relative difference, gamma = 6")


@PAPER.claim("(19) (21)", "identity", printed="the Lyapunov equation A P + P A' = G'G - Q gives the rest of P")
def _():
    worst, free = 0.0, []
    for alphas in SAMPLES:
        p, q = _pair(alphas, 1.0)
        n = len(alphas)
        a, _ = _chain(n)
        worst = max(worst, float(np.max(np.abs(a @ p + p @ a.T - np.outer(alphas, alphas) + q))))
        operator = np.kron(a, np.eye(n)) + np.kron(np.eye(n), a)
        free.append(n * n - int(np.linalg.matrix_rank(operator)))
    why = (
        f"the equation holds (largest residual {worst:.2g}), but A is nilpotent: alone it leaves {free[0]} of 4 entries free "
        "for n = 2 and has no unique solution; together with (18) it determines P"
    )
    return Statement(worst < 1e-12, worst, why)


@PAPER.claim("(20)", "identity", printed="P_ij = P~_ij gamma^{i+j-1}", long=True)
def _():
    worst = 0.0
    for alphas in SAMPLES:
        n = len(alphas)
        for gamma in (0.5, 6.0):
            d = gamma ** np.arange(1.0, n + 1)
            p = np.asarray(linalg.chain_riccati(jnp.asarray(alphas))) * np.outer(d, d) / gamma
            a, c = _chain(n)
            q = np.diag(np.asarray(hurwitz.q_from_alphas(alphas)) * d**2)
            scale = np.outer(d, d)
            worst = max(worst, float(np.max(np.abs(a @ p + p @ a.T - p @ c.T @ c @ p + q) / scale)))
    return Statement(worst < 1e-12, worst, "largest residual of the Riccati equation, entries scaled, gamma = 0.5 and 6")


@PAPER.claim("Gauthier 1992", "identity", printed="alpha_k = C(n, k) is the observer of Gauthier et al.", long=True)
def _():
    """S(theta) with theta S + A'S + S A = C'C is a metric; its gain S^-1 C' is compared."""
    theta, worst = 3.0, 0.0
    for n in range(1, 7):
        s = np.asarray(chain_bounds.gauthier_metric(n, jnp.asarray(theta)))
        a, c = _chain(n)
        lyapunov = np.max(np.abs(theta * s + a.T @ s + s @ a - c.T @ c))
        gain = np.linalg.solve(s, c[0])
        expected = [math.comb(n, k) * theta**k for k in range(1, n + 1)]
        worst = max(worst, float(np.max(np.abs(gain / expected - 1))), float(lyapunov))
    why = "largest relative difference of the gains, n = 1..6; the metrics P^-1 and S differ"
    return Statement(worst < 1e-9, worst, why)
