"""To a required decay rate through inequalities that are each easy in the coordinates of the last solution."""

import dataclasses

import numpy as np
import scipy.linalg

from jaxobs.designs import sdp
from jaxobs.designs._frame import STRICT, Frame, quietest

SOLVES = 60  # linear matrix inequalities on the way to the required rate
FASTEST = 1e8  # kappa beyond which a rate counts as infinite, in units of the model's own speed
DOUBLINGS = 10  # of a rate that the high-gain metric covers each time, before every rate counts as covered
LAST_STRIDE = 0.05  # kappa from which the descent goes to its target at once


@dataclasses.dataclass(frozen=True)
class Climb:
    """How far the rate came: `found` solves the inequalities of `place` at kappa (None: nowhere), after so many
    solves."""

    place: Frame
    found: sdp.Solution | None
    kappa: float
    solves: int


def climb(place: Frame, target: float, gain: np.ndarray | None, *, rtol: float = 1e-4) -> Climb:
    """To a required kappa: at once; or, with a free gain, down from where a high gain does it; or up from where P = I does."""
    if np.isfinite(target) and (found := place.solve(target, gain)).margin > STRICT:
        return Climb(place, found, target, 1)
    if gain is None and place.tau == 0:
        way = _descent(place, target)
        if way is not None:
            return way
    return _ascent(place, target, gain, rtol)


def _descent(place: Frame, target: float) -> Climb | None:
    """From the metric s P + A'P + P A = C'C with P L = C' (Gauthier, Hammouri and Othman, 1992) at a rate that covers the box,
    in strides of four, each to the quietest gain in the coordinates of the last P. None if there is no such rate."""
    n, rate = place.model.n, 4 * max(1.0, target if np.isfinite(target) else 0.0)
    middle, refinements, covered = (place.model.lower + place.model.upper) / 2, 0, 0
    while rate <= FASTEST and refinements < 5:
        shifted = place.model.at(middle) + rate / 2 * np.eye(n)
        p = scipy.linalg.solve_continuous_lyapunov(shifted.T, place.model.output.T @ place.model.output)
        d = np.sqrt(np.maximum(np.diagonal(p), np.finfo(float).tiny))
        if np.linalg.eigvalsh(p / np.outer(d, d))[0] < 1e-14:
            return None  # the output does not see all states in the middle of the box
        place = place.centred(p)
        if np.linalg.cond(p) > 1e8:  # solved once more in better coordinates
            refinements += 1
            continue
        refinements = 0
        inequalities = place.inequalities(rate / 4, None)
        if min(np.linalg.eigvalsh(f)[0] for f in inequalities(np.eye(n), place.model.output)[1:]) > 0:
            covered += 1
            if np.isfinite(target) or covered == DOUBLINGS:
                break
        elif covered:
            return None  # faster is not better: no chain of this kind
        rate *= 2
    else:
        return None
    if not np.isfinite(target):
        return Climb(place, _unit(place), np.inf, 1)
    kappa, best, solves = rate / 4, (place, _unit(place)), 0
    while kappa > target:
        solves += 1
        kappa = target if kappa <= max(4 * target, LAST_STRIDE) else kappa / 4
        found = quietest(place, kappa, np.eye(n), np.eye(n), np.eye(place.model.p))
        if found.margin <= 0 and (found := place.solve(kappa, None)).margin <= STRICT:
            return None
        best, place = (place, found), place.centred(found.values["p"])
    return Climb(*best, target, solves)


def _unit(place: Frame) -> sdp.Solution:
    """P = I and P L = C', which is known to do."""
    return sdp.Solution({"p": np.eye(place.model.n), "y": place.model.output}, 0.0, 0.0, np.inf, ())


def _ascent(place: Frame, target: float, gain: np.ndarray | None, rtol: float) -> Climb:
    """From the rate at which P = I does, in strides that double and halve, each in the coordinates of the last P."""
    n = place.model.n
    alone = place.inequalities(0.0, np.zeros((n, place.model.p)) if gain is None else place.here(gain))
    slowest = min(np.linalg.eigvalsh(f)[0] for f in alone(np.eye(n))[1:])
    first, reached, proof = min(slowest, 0.0) * 1.5 - 1e-3, -np.inf, (place, None)
    stride, ceiling, solves = (target - first if np.isfinite(target) else 1.0) / 2, np.inf, 1
    while solves < SOLVES and (reached == -np.inf or stride > rtol * max(abs(reached), 1e-3)):
        solves += 1
        trial = first if reached == -np.inf else min(reached + stride, target)
        found = place.solve(trial, gain)
        if found.margin > STRICT:
            reached, proof = trial, (place, found)
            if reached >= min(target, FASTEST):
                return Climb(*proof, reached if reached >= target else np.inf, solves)
            place, stride = place.centred(found.values["p"]), min(2 * stride, (ceiling - reached) / 2)
        elif reached == -np.inf:
            first = 4 * first
        else:
            ceiling, stride = trial, (trial - reached) / 2
    return Climb(*proof, reached, solves)
