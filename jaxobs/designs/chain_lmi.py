"""The inequalities (31)-(32) of paper 002 for a chain with bounded slopes: how far they reach, in T(theta) coordinates.

With K = T(theta)^-1 L, theta = sigma and P <= I, (31)-(32) ask for theta^{1+j0} lam*(theta) > 2 k_j0 with

    lam*(sigma) = max lam:   0 < P <= I,   (A + B psi' - K C)'P + P (A + B psi' - K C) + lam I <= 0 at the corners of (27).

theta^{1+j0} lam*(theta) increases, so the smallest theta is found by bisection. Every answer comes with both of its sides: lam
from the values of P, and an upper bound on lam from the multipliers, recomputed here.
"""

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import scipy.optimize

from jaxobs._module import refuse, require_integer, require_nonnegative
from jaxobs.designs import sdp

LARGEST = 10  # states
ZERO = 1e-9  # a lam* that is told from 0
FARTHEST = 1e9  # no theta beyond it is searched
FLOOR = 6.0  # of log(lam* / needed), where lam* is zero or lost in rounding
TOLERANCE = 1e-6  # of theta, relative
INSIDE = 1e-10  # how far inside the cone P is kept, with P <= I


def slope_bounds(owner: str, bounds: Any, n: int, *, around_zero: bool = True) -> np.ndarray:
    """The bounds of the n slopes as an array (n, 2); ValueError for what are none."""
    found = np.asarray(bounds, float)
    if not 2 <= n <= LARGEST:
        fix = "With one state, the measured one, a larger K always does; beyond ten, corners are too many for exact proofs."
        raise refuse(owner, "bounds", f"n = {n} states", f"2 to {LARGEST}", fix)
    if found.shape != (n, 2):
        fix = f"Give n = {n} rows (lowest, highest), one for each df/dx_i."
        if found.shape == (2, n):
            fix += " They look transposed."
        raise refuse(owner, "bounds", f"shape {found.shape}", f"shape {(n, 2)}", fix)
    if not np.all(np.isfinite(found)):
        raise refuse(owner, "bounds", found.tolist(), "finite numbers", "A slope without bounds has no corners: saturate f.")
    for i, (low, high) in enumerate(found, start=1):
        if low > high:
            raise refuse(owner, "bounds", f"lowest {low:.6g} > highest {high:.6g} for x_{i}", "lowest <= highest", "Swap them.")
        if around_zero and (low > 0 or high < 0):
            fix = "Widen the pair to take in 0: the boxes for larger theta lie inside those for smaller ones only then, (28)."
            raise refuse(owner, "bounds", f"[{low:.6g}, {high:.6g}] for x_{i}", "a pair that contains 0", fix)
    return found


def require_index(owner: str, j0: Any, n: int) -> None:
    """0 <= j0 <= n, an integer: how many of the last slopes are treated by corners. ValueError, naming owner.j0, otherwise."""
    require_integer(owner, "j0", j0, 0, "It counts the last slopes that are treated by corners.")
    if j0 > n:
        raise refuse(owner, "j0", j0, f"an integer from 0 to n = {n}", "j0 = n takes all slopes by corners (LPV/LMI).")


def gain_constant(bounds: Any, j0: int, theta: float = 1.0) -> float:
    """The sharp k_j0(theta) of (18), (30): |T^-1 B Delta f_1| <= k_j0 / theta^{j0} |ehat|, rounded up;

        k_j0(theta)^2 = sum_{i <= n-j0} m_i^2 theta^{2(i-n+j0)},   m_i = max(|lowest_i|, |highest_i|).

    theta = 1 gives the constant that holds for every theta >= 1; the paper's is `triangle_constant`.
    """
    sizes = np.abs(np.asarray(bounds, float)).max(axis=1)
    last = len(sizes) - j0
    powers = np.arange(1, last + 1) - last
    return float(np.sqrt(np.sum((sizes[:last] * float(theta) ** powers) ** 2))) * (1 + 1e-14)


def triangle_constant(bounds: Any, j0: int) -> float:
    """sum_{i <= n-j0} m_i: what the triangle inequality gives for k_j0, as in section IV of paper 002."""
    sizes = np.abs(np.asarray(bounds, float)).max(axis=1)
    return float(np.sum(sizes[: len(sizes) - j0]))


def corners(bounds: Any, j0: int, sigma: float) -> np.ndarray:
    """The rows psi^sigma of (27), (2^j0, n): psi_i / sigma^{n+1-i} for the last j0 slopes, 0 for the others; their number is
    n_LMI. The first row has all the lowest slopes, the last all the highest. A slope with equal bounds has one value."""
    pairs = np.asarray(bounds, float)
    n = len(pairs)
    ends = [sorted({low, high}) for low, high in pairs[n - j0 :]]
    rows = np.array(list(itertools.product(*ends)), float).reshape(math.prod(map(len, ends)), j0)
    rows /= float(sigma) ** np.arange(j0, 0, -1)
    return np.concatenate([np.zeros((len(rows), n - j0)), rows], axis=1)


@dataclasses.dataclass(frozen=True)
class Reach:
    """lam* between two sides: `attained` by p (n, n), 0 < p <= I, and `bound` from the multipliers (corners, n, n), by

    lam* <= tr W / sum_c tr X_c,   W the positive part of -sum_c (F_c X_c + X_c F_c'),   X_c >= 0 (X_c C' = 0 for any K).
    """

    attained: float
    bound: float
    p: np.ndarray
    multipliers: np.ndarray


def error_matrices(rows: np.ndarray, gain: np.ndarray | None) -> np.ndarray:
    """A + B psi' - K C for each row, (corners, n, n); without a gain K = 0."""
    n = rows.shape[1]
    f = np.repeat(np.eye(n, k=1)[None], len(rows), axis=0)
    f[:, -1] += rows
    f[:, :, 0] -= 0.0 if gain is None else gain
    return f


def largest_lambda(rows: np.ndarray, gain: np.ndarray | None = None) -> Reach:
    """lam* at these corners, for a gain K (n,) or the best over all K.

    For all K at once only the rows and columns 2..n of the inequalities are kept: there is a K for (31) with every smaller
    lam (Finsler; one Y = mu C serves all corners), but |K| may have to grow without bound to come close.
    """
    f = error_matrices(rows, gain)
    n = rows.shape[1]
    first = 1 if gain is None else 0

    def decrease(p):
        return [-(p @ one + one.T @ p)[first:, first:] for one in f]

    size = 2 * float(np.abs(np.linalg.norm(f, axis=(1, 2))).max()) + 1
    unknowns = {"p": sdp.symmetric(n, reach=1.0), "lam": sdp.scalar(reach=size)}
    found = sdp.optimise(
        unknowns,
        lambda p, lam: [p, np.eye(n) - p, *(d - lam * np.eye(n - first) for d in decrease(p))],
        maximise=lambda p, lam: lam,
        margin=0.0,
    )
    if not found.values:
        return Reach(-np.inf, np.inf, np.eye(n), np.zeros((len(rows), n, n)))
    p = found.values["p"]
    p = (p + p.T) / 2 + (INSIDE + max(0.0, -np.linalg.eigvalsh(p)[0])) * np.eye(n)  # for all K the best P is singular
    p /= np.linalg.eigvalsh(p)[-1]
    attained = min(float(np.linalg.eigvalsh(d)[0]) for d in decrease(p))
    multipliers = np.zeros((len(rows), n, n))
    multipliers[:, first:, first:] = np.stack(found.duals[2:])
    mass = float(np.einsum("cii->", multipliers))
    bound = float(np.trace(dominating(f, multipliers))) / mass if mass > 0 else np.inf
    return Reach(attained, bound, p, multipliers)


def dominating(f: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
    """W of `Reach`: the positive part of -sum_c (F_c X_c + X_c F_c')."""
    total = np.einsum("cij,cjk->ik", f, multipliers)
    values, vectors = np.linalg.eigh(-(total + total.T))
    return (vectors * np.maximum(values, 0)) @ vectors.T


@dataclasses.dataclass(frozen=True)
class SmallestTheta:
    """theta: the smallest one that is attained, to 1e-6 or so, infinity if none was found up to 1e9. refuted: up to this theta
    (31)-(32) have no solution, by the bound of `Reach`; 0.0 where nothing is refuted (theta = 1 will do, say), infinity
    where A - K C is not Hurwitz. reach: at theta."""

    theta: float
    refuted: float
    reach: Reach | None


def smallest_theta(
    bounds: Any,
    j0: int,
    *,
    gain: Any = None,
    constant: float | None = None,
    rate: float = 0.0,
) -> SmallestTheta:
    """The smallest theta = sigma >= 1 for (31)-(32), by bisection of  theta^{1+j0} lam*(theta) = 2 (k_j0 + rate theta^{j0}).

    bounds (n, 2): rows (lowest, highest) of the slopes, 2 <= n <= 10. gain K (n,): that one; none: the infimum over all K, not
    attained (K -> infinity). constant: a k_j0, else the sharp k_j0(theta). rate [1/s] >= 0: V = ehat'P ehat is to decay like
    exp(-2 rate t). For j0 = n without a rate, theta = 1 will do for the best K, and nothing is ever `refuted`.

    ValueError for bounds of another shape, not finite or without 0, j0 outside 0..n, rate < 0 and a gain of another shape.
    Source: paper 002, theorem 3.3, (30)-(32).
    """
    n = np.shape(bounds)[0] if np.ndim(bounds) == 2 else 2
    pairs = slope_bounds("smallest_theta", bounds, n)
    require_index("smallest_theta", j0, n)
    require_nonnegative("smallest_theta", "rate", rate, "It is a decay rate in 1/s.")
    k = None if gain is None else scaled_gain("smallest_theta", gain, n)
    if k is not None and np.linalg.eigvals(error_matrices(np.zeros((1, n)), k)[0]).real.max() >= 0:
        return SmallestTheta(np.inf, np.inf, None)  # 0 lies in every box
    reached: dict[float, Reach] = {}

    def at(theta: float) -> tuple[Reach, float]:
        if theta not in reached:
            reached[theta] = largest_lambda(corners(pairs, j0, theta), k)
        own = gain_constant(pairs, j0, theta) if constant is None else constant
        needed = 2 * (own + rate * theta**j0) / theta ** (1 + j0)
        return reached[theta], needed if needed > 0 or k is None else ZERO  # at j0 = n a given K still needs lam* > 0

    def excess(log_theta: float) -> float:
        """log(lam* / needed): increases by 1 + j0 or more for each unit of log theta (by 1 with a rate); bounded for brentq."""
        reach, needed = at(math.exp(log_theta))
        return math.log(max(reach.attained, needed * math.exp(-FLOOR)) / needed) if needed > 0 else 1.0

    if (first := excess(0.0)) > 0:
        return SmallestTheta(1.0, 0.0, at(1.0)[0])
    low, high = 0.0, -first / (1 + j0)  # the edge lies below, where lam*(1) > 0
    while excess(high) < 0:
        if high >= math.log(FARTHEST):
            return SmallestTheta(np.inf, 0.0, None)
        low, high = high, min(high + max(1.0, -excess(high) / (1 + j0)), math.log(FARTHEST))
    root = float(scipy.optimize.brentq(excess, low, high, xtol=TOLERANCE / 4, rtol=1e-12))  # pyright: ignore
    above = next((t for t in _ladder(root, +1) if at(t)[0].attained > at(t)[1]), np.inf)
    below = next((t for t in _ladder(root, -1) if at(t)[0].bound < at(t)[1] != ZERO), 0.0)
    return SmallestTheta(above, below, at(above)[0] if np.isfinite(above) else None)


def _ladder(log_theta: float, sign: int):
    """Steps away from an edge that was found with rounding, each ten times longer."""
    step = TOLERANCE
    while step < 10:
        yield math.exp(max(log_theta + sign * step, 0.0))
        step *= 10


def scaled_gain(owner: str, gain: Any, n: int, field: str = "gain") -> np.ndarray:
    """A gain (n,) or (n, 1), as a vector; ValueError for what is none."""
    found = np.asarray(gain, float)
    if found.shape not in ((n,), (n, 1)):
        fix = "One entry a state; y = x_1 is the only output."
        if found.shape == (1, n):
            fix += " It looks transposed, as if L were the row C."
        raise refuse(owner, field, f"shape {found.shape}", f"shape {(n,)} or {(n, 1)}", fix)
    if not np.all(np.isfinite(found)):
        raise refuse(owner, field, found.tolist(), "finite numbers", "Remove the NaN or infinity at its origin.")
    return found.reshape(n)
