"""(50)-(65), theorem 2: observers of the Euler model."""

from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from jaxobs.certificates import StepCorners, exact
from jaxobs.designs import (
    NormBounded,
    euler_free_period,
    euler_riccati,
    euler_riccati_period,
    euler_tied_period,
)
from jaxobs.designs._chain_gain import chain_error
from jaxobs.designs.polytope import as_tuples
from jaxobs.papers.claims import Bound, Point, Statement, Value
from jaxobs.papers.p000 import experiment
from jaxobs.papers.p000.paper import PAPER
from jaxobs.papers.p000.weights import riccati_pair
from jaxobs.plants import Pendulum

SLOPE = NormBounded.lipschitz(2, experiment.RHO, (1,))  # M and N of section 4
LARGEST_63, TAU = 0.0915, 0.0347  # as printed: sampling period and tau of (63)
C4 = (4.0, 6.0, 4.0, 1.0)
# delta, epsilon and X of (62) as printed.
POINTS = {
    0.01: (0.5671, ((1.5533, -0.1662), (-0.1662, 0.8352))),
    0.525: (0.3415, ((1.1685, -0.3414), (-0.3414, 0.3119))),
}


def printed_gain(delta: float) -> np.ndarray:
    """X^-1 C' of the printed X."""
    return np.linalg.inv(np.asarray(POINTS[delta][1]))[:, 0]


def riccati_gain(delta: float) -> np.ndarray:
    """delta P(6) C' at alphas (3, 2)."""
    return delta * np.asarray(experiment.ALPHAS) * experiment.GAMMA ** np.arange(1.0, 3.0)


def euler_model(gain: np.ndarray, delta: float, x: np.ndarray, epsilon: float) -> StepCorners:
    """(62) for a gain, a period, X and epsilon, to be decided exactly."""
    fields = chain_error(gain, slope=SLOPE, dt=delta)
    return StepCorners(**fields, p=as_tuples((x + x.T) / 2), tau=epsilon, factor=1.0, origin=SLOPE.origin)


@PAPER.claim(
    "(50)-(51) (54)", "identity", printed="xhat_{k+1} = A_d xhat_k + delta B phi(x_k, u_k) + X^-1 C'(y_k - C xhat_k)", scan=True
)
def _():
    """(54) minus what (51) and (50) give, at one pair of states."""
    x, xhat, u = jnp.asarray([1.0, 0.0]), jnp.asarray([0.2, 0.3]), jnp.asarray([0.5])
    plant, delta = Pendulum(), 0.01
    in_54 = delta * float(plant.phi(xhat, u) - plant.phi(x, u))
    why = (
        "a hat is lost, by the author or in the scan: phi(xhat_k), as in (52) and (53), gives (54). With phi(x_k), which is "
        f"not measured, phi would cancel in the error, and (54) would miss {in_54:.4g} at one pair of states"
    )
    return Statement(abs(in_54) < 1e-12, in_54, why)


@PAPER.claim("(52)-(53)", "universal", printed="(53) is (51) if and only if X^-1 = delta P")
def _():
    p = np.asarray(riccati_pair(jnp.asarray(experiment.ALPHAS), jnp.asarray(experiment.GAMMA))[0])
    other = LARGEST_63 * p
    other[1, 1] *= 2
    gap = float(np.max(np.abs(other[:, 0] - riccati_gain(LARGEST_63))))
    why = (
        "if, yes; only if, no: the first columns decide. An X^-1 with twice the last entry of delta P is positive definite "
        f"(smallest eigenvalue {np.linalg.eigvalsh(other)[0]:.3g}) and gives the same gain (difference {gap:g})"
    )
    return Statement(gap > 1e-9, gap, why)


@PAPER.claim("(55)", "universal", printed="B phi_x = M F N with F'F < I")
def _():
    """F = (cos x1 - u sin x1) / rho on the pendulum, |u| <= 1/2: at most sqrt(1.25) / rho."""
    angle, u = np.meshgrid(np.linspace(-np.pi, np.pi, 721), np.linspace(-0.5, 0.5, 51))
    worst = float(np.max(np.abs(np.cos(angle) - u * np.sin(angle)))) / experiment.RHO
    product = SLOPE.left @ SLOPE.right
    fits = abs(product[1, 0] - experiment.RHO) < 1e-12
    why = f"on the pendulum |F| <= {worst:.4g} with rho = 3/2; in general rho above the Lipschitz constant"
    return Statement(bool(worst < 1 and fits), worst, why)


@PAPER.claim("(56)-(57)", "value", printed="1")
def _():
    """The sign of X^-1 C'C in the second bracket of (57), from V_{k+1} - V_k of a scalar chain with F = 0, X = 2, A_d = 1, C =
    1.
    """
    x, e = Fraction(2), Fraction(1)
    step = (1 - 1 / x) * e
    direct = step * x * step - e * x * e
    by_sign = {sign: e * (1 - 1 / x) * x * (1 + sign / x) * e - e * x * e for sign in (1, -1)}
    (right,) = [sign for sign, value in by_sign.items() if value == direct]
    why = (
        "the sign of X^-1 C'C in the second bracket of (57), which is the transpose of the first: for n = 1, X = 2, F = 0 the "
        f"difference of V is {float(direct):g}, {float(by_sign[1]):g} with + as printed. (58) has it right"
    )
    return Value(float(right), why)


@PAPER.claim("(58)", "universal", printed="the integral leaves the square, by lemma 2")
def _():
    """Lemma 2 on [0, 1]: |int v|_X^2 <= int |v|_X^2, here for v linear in lambda, exactly."""
    one, two = [Fraction(1), Fraction(-2)], [Fraction(3), Fraction(1, 2)]
    x = exact.matrix([[2.0, -0.5], [-0.5, 1.0]])

    def form(a, b):
        return sum(a[i] * x[i][j] * b[j] for i in range(2) for j in range(2))

    mean = form(one, one) + form(one, two) + form(two, two) / 4
    inside = form(one, one) + form(one, two) + form(two, two) / 3
    why = "for v = a + lambda b the gap is b'X b / 12, exactly; lemma 2 in general"
    return Statement(inside - mean == form(two, two) / 12 and inside > mean, float(inside - mean), why)


@PAPER.claim("(59) (61)-(62)", "identity", printed="(61) is equivalent to (62)")
def _():
    """The Schur complement of -eps I in (62), entry by entry, at the printed point for delta = 0.01."""
    delta = Fraction(1, 100)
    epsilon, rows = Fraction(5671, 10000), POINTS[0.01][1]
    x = [[Fraction(str(v)) for v in row] for row in rows]
    m, n = [[Fraction(0), Fraction(0)], [Fraction(0), Fraction(3, 2)]], [[Fraction(1), Fraction(0)], [Fraction(0), Fraction(0)]]
    xm = exact.scale(delta, exact.product(x, m))  # sqrt(rho) taken out of N
    a = exact.add(exact.identity(2), [[Fraction(0), delta], [Fraction(0), Fraction(0)]])
    cross = exact.subtract(exact.product(x, a), [[Fraction(1), Fraction(0)], [Fraction(0), Fraction(0)]])
    nn = exact.product(exact.transpose(n), n)
    top = exact.subtract(exact.scale(epsilon, nn), x)
    corner = exact.subtract(exact.scale(1 / epsilon, exact.product(xm, exact.transpose(xm))), x)
    small = exact.block([[top, exact.transpose(cross)], [cross, corner]])
    zero, minus = exact.zeros(2, 2), Fraction(-1)
    whole = exact.block(
        [
            [top, exact.transpose(cross), zero],
            [cross, exact.scale(minus, x), xm],
            [zero, exact.transpose(xm), exact.scale(-epsilon, exact.identity(2))],
        ]
    )
    t = exact.block([[exact.identity(4)], [exact.block([[zero, exact.scale(1 / epsilon, exact.transpose(xm))]])]])
    agree = exact.product(exact.transpose(t), exact.product(whole, t)) == small
    negative = [exact.is_positive_definite(exact.scale(minus, y)) for y in (small, whole)]
    why = f"exactly; both are negative definite there: {negative[0]}"
    return Statement(agree and negative[0] == negative[1], float(agree), why)


@PAPER.claim("(62) point, delta = 0.01", "feasible", printed="eps = 0.5671, X = [1.5533, -0.1662; -0.1662, 0.8352]")
def _():
    return _printed_point(0.01)


@PAPER.claim("(62) point, delta = 0.525", "feasible", printed="eps = 0.3415, X = [1.1685, -0.3414; -0.3414, 0.3119]")
def _():
    return _printed_point(0.525)


def _printed_point(delta: float) -> Point:
    epsilon, x = POINTS[delta]
    gain = printed_gain(delta)
    verdict = euler_model(gain, delta, np.asarray(x), epsilon).verify()
    why = f"L = X^-1 C' = ({gain[0]:.5g}, {gain[1]:.5g}); (62) is decided exactly for the printed decimals"
    return Point(verdict.holds, None, why)


@PAPER.claim("(62) largest delta", "bound", printed="0.525", long=True)
def _():
    tied, free = euler_tied_period(slope=SLOPE), euler_free_period(slope=SLOPE)
    why = (
        f"the LMI is feasible up to {tied.dt:.8g} (refuted by its duals from {tied.refuted:.8g}); with the gain free, Y = X L, "
        f"up to {free.dt:.8g}, 1 / sqrt(rho) = {1 / np.sqrt(experiment.RHO):.8g}"
    )
    return Bound(tied.dt, "lower", why)


@PAPER.claim("Theorem 2 (63)", "universal", printed="(63) implies asymptotic convergence, of the Euler model")
def _():
    _, certificate = euler_riccati(Pendulum(), alphas=experiment.ALPHAS, gamma=experiment.GAMMA, dt=LARGEST_63, slope=SLOPE)
    verdict = certificate.verify()
    why = (
        f"(63) is (62) with X = P^-1 / delta; at delta = {LARGEST_63:g} with tau = {certificate.tau:.5g}, exactly. It says "
        "nothing about the plant that the Euler model replaces"
    )
    return Statement(verdict.holds, certificate.tau, why)


@PAPER.claim("(63) point, delta = 0.0915", "feasible", printed="tau = 0.0347")
def _():
    p = np.asarray(riccati_pair(jnp.asarray(experiment.ALPHAS), jnp.asarray(experiment.GAMMA))[0])
    verdict = euler_model(riccati_gain(LARGEST_63), LARGEST_63, np.linalg.inv(p) / LARGEST_63, TAU).verify()
    return Point(verdict.holds, None, "decided exactly, for P of (68) at gamma = 6; tau is not unique")


@PAPER.claim("(63) (65) largest delta", "bound", printed="0.0915")
def _():
    period = euler_riccati_period(alphas=experiment.ALPHAS, gamma=experiment.GAMMA, slope=SLOPE)
    why = (
        f"feasible up to {period.dt:.8g} at gamma = 6 (refuted by the duals from {period.refuted:.8g}), tau = "
        f"{period.epsilon:.4g}"
    )
    return Bound(period.dt, "lower", why)


@PAPER.claim("(64)", "value", printed="2")
def _():
    """The columns of the gain."""
    p = np.asarray(riccati_pair(jnp.asarray(experiment.ALPHAS), jnp.asarray(experiment.GAMMA))[0])
    why = (
        f"columns of the gain: delta P(gamma) has {p.shape[1]}, but the innovation is a scalar. Meant is delta P C', and "
        "phi(xhat_k, u_k), both as in (53)"
    )
    return Value(float((p @ np.eye(2, 1)).shape[1]), why)


@PAPER.claim("(65) entry (2,1)", "identity", printed="(A + alpha I) P^-1 - C'C")
def _():
    """Against the transpose of the entry (1,2), at gamma = 6, alpha = 1 / 0.0915."""
    p = np.asarray(riccati_pair(jnp.asarray(experiment.ALPHAS), jnp.asarray(experiment.GAMMA))[0])
    inverse, a, alpha = np.linalg.inv(p), np.eye(2, k=1), 1 / LARGEST_63
    gap = float(np.max(np.abs((a + alpha * np.eye(2)) @ inverse - inverse @ (a + alpha * np.eye(2)))))
    why = (
        "a slip of order, (63) has it right: P^-1 (A + alpha I) - C'C is the transpose of the entry (1,2); the order printed "
        f"in (65) differs by {gap:.4g}, and the matrix is not symmetric"
    )
    return Statement(gap < 1e-12, gap, why)


@PAPER.claim("(65) linear", "universal", printed="the largest delta is a linear optimization problem")
def _():
    """(65) is affine in (alpha, tau) together: checked at the midpoint of two points, exactly."""
    p = exact.chain_riccati([Fraction(int(a)) for a in experiment.ALPHAS])

    def matrix(alpha, tau):
        determinant = p[0][0] * p[1][1] - p[0][1] ** 2
        inverse = exact.scale(1 / determinant, [[p[1][1], -p[0][1]], [-p[0][1], p[0][0]]])
        step = [[alpha, Fraction(1)], [Fraction(0), alpha]]
        cc, nn = [[Fraction(1), Fraction(0)], [Fraction(0)] * 2], [[tau, Fraction(0)], [Fraction(0)] * 2]
        cross = exact.subtract(exact.product(inverse, step), cc)
        top = exact.subtract(nn, exact.scale(alpha, inverse))
        return exact.block([[top, exact.transpose(cross)], [cross, exact.scale(-alpha, inverse)]])

    one, two = (Fraction(11), Fraction(1, 30)), (Fraction(20), Fraction(1, 5))
    middle = [(s + t) / 2 for s, t in zip(one, two, strict=True)]
    affine = exact.scale(Fraction(1, 2), exact.add(matrix(*one), matrix(*two))) == matrix(*middle)
    return Statement(affine, float(affine), "jointly affine in alpha and tau, exactly: one semidefinite program, no bisection")


@PAPER.claim("(65) any smaller delta", "universal", printed="for any delta <= 0.0915 the observer converges")
def _():
    """d(65)/d alpha = [-P^-1, P^-1, 0; P^-1, -P^-1, 0; 0, 0, 0] <= 0: a larger alpha keeps the inequality, with the same
    tau.
    """
    p = np.asarray(riccati_pair(jnp.asarray(experiment.ALPHAS), jnp.asarray(experiment.GAMMA))[0])
    periods = (LARGEST_63, 0.05, 0.01, 1e-3, 1e-4)
    held = [euler_model(riccati_gain(d), d, np.linalg.inv(p) / d, TAU).verify().holds for d in periods]
    inverse = np.linalg.inv(p)
    largest = float(np.linalg.eigvalsh(np.kron([[-1.0, 1.0], [1.0, -1.0]], inverse))[-1])
    why = (
        "the derivative of (65) with respect to alpha = 1 / delta is negative semidefinite (largest eigenvalue "
        f"{largest:.1g}), so the same tau does; exactly at delta = {', '.join(f'{d:g}' for d in periods)}. For (62) take X "
        "times 0.525 / delta"
    )
    return Statement(all(held) and largest < 1e-12, f"{sum(held)} of {len(held)}", why)


@PAPER.claim("(65) q = 2", "universal", printed="the digital implementation of (40) is identical")
def _():
    period = euler_riccati_period(alphas=C4, gamma=experiment.GAMMA, slope=SLOPE, q=2)
    _, certificate = euler_riccati(Pendulum(), alphas=C4, gamma=experiment.GAMMA, dt=0.9 * period.dt, slope=SLOPE, q=2)
    why = (
        f"with A~, Z, M and N augmented: largest delta {period.dt:.6g} for C(4, k) at gamma = 6; certified exactly at 0.9 of "
        "it. (44) does not hold at this gamma: the LMI knows that only x_1 enters phi"
    )
    return Statement(certificate.verify().holds, period.dt, why)
