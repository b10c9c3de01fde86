"""The fastest decay that one Lyapunov matrix proves: for given gains, or over the gains as well.

    max r:   P > 0,   P F(rho) + F(rho)'P + 2 r P < 0   for all rho

is quasi-convex. Each step solves max t: -(P F + F'P) - 2 r P >= t I, P <= n I, in coordinates in which the last P is the
identity, and takes the largest r that the new P proves (Dinkelbach's method for generalised eigenvalues; Crouzeix and Ferland,
1991).
"""

import dataclasses

import numpy as np
import scipy.linalg

from jaxobs.designs import _conic
from jaxobs.designs._conic import Affine, constant, full, sym, symmetric, value, variables
from jaxobs.designs._dynamics import Dynamics, balancing, centred
from jaxobs.designs.covers import Corners, Inequality, Multiplier, covered

STEPS = 60
REACH = 1e3  # of P L and of the multipliers times K, in coordinates and units in which P and F are of size one
STRICT = 1e-7  # margin of an inequality in these coordinates


@dataclasses.dataclass(frozen=True)
class Proof:
    """rate [1/s], with the P (n, n), and the multipliers tau (r, r), that prove it of the gains of d."""

    d: Dynamics
    rate: float
    p: np.ndarray
    tau: np.ndarray


def decay(
    d: Dynamics,
    p: Affine,
    tau: Affine,
    rate: float,
    *,
    y: Affine | None = None,
    x: Affine | None = None,
    slack: Affine | float = 0.0,
    margin: float = 0.0,
) -> Inequality:
    """P F + F'P + 2 rate P + slack I < 0; with y in place of P L, if given; with x for tau K too, y is P (L + b mid K)."""
    own, n = d.model, d.model.n
    pf = p @ d.closed if y is None else p @ own.a - y @ own.output
    push = slack * np.eye(n) if isinstance(slack, np.ndarray) else constant(slack * np.eye(n), p)
    if x is None:
        return Inequality("decay", -sym(pf) - 2 * rate * p - push, p @ own.b, d.seen, tau, margin)
    # v starts from K = 0, and tau v changes by -x output; diag(mid) K is part of y
    zero, m = np.zeros((n, own.r)), -sym(pf) - 2 * rate * p - push
    return Inequality("decay", m, p @ own.b, own.c, tau, margin, -(x @ own.output), zero, np.eye(own.r))


def fastest(
    d: Dynamics,
    cover: Corners | Multiplier,
    *,
    p: np.ndarray | None = None,
    target: float = np.inf,
    free: bool = False,
    circle: bool = False,
    rtol: float = 1e-6,
) -> Proof:
    """The largest rate for the gains of d, or (free) over L, or (circle) over L and K, the latter with multipliers; or the
    first rate found that is at least the target. p: where to start; else a Lyapunov matrix of the middle of the box."""
    p = _start(d, free) if p is None else p
    best = Proof(d, -np.inf, p, np.eye(cover.multipliers))
    for _ in range(STEPS):
        found = _step(best, cover, free, circle)
        if found is None or found.rate <= best.rate:
            return best
        last, best = best.rate, found
        if best.rate >= target or best.rate - last <= rtol * abs(best.rate):
            return best
    return best


def _start(d: Dynamics, free: bool) -> np.ndarray:
    """P of the filter for the middle of the box (free), or of its error dynamics, slowed down if it is not stable."""
    f, n = d.at_middle(), d.model.n
    if free:
        f = d.model.at(d.middle)
        t, scale = balancing(f), max(float(np.linalg.norm(f, 2)), 1e-300)
        f, c = np.linalg.solve(t, f @ t) / scale, d.model.output @ t
        try:
            covariance = scipy.linalg.solve_continuous_are(f.T, c.T, np.eye(n), np.eye(len(c)))
            inverse = np.linalg.inv(t)
            return inverse.T @ np.linalg.inv(covariance) @ inverse
        except (np.linalg.LinAlgError, ValueError):
            f = t @ f @ np.linalg.inv(t) * scale
    t = balancing(f)  # gains of a chain spread over decades
    f, inverse = np.linalg.solve(t, f @ t), np.linalg.inv(t)
    slowest, size = float(np.linalg.eigvals(f).real.max()), float(np.linalg.norm(f, 2))
    shift = 0.0 if slowest < -1e-3 * size else max(1.1 * slowest, 0.0) + 1e-2 * size
    return inverse.T @ scipy.linalg.solve_continuous_lyapunov((f - shift * np.eye(n)).T, -np.eye(n)) @ inverse


def _step(last: Proof, cover: Corners | Multiplier, free: bool, circle: bool) -> Proof | None:
    try:
        t = centred(last.p)
    except np.linalg.LinAlgError:
        return None
    d, speed, units = last.d.in_coordinates(t).scaled()
    own, n = d.model, d.model.n
    bases = {"y": full(n, own.p)} if free or circle else {}
    bases |= {"x": full(own.r, own.p)} if circle else {}
    p, tau, slack, *others = variables(symmetric(n), cover.tau(), full(1, 1), *bases.values())
    chosen: dict[str, Affine] = dict(zip(bases, others, strict=True))
    rate = last.rate / speed
    if not np.isfinite(rate):  # what P = I proves: nothing is known of a first P
        rate = _slow(d.with_gains(own.output.T) if chosen else d)
    one = decay(d, p, tau, rate, slack=slack, y=chosen.get("y"), x=chosen.get("x"))
    limits = [_reach(part) for part in chosen.values()]
    size = [constant(n * np.eye(n), p) - p, p]
    found = covered(cover, [one], lambda matrices: _conic.minimise(-slack[:, 0, 0], [*matrices, *size], cones=limits))
    if found is None:
        return None
    ph = value(p, found)
    return _kept(last, cover, t, speed, units, d, ph, value(tau, found), {k: value(v, found) for k, v in chosen.items()})


def _kept(last, cover, t, speed, units, d, p, tau, chosen) -> Proof | None:
    """The rate that the new P, multipliers and gains prove, found again from them alone."""
    if np.linalg.eigvalsh(p)[0] <= 1e-12:
        return None
    inner = d.inner
    gain = d.gain
    if "x" in chosen:
        if np.diagonal(tau).min(initial=1.0) <= 0:
            return None
        inner = np.linalg.solve(tau, chosen["x"])
    if "y" in chosen:
        gain = np.linalg.solve(p, chosen["y"]) - ((d.model.b * d.middle) @ inner if "x" in chosen else 0.0)
    here = d.with_gains(gain, inner)
    rate = cover.lowest(decay(here, p[None], tau[None], 0.0), np.zeros(0), p) / 2
    inverse = np.linalg.inv(t)
    user = last.d.with_gains(t @ gain * speed, inner * units[:, None]) if chosen else last.d
    p_user = inverse.T @ ((p + p.T) / 2) @ inverse
    return Proof(user, rate * speed, p_user, tau * speed / units[: len(tau)] ** 2)


def _reach(y: Affine) -> Affine:
    flat = y.reshape(len(y), -1)
    return np.concatenate([constant(np.array([REACH]), y), flat], axis=1)


def _slow(d: Dynamics) -> float:
    """A rate, perhaps negative, that P = I proves at every corner."""
    f = d.at_corners()
    return float(np.linalg.eigvalsh(-(f + np.swapaxes(f, 1, 2)))[:, 0].min()) / 2
