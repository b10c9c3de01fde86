"""Section III: the motivating example, theorems 3.2 and 3.3, the algorithm, (17)-(37)."""

import dataclasses
import functools
import itertools

import numpy as np

from jaxobs.certificates import HighGainLmi
from jaxobs.designs import chain_lmi
from jaxobs.designs.gridding import gridding
from jaxobs.designs.high_gain_lmi import high_gain_lmi, standard_high_gain
from jaxobs.papers.claims import Statement, Value
from jaxobs.papers.p002 import shared
from jaxobs.papers.p002.paper import PAPER, TABLE, N
from jaxobs.plants import Pendulum

SIN_X3 = np.array([[0.0, 0.0], [0.0, 0.0], [-1.0, 1.0]])
SIN_X2 = np.array([[0.0, 0.0], [-1.0, 1.0], [0.0, 0.0]])
THETA = 7.0  # any


@PAPER.claim("sin(x3): k_f / gamma_f", "value", printed="1")
def _():
    return Value(chain_lmi.gain_constant(SIN_X3, 0, THETA), f"the same for every theta, here {THETA}")


@PAPER.claim("sin(x2): theta k / gamma_f", "value", printed="1")
def _():
    return Value(
        THETA * chain_lmi.gain_constant(SIN_X2, 0, THETA), f"theta^-3 |Delta f| <= (gamma_f/theta) |ehat|, here theta = {THETA}"
    )


@PAPER.claim("sin(x2): theta_0 becomes sqrt(theta_0)", "identity", printed="sqrt(theta_0)")
def _():
    gain = (3.0, 3.0, 1.0)
    plain = chain_lmi.smallest_theta(SIN_X3, 0, gain=gain, constant=4.0).theta
    helped = chain_lmi.smallest_theta(SIN_X2, 1, gain=gain, constant=4.0).theta
    why = f"k_f = 4, K = {gain}: theta_0 = {plain:.6g} for sin(x3), {helped:.6g} for sin(x2)"
    return Statement(bool(abs(helped / np.sqrt(plain) - 1) < 1e-5), helped / np.sqrt(plain), why)


@PAPER.claim("(18) k_j0 <= k_f", "universal", printed="k_j0 <= k_f, independent of theta")
def _():
    sizes = [chain_lmi.gain_constant(shared.bounds(1), j0) for j0 in range(N + 1)]
    return Statement(all(a > b for a, b in itertools.pairwise(sizes)), sizes[1], "k_0, ..., k_5 decrease: a sum of fewer terms")


@PAPER.claim("(19)-(20) theorem 3.2", "universal", printed="the error is asymptotically stable")
def _():
    _, proof = standard_high_gain(Pendulum(), bounds=[[-1.5, 1.5], [0.0, 0.0]])
    verdict = proof.verify()
    why = (
        f"certified in exact arithmetic for a chain of two states whose f depends on x_1 only (j0 = 1): theta = "
        f"{proof.theta:.6g}"
    )
    return Statement(bool(verdict.holds and proof.j0 == 1), verdict.margins["decay_rate"], why)


@PAPER.claim("(20) theta_0 -> theta_j0^{1/(1+j0)}", "universal", printed="a very significant attenuation")
def _():
    plain = shared.needed(shared.row(0, 1)).theta
    rooted = [(plain * (N - j0) / N) ** (1 / (1 + j0)) for j0 in range(N)]
    why = f"k_f = 1, the printed standard K: {', '.join(f'{one:.4g}' for one in rooted)} for j0 = 0..4; it needs theta_0 > 1"
    return Statement(all(a > b for a, b in itertools.pairwise(rooted)), rooted[1], why)


@PAPER.claim("(21) split of Delta f", "identity", printed="Delta f = Delta f_1 + LPV/LMI part")
def _():
    gap = 0.0
    for j0 in range(N + 1):
        psi, e = _draw(j0)
        parts = THETA ** np.arange(1, N + 1) * psi * e
        k = [N - (j0 - j) for j in range(1, j0 + 1)]
        gap = max(gap, abs(parts.sum() - parts[: N - j0].sum() - sum(parts[one - 1] for one in k)) / THETA**N)
    return Statement(bool(gap < 1e-12), gap, "for every j0 = 0..5")


@PAPER.claim("(22)-(25) error dynamics", "identity", printed="ehat' = theta (A(Psi) - KC) ehat + theta^-n B Delta f_1")
def _():
    gap, gain = 0.0, np.array(TABLE[3].gain)
    for j0 in range(N + 1):
        psi, e = _draw(j0)
        t = THETA ** np.arange(1, N + 1)
        whole = THETA * chain_lmi.error_matrices(np.zeros((1, N)), gain)[0] @ e + np.eye(N)[-1] * ((psi * t) @ e) / THETA**N
        row = chain_lmi.corners(np.stack([psi, psi], axis=1), j0, THETA)
        rest = np.where(np.arange(N) < N - j0, psi, 0.0)
        split = THETA * chain_lmi.error_matrices(row, gain)[0] @ e + np.eye(N)[-1] * ((rest * t) @ e) / THETA**N
        gap = max(gap, float(np.abs(whole - split).max()))
    return Statement(bool(gap < 1e-9), gap, "psi_j^theta = psi_k(j) / theta^{1+j0-j}, for every j0 = 0..5")


def _draw(seed: int):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, N), rng.normal(size=N)


@PAPER.claim("(26)-(27) index of the bounds", "identity", printed="gamma_{gamma_k(j)}", scan=True)
def _():
    return Statement(False, "gamma_{psi_k(j)}", "the bounds are those of psi_k(j), as in (5): the inner letter is psi")


@PAPER.claim("(28) nested boxes", "universal", printed="sigma_1 < sigma_2 => H^{sigma_1} contains H^{sigma_2}")
def _():
    sizes = [chain_lmi.corners(shared.bounds(1), N, sigma).max(axis=0) for sigma in (0.5, 1.0, 2.0, 8.0)]
    holds = all(bool(np.all(a > b)) for a, b in itertools.pairwise(sizes))
    return Statement(
        holds,
        float(sizes[-1].max()),
        "each side is divided by a power of sigma; it needs bounds that contain 0, as (5) has them",
    )


@PAPER.claim("(29) limit of the boxes", "identity", printed="{0}")
def _():
    far = float(np.abs(chain_lmi.corners(shared.bounds(1), N, 1e12)).max())
    return Statement(bool(far < 1e-11), far, "the largest side at sigma = 1e12")


@PAPER.claim("(30) k_j0 <= k_f", "universal", printed="a positive number <= k_f")
def _():
    sharp = [chain_lmi.gain_constant(shared.bounds(1), j0) for j0 in range(N + 1)]
    why = (
        f"sharp for all theta >= 1, k_f = 1, j0 = 0..5: {', '.join(f'{one:.4g}' for one in sharp)}; at j0 = n it is 0, not "
        "positive"
    )
    return Statement(all(one <= 1 for one in sharp), sharp[0], why)


@PAPER.claim("(31)-(32) theorem 3.3", "universal", printed="the error is asymptotically stable", long=True)
def _():
    proofs = [shared.design(j0) for j0 in range(N + 1)]
    why = (
        "V = ehat'P ehat decreases at all corners, hence in the box; certified in exact arithmetic for the example with k_f = "
        f"1 at j0 = 0..5, theta = {', '.join(f'{p.theta:.4g}' for p in proofs)}"
    )
    return Statement(all(p.verify() for p in proofs), proofs[1].theta, why)


@PAPER.claim("(33) from (31)", "universal", printed="(31) at sigma implies (33) for theta >= sigma")
def _():
    _, proof = high_gain_lmi(shared.plant(), bounds=shared.bounds(1), j0=2, theta=3.0, sigma=2.5)
    later = [dataclasses.replace(proof, gain=_moved(proof, theta), theta=theta) for theta in (3.5, 4.0, 8.0, 64.0)]
    why = "the P and K found at sigma = 2.5 verify at theta = 3, 3.5, 4, 8, 64 in exact arithmetic"
    return Statement(all(p.verify().holds for p in [proof, *later]), float(len(later)), why)


def _moved(proof: HighGainLmi, theta: float) -> tuple[float, ...]:
    """T(theta) K for the K of a certificate."""
    return tuple(float(x) for x in np.array(proof.gain) * (theta / proof.theta) ** np.arange(1, N + 1))


@PAPER.claim("(34), (36) theta", "universal", printed="theta >= max(sigma, theta_j0^{1/(1+j0)})")
def _():
    proof = shared.design(2)
    least = (2 * proof.constant * proof.nu / proof.lam) ** (1 / 3)
    why = (
        f"at the design with j0 = 2 the right side is {max(proof.sigma, least):.6g}, theta = {proof.theta:.6g}; (34) is strict "
        "and (36) is not: equality is allowed, since (31) is strict"
    )
    return Statement(bool(proof.theta >= max(proof.sigma, least)), least, why)


@PAPER.claim("(37) LMIs (31) have solutions", "universal", printed="for sigma large enough", long=True)
def _():
    proofs = [shared.at_one(k_f) for k_f in (1, 10, 100)]
    why = (
        "even for every sigma: T(sigma) is a congruence at j0 = n, and the boxes of smaller j0 lie in that one; exact "
        "certificates at sigma = 1, j0 = 5 for k_f = 1, 10, 100"
    )
    return Statement(all(p.verify() for p in proofs), 1.0, why)


@PAPER.claim("LPV/LMI corresponds to j0", "value", printed="0")
def _():
    gone = [j0 for j0 in range(N + 1) if chain_lmi.gain_constant(shared.bounds(1), j0) == 0]
    return Value(
        float(gone[0]),
        f"(32) vanishes where k_j0 = 0: at j0 = n = {gone[0]}, as section IV has it; j0 = 0 is the standard high gain",
    )


@PAPER.claim("sigma is generally not large", "universal", printed="sigma = 1 could be taken")
def _():
    largest = max(float(one.sigma) for one in TABLE if one.sigma)
    why = (
        f"feasible at sigma = 1, see (37); but a smaller theta asks for sigma = theta, and table I goes up to sigma = "
        f"{largest:g}"
    )
    return Statement(None, largest, why)


@PAPER.claim("better solutions for sigma > 1", "universal", printed="always possible")
def _():
    found = chain_lmi.smallest_theta(shared.bounds(0.01), 1)
    proof = high_gain_lmi(shared.plant(0.01), bounds=shared.bounds(0.01), j0=1, theta=1.0, sigma=1.0)[1]
    why = (
        "in the sense of theta, which is compared, true while (32) asks for more than sigma; at k_f = 0.01, j0 = 1 theta = "
        f"{found.theta:g} holds with sigma = 1 (exact certificate), and sigma > 1 would force theta >= sigma > 1"
    )
    return Statement(False if found.theta == 1.0 and proof.verify() else None, found.theta, why)


@PAPER.claim("lambda = 1 without loss", "identity", printed="homogeneity of (31)-(32)")
def _():
    proof = shared.design(2)
    scale = 2.0 ** -np.floor(np.log2(proof.lam))  # a power of two: no rounding
    p = tuple(tuple(float(x * scale) for x in row) for row in proof.p)
    same = dataclasses.replace(proof, p=p, lam=float(proof.lam * scale), nu=float(proof.nu * scale))
    rates = [one.verify().margins["decay_rate"] for one in (proof, same)]
    return Statement(
        same.verify().holds and rates[0] == rates[1],
        same.lam,
        "P, lam and nu times one number: the same verdict and rate, exactly",
    )


@PAPER.claim("tau = sigma/(1+sigma)", "identity", printed="[1, inf[ -> [1/2, 1[")
def _():
    sigma = np.array([1.0, 1.5, 4.0, 62.0, 1e6])
    tau = sigma / (1 + sigma)
    gap = float(np.abs(tau / (1 - tau) / sigma - 1).max())
    return Statement(bool(gap < 1e-9 and tau[0] == 0.5 and np.all(np.diff(tau) > 0)), gap)


@PAPER.claim("algorithm (i)-(iii)", "universal", printed="the gridding finds the gain", long=True)
def _():
    _, proof, visits = _walk()
    edge = shared.smallest(shared.row(1, 1)).theta
    why = (
        f"j0 = 1, k_f = 1, the paper's k_j0, {len(visits)} grid points: |L| = {min(v.size for v in visits):.5g} at sigma = "
        f"{proof.sigma:.4g}, theta = {proof.theta:.4g}; bisection at theta = sigma gives the infimum {edge:.4g} without a grid"
    )
    return Statement(proof.verify().holds and proof.theta >= edge, proof.theta, why)


@PAPER.claim("algorithm (iv)", "value", printed="2", long=True)
def _():
    """The step to go to from (iv): (ii) is printed."""
    visits = _walk()[2]
    first = next(v for v in visits if np.isfinite(v.size))
    best = min(visits, key=lambda v: v.size)
    why = (
        "the step to go to: from (iv) to (ii), as printed, tau stays what it is, so the first grid point with a solution is "
        f"solved again and again (or once more, if the same |L| ends it): sigma = {first.sigma:.4g} with |L| = "
        f"{first.size:.5g}, while the walk that goes on to (iii) finds {best.size:.5g} at sigma = {best.sigma:.4g}"
    )
    return Value(3.0 if best.size < first.size else float("nan"), why)


@functools.cache
def _walk():
    return gridding(shared.plant(), bounds=shared.bounds(1), j0=1, step=0.04, constant=0.8)
