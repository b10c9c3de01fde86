"""To a required decay rate through inequalities that are each easy in the coordinates of the last solution."""

import dataclasses

import numpy as np
import scipy.linalg

from jaxobs.designs import sdp
from jaxobs.designs._frame import STRICT, Frame, quietest

SOLVES = 60  # linear matrix inequalities on the way to the required rate
FASTEST = 1e8  # kappa beyond which a rate counts as infinite, in units of the model's own speed
DOUBLINGS = 10  # of a rate that the high-gain metric covers each time, before every rate counts as covered
SLOW = 2.0**-20  # where the descent's metric starts, in units of the first rate that counts
SHORTEST = 1.1  # stride of the descent
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
    """From the metric P = S^-1 with (A + s/2) S + S (A + s/2)' + s I = S C'C S and P L = C', at a rate s that covers the box,
    in strides of four or less, each to the quietest gain in the coordinates of the last P. None if there is no such rate.

    It is the high-gain metric of Gauthier, Hammouri and Othman (1992) but for s I, in coordinates in which the S before, at
    s / 2, has diagonal entries of about one: that keeps its condition number low, also for ten states.
    """
    n, slowest = place.model.n, 4 * max(1.0, target if np.isfinite(target) else 0.0)
    middle, covered, rate = (place.model.lower + place.model.upper) / 2, 0, slowest * SLOW
    while rate <= FASTEST:  # from so low a rate that the coordinates can follow
        c = place.model.output
        shifted = place.model.at(middle) + rate / 2 * np.eye(n)
        try:
            s = scipy.linalg.solve_continuous_are(shifted.T, c.T, rate * np.eye(n), np.eye(len(c)))
        except np.linalg.LinAlgError:
            return None  # the output does not see all states in the middle of the box
        d = np.diagonal(s)
        if not (np.all(d > 0) and np.linalg.eigvalsh(s / np.sqrt(np.outer(d, d)))[0] > 0):
            return None
        if rate >= slowest:
            high = place.centred(np.linalg.inv(s))
            if np.min(high.lowest(rate / 4, np.eye(n), high.model.output.T @ high.model.output)) > 0:
                covered += 1
                if np.isfinite(target) or covered == DOUBLINGS:
                    place = high
                    break
            elif covered:
                return None  # faster is not better: no chain of this kind
        place, rate = place.centred(np.diag(4.0 ** -np.round(np.log2(d) / 2))), 2 * rate  # by powers of two: exact
    else:
        return None
    if not np.isfinite(target):
        return Climb(place, _unit(place), np.inf, 1)
    kappa, best, solves, stride = rate / 4, (place, _unit(place)), 0, 4.0
    while kappa > target and stride > SHORTEST:  # else the last one decays faster than asked
        solves += 1
        trial = target if kappa <= max(stride * target, LAST_STRIDE) else kappa / stride
        found = quietest(place, trial, np.eye(n), np.eye(n), np.eye(place.model.p))
        if found.margin <= 0 and (found := place.solve(trial, None)).margin <= STRICT:
            stride = np.sqrt(stride)
            continue
        kappa, best, place = trial, (place, found), place.centred(found.values["p"])
    return Climb(*best, target, solves)


def _unit(place: Frame) -> sdp.Solution:
    """P = I and P L = C', which is known to do."""
    return sdp.Solution({"p": np.eye(place.model.n), "y": place.model.output}, 0.0, 0.0, np.inf, ())


def _ascent(place: Frame, target: float, gain: np.ndarray | None, rtol: float) -> Climb:
    """From the rate at which P = I does, in strides that double and halve, each in the coordinates of the last P."""
    n = place.model.n
    alone = 0.0 if gain is None else place.here(gain) @ place.model.output
    slowest = float(np.min(place.lowest(0.0, np.eye(n), np.zeros((n, n)) + alone)))
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
