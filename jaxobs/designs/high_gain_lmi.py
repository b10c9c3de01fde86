"""High-gain observers of a chain by linear matrix inequalities: standard, and with the last j0 slopes by corners (HG/LMI)."""

import dataclasses
import itertools
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxobs._module import dtype_of, refuse, require_nonnegative
from jaxobs.certificates import HighGainLmi
from jaxobs.designs import sdp
from jaxobs.designs.chain_lmi import (
    corners,
    error_matrices,
    gain_constant,
    largest_lambda,
    require_index,
    scaled_gain,
    slope_bounds,
    smallest_theta,
)
from jaxobs.designs.chain_proofs import certify
from jaxobs.designs.infeasible import Infeasible
from jaxobs.observers import Luenberger
from jaxobs.plants import AbstractChain

EXCESS = 1.1  # theta over its infimum, which only K -> infinity reaches


def high_gain_lmi(
    plant: AbstractChain,
    *,
    bounds: Any,
    j0: int = 0,
    theta: float | None = None,
    sigma: float | None = None,
    gain: Any = None,
    constant: float | None = None,
    rate: float = 0.0,
) -> tuple[Luenberger, HighGainLmi]:
    """z' = f(z, u) + T(theta) K (y - z_1) and the proof that its error decays for every f with slopes in `bounds` (002, 3.3):

        (A + B psi' - K C)'P + P (A + B psi' - K C) + lam I < 0   at the 2^j0 corners of the box at sigma,        (31)
        theta^{1+j0} > 2 k_j0 lambda_max(P) / lam,   theta >= sigma                                               (32)

    bounds (n, 2): rows (lowest, highest) of df/dx_i, or of the slopes of f if it has no derivative; each contains 0. j0: how
    many of the last slopes are treated by corners: 0 is the standard high-gain observer, n the LPV/LMI one, without (32).
    theta: if not given, 1.1 times the smallest one for any K; at j0 = n, where every theta will do, 1 + the largest slope.
    sigma: theta if not given. gain K (n,): keeps that one, and finds theta and P. constant: k_j0, else the sharp k_j0(theta).
    rate [1/s]: exp(-rate t) is proved. K minimises K'P K under these inequalities with P <= I (it keeps the gain finite: the
    smallest theta alone does not). What is certified are the numbers that the observer carries, in its own precision.

    Infeasible when (31)-(32) have no solution, with the smallest theta that has one; ValueError for a plant that is no chain,
    bounds that do not contain 0, j0 outside 0..n, theta < 1, sigma outside ]0, theta], a constant below the sharp one.
    """
    owner = "high_gain_lmi"
    pairs = _checked(owner, plant, bounds, j0, rate)
    k = None if gain is None else scaled_gain(owner, gain, plant.n)
    theta = _theta(owner, pairs, j0, theta, k, constant, rate)
    if sigma is not None and not 0 < sigma <= theta:
        fix = "theta >= max(sigma, ...) in theorem 3.3; leave sigma out for the best one, theta."
        raise refuse(owner, "sigma", sigma, f"a number in ]0, theta = {theta:.6g}]", fix)
    sigma = theta if sigma is None else float(sigma)
    if constant is not None and constant < (sharp := gain_constant(pairs, j0, theta)) * (1 - 1e-13):
        fix = "The proof would not cover these slopes. Leave it out for the sharp one."
        raise refuse(owner, "constant", constant, f"at least k_j0({theta:.6g}) = {sharp:.9g}", fix)
    found = design_at(plant, pairs, j0, theta=theta, sigma=sigma, gain=k, constant=constant, rate=rate)
    if found is None:
        raise _infeasible(pairs, j0, theta, sigma, k, constant, rate)
    return found


def design_at(
    plant: AbstractChain, pairs: np.ndarray, j0: int, *, theta: float, sigma: float, gain: np.ndarray | None = None,
    constant: float | None = None, rate: float = 0.0,
) -> tuple[Luenberger, HighGainLmi] | None:  # fmt: skip
    """`high_gain_lmi` at one theta and sigma, arguments already checked; None where nothing was found."""
    k = _smallest_gain(pairs, j0, theta, sigma, constant, rate) if gain is None else gain
    if k is None:
        return None
    observer = Luenberger(plant, jnp.asarray((k * theta ** np.arange(1, plant.n + 1))[:, None], dtype_of(plant)))
    carried = np.asarray(observer.gain, float)[:, 0]
    certificate = certify(pairs, j0, theta, carried, sigma=sigma, constant=constant)
    if certificate is None or certificate.verify().margins["decay_rate"] < rate * (1 - 1e-6):
        return None
    return observer, certificate


def standard_high_gain(
    plant: AbstractChain, *, bounds: Any, theta: float | None = None, constant: float | None = None
) -> tuple[Luenberger, HighGainLmi]:
    """The standard high-gain observer, (15)-(16), and where f does not depend on the last j0 states (19)-(20) of paper 002.

    j0 is the number of bounds [0, 0] at the end (theorem 3.2; none: theorem 2.1); then (31)-(32), which is certified, has one
    corner and is (19)-(20). Arguments as in `high_gain_lmi`, but the bounds need not contain 0.
    """
    owner = "standard_high_gain"
    require_chain(owner, plant)
    pairs = slope_bounds(owner, bounds, plant.n, around_zero=False)
    used = np.flatnonzero(np.any(pairs != 0, axis=1))
    j0 = plant.n - 1 - int(used[-1]) if used.size else plant.n
    wide = np.stack([-np.abs(pairs).max(axis=1), np.abs(pairs).max(axis=1)], axis=1)  # only their size matters
    observer, found = high_gain_lmi(plant, bounds=wide, j0=j0, theta=theta, constant=constant)
    lower, upper = (tuple(map(float, side)) for side in pairs.T)
    return observer, dataclasses.replace(found, lower=lower, upper=upper, sigma=found.theta)


def require_chain(owner: str, plant: Any) -> None:
    """x' = A x + B f(x, u), y = x_1 (paper 002, (6)): ValueError, naming owner.plant, unless it is an AbstractChain."""
    if not isinstance(plant, AbstractChain):
        fix = "Write it as a subclass of AbstractChain."
        raise refuse(owner, "plant", type(plant).__name__, "a plant in chain form, (6)", fix)


def _checked(owner: str, plant: Any, bounds: Any, j0: Any, rate: float) -> np.ndarray:
    require_chain(owner, plant)
    pairs = slope_bounds(owner, bounds, plant.n)
    require_index(owner, j0, plant.n)
    require_nonnegative(owner, "rate", rate, "It is the decay rate in 1/s to be proved.")
    return pairs


def _theta(
    owner: str, pairs: np.ndarray, j0: int, theta: float | None, k: np.ndarray | None, constant: float | None, rate: float
) -> float:
    if theta is not None:
        if not (np.isfinite(theta) and theta >= 1):
            raise refuse(owner, "theta", theta, "a number >= 1", "k_j0 bounds the slopes only for theta >= 1, (14).")
        return float(theta)
    if j0 == len(pairs) and rate == 0:
        return 1.0 + float(np.abs(pairs).max())
    smallest = smallest_theta(pairs, j0, gain=k, constant=constant, rate=rate)
    if not np.isfinite(smallest.theta):
        raise _infeasible(pairs, j0, 1.0, 1.0, k, constant, rate)
    return EXCESS * smallest.theta


def _smallest_gain(pairs, j0, theta, sigma, constant, rate) -> np.ndarray | None:
    """K with the smallest K'P K, P <= I, at this theta: one SDP in P, Y' = P K and a bound on it.

    lam is asked to lie a tenth of the way from what is needed to the best there is, which leaves some decay rate, or close to
    what the rate needs where one is given.
    """
    n = len(pairs)
    rows = corners(pairs, j0, sigma)
    best = largest_lambda(rows).attained
    needed = _needed(pairs, j0, theta, constant, rate)
    if not best > needed:
        return None
    f, e1 = error_matrices(rows, None), np.eye(1, n)

    def lmis(p, y, size, lam, unit):
        y = unit * y
        bounded = np.block([[unit**2 * size.reshape(1, 1), y], [y.T, p]])  # K'P K <= unit^2 size
        return [np.eye(n) - p, bounded, *(-(p @ one + one.T @ p - y.T @ e1 - e1.T @ y) - lam * np.eye(n) for one in f)]

    unknowns = {"p": sdp.symmetric(n, reach=1.0), "y": sdp.full(1, n), "size": sdp.scalar(reach=1e6)}
    shares = (0.1, 0.5) if rate == 0 else (1e-3, 1e-2, 0.1, 0.5)
    for unit, share in itertools.product((1.0, 10.0, 100.0), shares):  # large gains are lost in rounding in a small unit
        lam = needed + share * (best - needed)
        found = sdp.optimise(
            unknowns,
            lambda p, y, size, lam=lam, unit=unit: lmis(p, y, size, lam, unit),
            maximise=lambda p, y, size: -size,
            margin=1e-9,
        )
        if found.values and np.linalg.eigvalsh(found.values["p"])[0] > 0:
            k = unit * np.linalg.solve(found.values["p"], found.values["y"][0])
            if largest_lambda(rows, k).attained > needed:
                return k
    return None


def _needed(pairs, j0, theta, constant, rate) -> float:
    """The lam that (32) and the rate ask for, with P <= I."""
    own = gain_constant(pairs, j0, theta) if constant is None else constant
    return 2 * (own + rate * theta**j0) / theta ** (1 + j0)


def _infeasible(pairs, j0, theta, sigma, k, constant, rate) -> Infeasible:
    """What is missing at this theta, and the smallest one that would do."""
    reach = largest_lambda(corners(pairs, j0, sigma), k)
    needed = _needed(pairs, j0, theta, constant, rate)
    whose = "any K" if k is None else f"K = {k.tolist()}"
    where = f"{whose} with j0 = {j0} at theta = {theta:.6g}, sigma = {sigma:.6g}"
    refuted = reach.bound < needed
    reason = f"(31)-(32) have no solution for {where}" if refuted else f"no solution of (31)-(32) was found for {where}"
    edge = smallest_theta(pairs, j0, gain=k, constant=constant, rate=rate)
    margin = reach.attained - needed
    if np.isinf(edge.refuted):
        return Infeasible(reason, margin, "No theta will do, A - K C is not Hurwitz: take another K, or none.")
    if not np.isfinite(edge.theta):
        return Infeasible(reason, margin, "None was found for larger theta either; tighter bounds or another j0 may help.")
    change = f"They have one from theta = sigma = {edge.theta:.6g} on."
    if not refuted and theta >= edge.theta and sigma >= edge.theta:
        change += " Here floats were at their limits: move theta."
    if k is not None:
        change += " Another K may need less: leave gain out."
    return Infeasible(reason, margin, change, best=edge.theta)
