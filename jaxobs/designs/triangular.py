"""A constant gain for triangular systems that every input shows: Lemma 1, then a power of theta, then the proof."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxobs._module import Numbers, dtype_of, refuse
from jaxobs.certificates import Corners
from jaxobs.designs import corner_lmi
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.lemma1 import bounds_of, lemma1
from jaxobs.designs.polytope import Polytope, as_tuples
from jaxobs.excitation import require_triangular
from jaxobs.observers import Luenberger
from jaxobs.plants import AbstractChain, AbstractTriangular

EXCESS = 1.1  # theta over the smallest certified one, when none is asked for
LARGEST_THETA = 1e9


def triangular(
    plant: AbstractTriangular | AbstractChain,
    *,
    slopes: Numbers,
    couplings: tuple[Numbers, Numbers] | None = None,
    theta: float | None = None,
    rate: float = 0.0,
    gain: Numbers | None = None,
    origin: str = "given",
) -> tuple[Luenberger, Corners]:
    """z' = f(z, u) + L (y - z_1) with L = diag(theta^i) K, K of lemma 1, and the proof of theorem 1 (paper 003, (3) and (7)).

    couplings: (lowest, highest) of each a_i(u), (n - 1,) both; left out for a chain, where they are 1. slopes: bounds of
    |dg_i/dx_j|, (n, n) lower triangular, or one number for all entries j <= i (for a chain: of its last row). theta: 1.1 times
    the smallest certified one if not given. rate [1/s]: the decay asked for. gain: K (n,) to use instead of lemma 1's.

    Infeasible if 0 is among the values of a coupling (the entry is named: then no constant gain exists), or if theta is too
    small for the slopes. ValueError for a plant that is not triangular, or bounds of the wrong shape.
    """
    if not isinstance(plant, AbstractTriangular | AbstractChain):
        fix = "Write it as a subclass of AbstractTriangular, or use jaxobs.designs.lpv_lmi."
        raise refuse("triangular", "plant", type(plant).__name__, "a triangular or a chain form", fix)
    require_triangular("triangular", plant)
    n = plant.n
    if couplings is None:
        if not isinstance(plant, AbstractChain):
            fix = "Give (lowest, highest), e.g. from jaxobs.excitation.structure or classify."
            raise refuse("triangular", "couplings", "None", "bounds of a_i(u)", fix)
        couplings = np.ones(n - 1), np.ones(n - 1)
    low, high = bounds_of(*couplings)
    if low.shape != (n - 1,):
        raise refuse("triangular", "couplings", f"shape {low.shape}", f"({n - 1},)", "One pair of bounds for each a_i.")
    bounds = _slopes(slopes, n, isinstance(plant, AbstractChain))
    lemma = lemma1(low, high)
    k, p = lemma.gain, lemma.p
    if gain is not None:
        k = np.asarray(gain, float).reshape(-1)
        if k.shape != (n,):
            raise refuse("triangular", "gain", f"shape {np.shape(gain)}", f"({n},)", "One number for each state: K of lemma 1.")
        shift = np.eye(n, k=1)[: n - 1]
        model = Polytope(np.zeros((n, n)), np.eye(n)[:, : n - 1], shift, low, high, np.eye(1, n))
        p = np.asarray(corner_lmi.prove(model, k[:, None]).p)
    weights = np.sqrt(np.outer(1 / np.diag(p), np.diag(np.linalg.inv(p))))  # both terms alike in the norm of P

    def proposed(scale: float) -> Corners:
        own = np.asarray(jnp.asarray(scale ** np.arange(1, n + 1) * k, dtype_of(plant)), float)
        return _error(low, high, bounds, own, p, weights, scale, rate, origin)

    smallest = _smallest(proposed)
    if theta is not None and not (isinstance(theta, (int, float, np.number)) and math.isfinite(theta) and theta > 0):
        raise refuse("triangular", "theta", repr(theta), "a positive number", "Leave it out to take the smallest, times 1.1.")
    if theta is None and smallest is None:
        raise Infeasible(f"no theta up to {LARGEST_THETA:g} is certified", -math.inf, "Ask for less, or give smaller slopes.")
    chosen = float(theta) if theta is not None else EXCESS * (smallest or 0.0)
    certificate = proposed(chosen)
    if not certificate.verify():
        reason = f"theta = {chosen:g} is not certified for these slopes, couplings and rate"
        change = "Give smaller slopes." if smallest is None else f"theta = {smallest:.6g} is."
        raise Infeasible(reason, chosen - (smallest or math.inf), change, best=smallest)
    return Luenberger(plant, jnp.asarray(certificate.gain, dtype_of(plant))), certificate


def _error(low, high, slopes, gain, p, weights, theta, rate, origin) -> Corners:
    """The claim on e' = (A(a) + N - L C) e: couplings a_i by corners, the |N_ij| <= slopes_ij, j <= i, by multipliers.

    With eps_i = e_i / theta^i, beta_ij = slopes_ij theta^{j-i} and weights w_ij > 0 theorem 1 of paper 003 asks for

        -(M'P + P M) - 2 rate P - sum_{j <= i} beta_ij (w_ij p_i p_i' + e_j e_j' / w_ij) > 0,

    which completes the square of Corners for T P T, T = diag(theta^-i), with tau_ij = theta^{-2i} / (beta_ij w_ij).
    """
    n = len(gain)
    i, j = np.nonzero(slopes)
    t = theta ** -np.arange(1.0, n + 1)
    identity = np.eye(n)
    taus = t[i] ** 2 / (slopes[i, j] * theta ** (j - i * 1.0) * weights[i, j])
    b, c = np.hstack([identity[:, : n - 1], identity[:, i]]), np.vstack([identity[1:], identity[j]])
    lower, upper = np.concatenate([low, -slopes[i, j]]), np.concatenate([high, slopes[i, j]])
    fields = {"a": np.zeros((n, n)), "b": b, "c": c, "lower": lower, "upper": upper, "output": identity[:1],
              "gain": gain[:, None], "p": p * np.outer(t, t), "taus": np.concatenate([np.zeros(n - 1), taus])}  # fmt: skip
    stored: dict[str, Any] = {name: as_tuples(value) for name, value in fields.items()}
    return Corners(**stored, rate=float(rate), origin=origin)


def _smallest(proposed) -> float | None:
    """The smallest certified theta, to 1e-4: larger ones are certified too, since beta_ij / theta falls with theta."""
    high = 1.0
    while not proposed(high).verify():
        high *= 4
        if high > LARGEST_THETA:
            return None
    low = high / 4
    while proposed(low).verify() and low > 1e-6:
        low, high = low / 4, low
    while high / low > 1 + 1e-4:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if proposed(middle).verify() else (middle, high)
    return high


def _slopes(slopes: Numbers, n: int, chain: bool) -> np.ndarray:
    bounds = np.asarray(slopes, float)
    if bounds.ndim == 0:
        bounds = float(bounds) * (np.outer(np.eye(n)[-1], np.ones(n)) if chain else np.tril(np.ones((n, n))))
    if bounds.shape != (n, n) or np.any(np.triu(bounds, 1)) or not np.all(np.isfinite(bounds)) or np.any(bounds < 0):
        fix = "Row i bounds |dg_i/dx_j|, zero for j > i; or give one number for all."
        raise refuse("triangular", "slopes", bounds.tolist(), f"({n}, {n}), lower triangular, finite and >= 0", fix)
    return bounds
