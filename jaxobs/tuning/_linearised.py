"""An observer near an operating point as a linear filter from the measurement to the estimate."""

from typing import Any, NamedTuple

import jax
import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Array, Float

from jaxobs.observers import AbstractFlowObserver, Observer
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant
from jaxobs.tuning.linear_error import linearise

STILL = 1e-9  # a part of z that moves by less, in its units a second or a sample, is at rest
POINTS, DECADES = 600, 4  # of the frequencies, and how far they go beyond the fastest pole


class Passband(NamedTuple):
    """[rad/s] Of y_1 -> yhat_1: the -3 dB bandwidth and the equivalent noise bandwidth, and the modulus of the fastest pole."""

    bandwidth: float
    noise_bandwidth: float
    fastest_pole: float


def passband(
    observer: Observer, plant: AbstractFlowPlant | AbstractStepPlant, x: Float[Array, " n"], u: Any, dt: float
) -> Passband:
    """With F = d flow/dz, G = d flow/dy, H = d h(xhat)/dz, D = d h(xhat)/dy at z = init(x), T(s) = H (sI - F)^-1 G + D:

        bandwidth: |T(j w)| < |T(0)| / sqrt 2 for all w beyond it
        noise bandwidth = int_0^inf |T(j w) / T(0)|^2 dw = pi H X H'/ T(0)^2,   F X + X F' + G G' = 0.

    A step observer has z-plane poles p, of modulus |log p| / dt, and T on the unit circle. NaN
    where F is not stable, T(0) = 0, or the gain moves at that point (extended Kalman, fading memory: no one filter).
    """
    f, g, h, d, moves = _matrices(observer, plant, x, u)
    flows = isinstance(observer, AbstractFlowObserver)
    poles = np.linalg.eigvals(f)
    if not flows:
        poles = np.log(np.where(np.abs(poles) > 0, poles, 1e-300).astype(complex)) / dt
    # A pole at z = 0 answers within the sample: it is no rate.
    rates = np.abs(poles) if flows else np.abs(poles[np.abs(poles) * dt < 100])
    fastest = float(np.max(rates, initial=0.0))
    if moves or len(f) == 0 or not np.all(np.isfinite(f)) or not np.all(poles.real < 0):
        return Passband(np.nan, np.nan, np.nan if moves or len(f) == 0 else fastest)

    def response(frequency: np.ndarray) -> np.ndarray:
        point = 1j * frequency if flows else np.exp(1j * frequency * dt)
        inner = point[:, None, None] * np.eye(len(f)) - f
        return np.abs(np.linalg.solve(inner, np.broadcast_to(g[:, None], (len(point), len(f), 1)))[..., 0] @ h + d)

    still = float(response(np.zeros(1))[0])
    if still == 0:
        return Passband(np.nan, np.nan, fastest)
    if flows:
        power = np.inf if d else float(h @ scipy.linalg.solve_continuous_lyapunov(f, -np.outer(g, g)) @ h)
    else:
        power = float(h @ scipy.linalg.solve_discrete_lyapunov(f, np.outer(g, g)) @ h + d * d) / dt
    return Passband(_crossing(response, still, rates, None if flows else np.pi / dt), np.pi * power / still**2, fastest)


def _crossing(response: Any, still: float, rates: np.ndarray, last: float | None) -> float:
    """The highest frequency at which the response is 3 dB below that at rest; infinity if it stays above."""
    low = np.min(rates) / 10**DECADES
    high = np.max(rates) * 10**DECADES if last is None else last
    frequencies = np.geomspace(low, high, POINTS)
    above = response(frequencies) > still / np.sqrt(2)
    if above[-1]:
        return np.inf
    if not np.any(above):
        return 0.0
    i = int(np.max(np.nonzero(above)[0]))

    def excess(logarithm: float) -> float:
        return float(response(np.exp([logarithm]))[0]) - still / np.sqrt(2)

    found = scipy.optimize.root_scalar(excess, bracket=(np.log(frequencies[i]), np.log(frequencies[i + 1])))
    return float(np.exp(found.root))


def _matrices(
    observer: Any, plant: AbstractFlowPlant | AbstractStepPlant, x: Any, u: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, bool]:
    """F, G, H, D of y_1 -> yhat_1 on the part of z through which y acts on it; whether the rest of z moves."""
    error = linearise(observer, plant, x, u)
    c = np.asarray(jax.jacfwd(lambda x: plant.h(x, u)[0])(x), np.float64)
    f, g, speed = (np.asarray(part, np.float64) for part in (error.f, error.noise[:, 0], error.drift))
    h, d = (c @ np.asarray(part, np.float64) for part in (error.output, error.direct))
    links = np.eye(len(f), dtype=bool) | (f != 0)
    for _ in range(len(f)):
        links = links | (links.astype(int) @ links.astype(int) > 0)
    between = (links @ (g != 0)) & ((h != 0) @ links)
    moves = bool(np.any(np.abs(speed[~between]) > STILL))
    keep = np.nonzero(between)[0]
    return f[np.ix_(keep, keep)], g[keep], h[keep], float(d[0]), moves
