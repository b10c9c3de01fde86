"""Theorems 1 and 2 of paper 001: what they promise for one tracker, and what it does, both in closed form.

N = n + q, H~ = H_inf at mu = 1, rho = 2 cos(pi / (N + 1)) (the largest eigenvalue of A~ + A~'; the paper takes sqrt(N) >= rho),
G = H - H_inf. All matrices are inverted in coordinates scaled by diag(mu^i), where they are harmless.

Arguments of all functions: n >= 1 estimates and q >= 0 integrators, mu > 0 [1/s], time t >= 0 [s], which are not checked, and
start: H(0) > 0 as one number c for c I, N numbers for a diagonal, or a matrix (N, N); ValueError for any other.
"""

import dataclasses
import math
from functools import lru_cache

import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Float

from jaxobs._module import refuse
from jaxobs.linalg import tracker_steady, tracker_structure

Start = float | Float[np.ndarray, "..."]


def growth(n: int, q: int) -> float:
    """rho = lambda_max(A~ + A~') = 2 cos(pi / (N + 1)) [1/s]: ||e^{A~ t}|| <= e^{rho t / 2}, and no smaller exponent will do.

    Source: the logarithmic norm (Dahlquist, 1958); paper 001 uses sqrt(N) for it, before (28).
    """
    return 2 * math.cos(math.pi / (n + q + 1))


def start_over_steady(n: int, q: int, mu: float, start: Start) -> float:
    """The largest theta with H(0) >= theta H_inf: lambda_min(H_inf^{-1/2} H(0) H_inf^{-1/2}), without unit.

    theta >= 1 is what Theorem 1 uses: then H(t) >= H_inf for all t. ValueError for a start that is not positive definite or
    of another shape. Source: paper 001, theorem 1 and (7).
    """
    d = float(mu) ** np.arange(n + q)
    h0 = mu * np.outer(d, d) * _matrix(n, q, start)
    unit, root = _equilibrated(h0)
    return 1 / float(scipy.linalg.eigh(tracker_steady(n, q) / np.outer(root, root), unit, eigvals_only=True)[-1])


def transition(n: int, q: int, mu: float, start: Start, t: float) -> Float[np.ndarray, "N N"]:
    """Phi(t) (N, N) of eta' = (A~ - H^-1 C~'C~) eta, paper 001, (24), from H(0) = start; t [s]:

        H(t) Phi(t) = e^{-mu t} e^{-A~'t} H(0),      H(t) = H_inf + e^{-mu t} e^{-A~'t} (H(0) - H_inf) e^{-A~t}.

    ValueError for a start that is not positive definite or of another shape. Source: paper 001, (7); the first is ours.
    """
    d, tau = float(mu) ** np.arange(n + q), mu * t
    steady = tracker_steady(n, q)
    scaled = mu * np.outer(d, d) * _matrix(n, q, start)
    back = _back(n, q, tau)
    h = steady + math.exp(-tau) * back.T @ (scaled - steady) @ back
    unit, root = _equilibrated(h)
    right = math.exp(-tau) * back.T @ scaled
    phi = np.linalg.solve(unit, right / root[:, None]) / root[:, None]
    return phi * np.outer(d, 1 / d)


def transition_steady(n: int, q: int, mu: float, t: float) -> Float[np.ndarray, "N N"]:
    """Phi(t) (N, N) from H(0) = H_inf: e^{(A~ - H_inf^-1 C~'C~) t} = H_inf^-1 e^{-mu t} e^{-A~'t} H_inf; t [s].

    Nothing is raised. Source: paper 001, (11), from which H_inf (A~ - H_inf^-1 C~'C~) = -(mu I + A~') H_inf.
    """
    d, h = float(mu) ** np.arange(n + q), tracker_steady(n, q)
    back = _back(n, q, mu * t)
    return math.exp(-mu * t) * np.linalg.solve(h, back.T @ h) * np.outer(d, 1 / d)


@dataclasses.dataclass(frozen=True)
class Peak:
    """sup_t ||Phi(t)||, where it is [s], and the bound that Theorem 2 amounts to when its proof is completed (infinite for the
    start from H_inf, which is no fixed matrix).
    """

    value: float
    time: float
    bound: float


def peak(n: int, q: int, mu: float, start: Start | None) -> Peak:
    """The largest factor by which the tracker's state exceeds where it started, y = 0. start None: from H_inf.

    The bound, with kappa = cond H(0) and eps(t) = lambda_min(H(t) for H(0) = 0):

        ||Phi(t)||^2 <= min(kappa e^{rho t}, lambda_max(H(0)) e^{-mu t} / eps(t)),

    whose supremum is where the two meet; it tends to kappa as mu -> infinity.
    """
    size = n + q
    end = 20.0 + 4 * size * math.log(1 + mu)  # in 1 / mu: e^{-mu t} mu^{2N-1} is far below 1 from there on
    times = np.sort(np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 60), np.linspace(0.5, end, 300)])) / mu

    def norm(t: float) -> float:
        phi = transition_steady(n, q, mu, t) if start is None else transition(n, q, mu, start, t)
        return float(np.linalg.norm(phi, 2))

    norms = np.asarray([norm(t) for t in times])
    k = int(np.argmax(norms))
    time, value = float(times[k]), float(norms[k])
    if 0 < k < len(times) - 1:  # a finer grid around the largest
        finer = np.linspace(times[k - 1], times[k + 1], 41)
        near = np.asarray([norm(t) for t in finer])
        time, value = float(finer[np.argmax(near)]), float(np.max(near))
    return Peak(value, time, math.inf if start is None else _peak_bound(n, q, mu, _matrix(n, q, start)))


def _peak_bound(n: int, q: int, mu: float, start: Float[np.ndarray, "N N"]) -> float:
    """Where kappa e^{rho t} meets lambda_max(H(0)) e^{-mu t} / eps(t), a decreasing function."""
    low, high = np.linalg.eigvalsh(start)[[0, -1]]
    rho, d = growth(n, q), float(mu) ** np.arange(n + q)
    steady = tracker_steady(n, q)

    def excess(tau: float) -> float:
        back = _back(n, q, tau)
        w = steady - math.exp(-tau) * back.T @ steady @ back
        unit, root = _equilibrated(w)
        inverse = np.linalg.inv(unit) / np.outer(root, root) * mu * np.outer(d, d)
        log_eps = -math.log(np.linalg.norm(inverse, 2))
        return math.log(low) - tau - log_eps - rho * tau / mu

    end = 1.0
    while excess(end) > 0:
        end *= 2
    if end == 1.0:  # the second bound has taken over before eps(t) is worth computing
        return math.sqrt(high / low * math.exp(rho / mu))
    tau = float(scipy.optimize.brentq(excess, end / 2, end))  # pyright: ignore[reportArgumentType]: it is a float
    return math.sqrt(high / low * math.exp(rho * tau / mu))


@dataclasses.dataclass(frozen=True)
class Theorem1:
    """The constants of (6)-(23) for one tracker, N in place of the n of c_bar: for t >= T [s] and ||z||_H = sqrt(z'H_inf z)

        ||z||_H <= e^{-mu (t-T) / 4} ||z(T)||_H + K_1 (sup|y^(n)| / mu^{N+1/2} + sup|d| / mu^{q+1/2}),

    K_1 = 2 C_1, C_1 = 2 sqrt(lambda_max(H~)) (as printed: the steps of the paper give lambda_max / sqrt(lambda_min), but with
    Cauchy and Schwarz in the norm of H_inf the printed value is right, as H~_qq <= lambda_max), C_2 = 2 C_0 c_bar^4,
    C_0 = ||H(0) - H_inf||,
    T = ln(2 C_2 mu^{4N-3}) / (mu - rho): from then on the disturbance of the gain costs at most half of the rate mu. settled
    [s] is when it really costs at most that. printed_T has sqrt(N) for rho, and mu^{4N-2} as in the print.
    """

    c0: float
    c1: float
    c2: float
    k1: float
    T: float
    printed_T: float
    settled: float

    def bound(self, n: int, q: int, mu: float, derivative: float, noise: float) -> float:
        """What remains of the right-hand side as t -> infinity."""
        return self.k1 * (derivative / mu ** (n + q + 0.5) + noise / mu ** (q + 0.5))


def theorem1(n: int, q: int, mu: float, start: Start) -> Theorem1:
    """The constants of Theorem 1. ValueError if its hypotheses fail: mu > sqrt(N), H(0) >= H_inf."""
    size = n + q
    if mu <= math.sqrt(size):
        raise refuse(
            "theorem1", "mu", mu, f"mu > sqrt(n + q) = {math.sqrt(size):.6g}", "'Sufficiently large' means at least that."
        )
    if (theta := start_over_steady(n, q, mu, start)) < 1:
        expected = "H(0) >= H_inf, i.e. at least 1"
        raise refuse("theorem1", "start", f"H(0) >= {theta:.6g} H_inf only", expected, "Start from a larger H(0) or mu.")
    steady = tracker_steady(n, q)
    high = np.linalg.eigvalsh(steady)[-1]
    inverse_root = np.real(scipy.linalg.inv(scipy.linalg.sqrtm(steady)))
    c_bar = math.sqrt(size) * np.linalg.norm(inverse_root, np.inf)
    c0 = float(np.linalg.norm(_matrix(n, q, start) - tracker_steady(n, q, mu), 2))
    c1, c2 = 2 * math.sqrt(high), 2 * c0 * c_bar**4
    ends = [
        max(math.log(2 * c2) + power * math.log(mu), 0.0) / (mu - rate)
        for power, rate in ((4 * size - 3, growth(n, q)), (4 * size - 2, math.sqrt(size)))
    ]
    times = np.geomspace(1e-3 / mu, ends[0], 400)
    excess = [disturbance(n, q, mu, start, t) - mu / 2 for t in times]
    last = max((k for k, value in enumerate(excess[:-1]) if value > 0), default=-1)
    if last < 0:
        return Theorem1(c0, float(c1), float(c2), float(2 * c1), ends[0], ends[1], 0.0)
    low, high = float(times[last]), float(times[last + 1])
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if disturbance(n, q, mu, start, middle) > mu / 2 else (low, middle)
    return Theorem1(c0, float(c1), float(c2), float(2 * c1), ends[0], ends[1], high)


def disturbance(n: int, q: int, mu: float, start: Start, t: float) -> float:
    """2 ||H_inf^{1/2} (H_inf^-1 - H^-1) C~'C~ H_inf^{-1/2}||, (12): what the gain's transient takes from the rate mu, exactly.

    It is a rank-one matrix: 2 |H_inf^{1/2} (K_inf - K)| |H_inf^{-1/2} C~'|, in scaled coordinates times mu. In 1/s, at the
    time t [s] after the start. ValueError for a start that is not positive definite or of another shape. Source: paper 001,
    (12).
    """
    d, tau = float(mu) ** np.arange(n + q), mu * t
    steady = tracker_steady(n, q)
    back = _back(n, q, tau)
    scaled = mu * np.outer(d, d) * _matrix(n, q, start)
    h = steady + math.exp(-tau) * back.T @ (scaled - steady) @ back
    unit, root = _equilibrated(h)
    gain = np.linalg.solve(unit, np.eye(n + q)[0] / root) / root
    best = np.linalg.inv(steady)[:, 0]
    return 2 * mu * math.sqrt((best - gain) @ steady @ (best - gain)) * math.sqrt(best[0])


def _back(n: int, q: int, tau: float) -> Float[np.ndarray, "N N"]:
    """e^{-A~ tau}, a polynomial: s_i s_j (-tau)^{j-i} / (j-i)!."""
    s, lag, factorials = _series(n, q)
    return s * np.power(-tau, lag) / factorials


@lru_cache
def _series(n: int, q: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    order = np.arange(n + q)
    lag = np.maximum(order[None, :] - order[:, None], 0)
    s = tracker_structure(n, q)[1]
    return np.triu(np.outer(s, s)), lag, np.asarray([math.factorial(k) for k in order], float)[lag]


def _matrix(n: int, q: int, start: Start) -> Float[np.ndarray, "N N"]:
    given = np.asarray(start, float)
    h = np.diag(np.broadcast_to(given, (n + q,))) if given.ndim < 2 else given
    if h.shape != (n + q, n + q) or np.linalg.eigvalsh(_equilibrated(h)[0] if np.all(np.diag(h) > 0) else h)[0] <= 0:
        expected = f"H(0) > 0: a number, {n + q} of them, or a matrix ({n + q}, {n + q})"
        raise refuse("tracker", "start", given.tolist(), expected, "It is symmetric and positive definite.")
    return h


def _equilibrated(h: Float[np.ndarray, "N N"]) -> tuple[Float[np.ndarray, "N N"], Float[np.ndarray, " N"]]:
    """(h with unit diagonal, the roots of its diagonal)."""
    root = np.sqrt(np.diag(h))
    return h / np.outer(root, root), root
