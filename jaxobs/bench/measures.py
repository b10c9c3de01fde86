"""What a gain does at constant parameters: the noise in every state, and how far an initial error is thrown.

Lower bounds of what it does for all rho(t) in the box, beside which the guaranteed levels stand. Floats, no proofs: gains of a
chain spread over many decades, so that all of it is computed in coordinates balanced by powers of two.
"""

import numpy as np
import scipy.linalg

from jaxobs.designs._dynamics import balancing, stationary
from jaxobs.designs.polytope import Polytope

OCTAVE, FINE = 4, 16  # instants in each doubling of the time at which the transient is looked at; then about the worst


def noise_at(
    model: Polytope, gain: np.ndarray, rho: np.ndarray, process: np.ndarray, noise: np.ndarray, *, step: bool = False
) -> np.ndarray | None:
    """`stationary` at a constant rho (r,) under process noise through `process` (n, m) and measurement noise through
    `noise` (p, k); None where the error does not decay."""
    return stationary(model.at(rho) - gain @ model.output, np.hstack([process, -gain @ noise]), step=step)


def worst_at_corners(
    model: Polytope, gain: np.ndarray, weight: np.ndarray, process: np.ndarray, noise: np.ndarray, *, step: bool = False
) -> float:
    """max tr(E X E') over the corners held constant, inf where one is not stable: no level below it can be guaranteed."""
    found = [noise_at(model, gain, rho, process, noise, step=step) for rho in model.parameters()]
    return max(np.inf if x is None else float(np.trace(weight @ x @ weight.T)) for x in found)


def peak(model: Polytope, gain: np.ndarray) -> float:
    """max over t >= 0 and over the corners held constant of |exp(F t)|_2: how far an initial error of size one is thrown.

    To the distance of the instants, which are ever closer about the largest value; inf where a corner is not stable."""
    return max(_thrown(f) for f in model.closed(gain))


def _thrown(f: np.ndarray) -> float:
    slowest = -float(np.linalg.eigvals(f).real.max())
    if slowest <= 0:
        return np.inf
    t = np.diagonal(balancing(f))
    inside = f / t[:, None] * t

    def sizes(moved: np.ndarray) -> np.ndarray:
        return np.linalg.norm(moved * t[:, None] / t, 2, axis=(-2, -1))

    first = 1e-2 / np.linalg.norm(inside, 2)
    times = first * 2 ** (np.arange(OCTAVE) / OCTAVE)
    moved, largest, at = scipy.linalg.expm(inside * times[:, None, None]), 1.0, first
    for _ in range(int(np.log2(3 / slowest / first)) + 2):  # exp(F 2t) = exp(F t)^2
        thrown = sizes(moved)
        if thrown.max() > largest:
            largest, at = float(thrown.max()), float(times[np.argmax(thrown)])
        moved, times = moved @ moved, 2 * times
    low, high = at * 2 ** (-1 / OCTAVE), at * 2 ** (1 / OCTAVE)
    moved, stride = scipy.linalg.expm(inside * low)[None], scipy.linalg.expm(inside * (high - low) / FINE)
    for _ in range(FINE):
        moved = moved @ stride
        largest = max(largest, float(sizes(moved).max()))
    return largest
