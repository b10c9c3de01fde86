"""Section II: the lemmas, the chain, the standard high-gain observer, (1)-(16)."""

import itertools
from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from jaxobs.designs import chain_lmi, chain_proofs
from jaxobs.designs.high_gain_lmi import high_gain_lmi, standard_high_gain
from jaxobs.designs.slopes import auxiliary, slopes
from jaxobs.observers import Luenberger
from jaxobs.papers.claims import Bound, Statement, Value
from jaxobs.papers.p002 import shared
from jaxobs.papers.p002.paper import PAPER, N


def kinked(x):
    """R^3 -> R^3 from |.|, saturation and dead zone: Lipschitz in each coordinate, differentiable in none."""
    half, saturated = Fraction(1, 2), [min(max(one, -1), 1) for one in x]
    parts = [abs(x[0]) - 2 * abs(x[1] - x[2]), saturated[0] + half * saturated[1], (x[2] - saturated[2]) - abs(x[0])]
    return np.array(parts, dtype=object)


KINKED = np.array([  # the slopes of `kinked` in each coordinate
    [[-1, 1], [-2, 2], [-2, 2]],
    [[0, 1], [0, 0.5], [0, 0]],
    [[-1, 1], [0, 0], [0, 1]],
])  # fmt: skip


def rational_points(count: int, n: int, seed: int = 2):
    """Pairs of points on a grid of eighths: some coordinates agree, some sit on the kinks."""
    draws = np.random.default_rng(seed).integers(-20, 21, (count, 2, n))
    for pair in draws:
        yield tuple(np.array([Fraction(int(one), 8) for one in point], dtype=object) for point in pair)


@PAPER.claim("(1) auxiliary vectors", "identity", printed="X^{Z_0} = X, X^{Z_n} = Z")
def _():
    x, z = np.arange(1.0, 6.0), -np.arange(1.0, 6.0)
    path = [auxiliary(x, z, i) for i in range(N + 1)]
    steps = [int(np.sum(a != b)) for a, b in itertools.pairwise(path)]
    holds = bool(np.all(path[0] == x) and np.all(path[-1] == z) and steps == [1] * N)
    return Statement(holds, float(max(steps)), "each step from X to Z moves one coordinate")


@PAPER.claim("(2) lemma 1", "identity", printed="Psi(X) - Psi(Z) = sum psi_j (x_j - z_j)")
def _():
    gap = Fraction(0)
    for x, z in rational_points(200, 3):
        psi = slopes(lambda v: kinked(v)[0], x, z)
        gap = max(gap, abs(kinked(x)[0] - kinked(z)[0] - sum(p * d for p, d in zip(psi, x - z, strict=True))))
    return Statement(
        gap == 0, float(gap), "200 pairs of rational points on a function with kinks, in exact arithmetic: the sum telescopes"
    )


@PAPER.claim("(3)-(5) lemma 2, forward", "universal", printed="Lipschitz => (4) with psi_ij in [-gamma, gamma]")
def _():
    largest, gap = 0.0, Fraction(0)
    for x, z in rational_points(200, 3, seed=3):
        psi = slopes(kinked, x, z, KINKED)
        largest = max(largest, float(max(abs(p) for p in psi.ravel())))
        gap = max(gap, *(abs(one) for one in kinked(x) - kinked(z) - psi @ (x - z)))
    why = (
        "two neighbours X^{Z_{j-1}}, X^{Z_j} differ in x_j alone, so each slope is at most the Lipschitz constant; 200 "
        "rational pairs of |.|, saturation and dead zone, in exact arithmetic"
    )
    return Statement(bool(gap == 0 and largest <= 2.0), largest, why)


@PAPER.claim("lemma 2, converse", "universal", printed="(4)-(5) => Lipschitz with the same gamma")
def _():
    psi = slopes(lambda v: np.full(N, v.sum()), np.ones(N), np.zeros(N), np.tile([-1.0, 1.0], (N, N, 1)))
    ratio = float(np.linalg.norm(psi @ np.ones(N)) / np.linalg.norm(np.ones(N)))
    why = (
        f"Psi(X) = (x_1 + ... + x_n) (1, ..., 1)' has all psi_ij = 1 = gamma and the Lipschitz constant n = {ratio:.6g}; the "
        "items are equivalent for some gamma each, and (4)-(5) give n gamma in the Euclidean norm"
    )
    return Statement(bool(ratio <= 1), ratio, why)


@PAPER.claim("lemma 2, components of Psi", "value", printed="1")
def _():
    x, z = np.ones(N), np.zeros(N)
    psi = slopes(lambda v: v**2, x, z)
    total = sum(psi[i, j] * np.outer(np.eye(N)[i], np.eye(N)[j]) @ (x - z) for i in range(N) for j in range(N))
    return Value(
        float(np.size(total)), f"the right side of (4) is a vector of n components (n = {N} here): Psi maps R^n to R^n"
    )


@PAPER.claim("(7) gamma_f", "bound", printed="1")
def _():
    size = float(np.abs(shared.bounds(1)).max())
    return Bound(size, "upper", f"k_f = 1: each slope is at most k_f/5, so gamma_f = {size:.6g} already does in (7)")


@PAPER.claim("(10) error dynamics", "identity", printed="e' = (A - LC) e + B (f(x) - f(xhat))")
def _():
    x, xhat, dx, dxhat, gain = _moment()
    a, b = np.eye(N, k=1), np.eye(N)[-1]
    right = (a - np.outer(gain, np.eye(N)[0])) @ (x - xhat) + b * (_phi(x) - _phi(xhat))
    gap = float(np.abs(dx - dxhat - right).max())
    return Statement(bool(gap < 1e-9), gap)


@PAPER.claim("(13) scaled error dynamics", "identity", printed="ehat' = theta (A - KC) ehat + theta^-n B Delta f")
def _():
    x, xhat, dx, dxhat, gain = _moment()
    t = THETA ** np.arange(1, N + 1)
    k, e = gain / t, (x - xhat) / t
    change = _phi(x) - _phi(x - t * e)
    right = THETA * (np.eye(N, k=1) - np.outer(k, np.eye(N)[0])) @ e + np.eye(N)[-1] * change / THETA**N
    gap = float(np.abs((dx - dxhat) / t - right).max())
    return Statement(bool(gap < 1e-9), gap, f"at theta = {THETA}")


THETA = 3.0


def _phi(x: np.ndarray) -> float:
    return float(shared.plant().phi(jnp.asarray(x), jnp.zeros((0,))))


def _moment():
    """(x, xhat, x', xhat', L) at one moment of the example and its observer (9)."""
    rng = np.random.default_rng(0)
    x, xhat = rng.normal(size=(2, N))
    plant = shared.plant()
    gain = np.array(shared.row(1, 1).gain) * THETA ** np.arange(1, N + 1)
    observer = Luenberger(plant, jnp.asarray(gain[:, None]))
    u, t = jnp.zeros((0,)), jnp.asarray(0.0)
    dx = np.asarray(plant.flow(t, jnp.asarray(x), u))
    dxhat = np.asarray(observer.flow(t, jnp.asarray(xhat), u, jnp.asarray(x[:1])))
    return x, xhat, dx, dxhat, gain


@PAPER.claim("(14) k_f", "bound", printed="1")
def _():
    sharp = chain_lmi.gain_constant(shared.bounds(1), 0)
    return Bound(
        sharp, "upper", f"k_f = 1: valid for every theta >= 1 and loose; by Cauchy and Schwarz k_f sqrt(5)/5 = {sharp:.6g}"
    )


@PAPER.claim("(15)-(16) theorem 2.1", "universal", printed="the error is asymptotically stable")
def _():
    _, proof = standard_high_gain(shared.plant(), bounds=shared.bounds(1), constant=1.0)
    verdict = proof.verify()
    why = (
        "V = ehat'P ehat decreases by (15) and (14); certified in exact arithmetic for the example at theta = "
        f"{proof.theta:.6g} (V at the rate {2 * verdict.margins['decay_rate']:.3g} /s)"
    )
    return Statement(verdict.holds, verdict.margins["decay_rate"], why)


@PAPER.claim("(15)-(16) best gain", "universal", printed="one K for each theta (table I)")
def _():
    sizes, edge = [], shared.smallest(shared.row(0, 1))
    for excess in (1.1, 1.01, 1.001):
        observer, proof = high_gain_lmi(shared.plant(), bounds=shared.bounds(1), theta=excess * edge.theta, constant=1.0)
        sizes.append(float(np.linalg.norm(np.asarray(observer.gain)[:, 0] / proof.theta ** np.arange(1, N + 1))))
    why = (
        f"how K is chosen is not said; if theta is minimised, the infimum of theta, {edge.theta:.6g} with the printed k_f, is "
        f"not attained; 10 %, 1 % and 0.1 % above it |K| = {sizes[0]:.3g}, {sizes[1]:.3g}, {sizes[2]:.3g}, so a printed "
        "K reflects the solver's tolerance"
    )
    return Statement(None, sizes[-1], why)


@PAPER.claim("n_LMI of LPV/LMI", "value", printed="32")
def _():
    return Value(float(len(chain_lmi.corners(shared.bounds(1), N, 1.0))), "2^n with n = 5")


@PAPER.claim("LPV/LMI is the best LMI technique", "universal", printed="the best LMI technique")
def _():
    proof = shared.design(2)
    same = chain_proofs.certify(shared.bounds(1), N, proof.theta, proof.gain)
    rate = same.verify().margins["decay_rate"] if same else float("nan")
    why = (
        "among the methods of this paper its feasible set is never the smaller one: a solution of (31)-(32) proves V' < 0 on "
        f"the full box (checked for j0 = 2: a certificate at all 32 corners, rate {rate:.3g} /s); among all LMI "
        "techniques: open"
    )
    return Statement(None, rate, why)
