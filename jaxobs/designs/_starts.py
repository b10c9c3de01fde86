"""First gains that prove a required rate, from which a search descends."""

import numpy as np
import scipy.linalg

from jaxobs.designs._dynamics import Dynamics, balancing, centred
from jaxobs.designs._rates import Proof, fastest
from jaxobs.designs.covers import Corners, Multiplier

FASTEST = 1e8  # rate of the metric beyond which none is tried, in units of the model's own speed
STEPS = 20  # to coordinates in which the metric has a diagonal of about one


def first(d: Dynamics, cover: Corners | Multiplier, rate: float) -> Proof:
    """Gains with a rate of at least `rate`, or, where none are found, those of the largest one: the high gain of the metric
    below, then the fastest of all that a single P proves."""
    for found in high_gains(d, rate):
        proof = fastest(found[0], cover, p=found[1], target=rate)
        if proof.rate >= rate:
            return proof
    return fastest(d, cover, free=True, target=rate)


def high_gains(d: Dynamics, rate: float):
    """(d with L = P^-1 output', P) from s P + A'P + P A = output'output, A the middle of the box, for s = 4 rate and on,
    doubling: those that prove the rate at every corner. Source: Gauthier, Hammouri and Othman, IEEE TAC 37 (1992)."""
    own = d.model
    middle = own.at(d.middle)
    widest = np.maximum(np.abs(own.lower), np.abs(own.upper))
    t = balancing(np.abs(own.a) + (np.abs(own.b) * widest) @ np.abs(own.c))
    scales, speed = np.diagonal(t), d.in_coordinates(t).with_gains(np.zeros((own.n, own.p))).speed
    s, kept = 4 * max(rate, 1e-2 * speed), 0
    while s <= FASTEST * speed and kept < 4:
        found = _metric(middle, own.output, scales, s)
        s *= 2
        if found is None:
            continue
        p, scales = found  # they do for twice this s, too
        try:
            t = centred(p)
        except np.linalg.LinAlgError:
            continue
        gain = t @ (own.output @ t).T
        moved = d.with_gains(gain)
        f = moved.in_coordinates(t).at_corners()
        if np.linalg.eigvalsh(-(f + np.swapaxes(f, 1, 2))).min() / 2 >= rate:
            kept += 1
            yield moved, p
        elif kept:
            return  # faster is not better: no chain of this kind


def _metric(a: np.ndarray, output: np.ndarray, scales: np.ndarray, s: float) -> tuple[np.ndarray, np.ndarray] | None:
    """P, and the powers of two in which its diagonal is about one, found from those given; None if the output does not see all
    states at this s."""
    for _ in range(STEPS):
        here, c = a * scales / scales[:, None] / s, output * scales
        if np.linalg.eigvals(here).real.min() < -0.49:
            return None  # too slow a metric for modes that decay this fast
        p = scipy.linalg.solve_continuous_lyapunov((here + np.eye(len(a)) / 2).T, c.T @ c)
        d = np.diagonal(p)
        if not d.min() > 0:
            return None
        steps = 2.0 ** -np.round(np.log2(d) / 2)
        if np.all(steps == 1):
            return p / np.outer(scales, scales) / s, scales
        scales = scales * steps
    return None
