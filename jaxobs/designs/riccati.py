"""The high-gain observer from the chain Riccati equation, certified by condition (5) or (44)."""

import math
import sys
from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.optimize
from jaxtyping import Array

from jaxobs import hurwitz
from jaxobs._module import Numbers, as_param, dtype_of, refuse, require_integer
from jaxobs.certificates import Condition5, exact
from jaxobs.designs._chain_gain import require_alphas, require_positive, warn_large_gain
from jaxobs.designs.infeasible import Infeasible
from jaxobs.observers import HighGain, IntegralHighGain
from jaxobs.plants import AbstractChain

SLOPE = "It bounds |phi(a, u) - phi(b, u)| / |a - b| over all a, b and u."
DEFAULT_EXCESS = 1.1  # gamma over the smallest certified one, when none is asked for: leaves a decay rate


def riccati(
    plant: AbstractChain, *, lipschitz: float, alphas: Numbers | None = None, gamma: float | None = None, q: int = 0
) -> tuple[HighGain | IntegralHighGain, Condition5]:
    """Gains alphas_i gamma^i and the proof that the error decays for every phi with the Lipschitz constant `lipschitz`:

        rho < lambda_min(P^-1/2 Q P^-1/2) / (2 sqrt((P^-1)_NN lambda_max(P))),     N = n + q        (paper 000, (5) and (44)).

    alphas (n + q,), binomial if not given. gamma [1/s], 1.1 times the smallest certified one if not given. q > 0 passes the
    innovation through q integrators. What is certified are the numbers that the observer carries, in its own precision.

    Infeasible when (10) or (5) fails, with the margin, the smallest gamma that does it and what to change; ValueError for a
    plant that is no chain, a Lipschitz constant that is not positive, and what the observer refuses.
    """
    if not isinstance(plant, AbstractChain):
        raise refuse(
            "riccati", "plant", type(plant).__name__, "a plant in chain form", "Write it as a subclass of AbstractChain."
        )
    require_integer("riccati", "q", q, 0, "It counts the integrators between innovation and injection.")
    require_positive("riccati", "lipschitz", lipschitz, SLOPE)
    chosen = hurwitz.binomial(plant.n + q) if alphas is None else alphas
    draft = _observer(plant, chosen, 1.0 if gamma is None else gamma, q)
    weights = exact.chain_weights([Fraction(float(a)) for a in np.asarray(draft.alphas)])
    for i, weight in enumerate(weights, start=1):
        if weight <= 0:
            given = [float(a) for a in np.asarray(draft.alphas)]
            reason = f"riccati.alphas: given {given} with q_{i} = {float(weight):.6g}; expected all q_i > 0, (10)"
            raise Infeasible(
                reason, float(weight), "Take alphas from jaxobs.hurwitz.alphas_from_log_q: all of them satisfy (10)."
            )
    smallest = _smallest_gamma(_floats(draft.alphas), lipschitz)
    observer = draft if gamma is not None else _observer(plant, chosen, DEFAULT_EXCESS * smallest, q)
    margin = _parts(_floats(observer.alphas), float(observer.gamma))[2] - lipschitz
    certificate = _certify(observer, lipschitz, q) if margin > 0 else None
    if certificate is not None:
        warn_large_gain("riccati", np.asarray(observer.gain()))
        return observer, certificate
    name = "(5)" if q == 0 else "(44)"
    if margin > 0:
        reason = f"condition {name} holds in float64, but no float witnesses pass the exact check"
        raise Infeasible(reason, margin, "Move gamma away from the edge and from the limits of floats.", smallest)
    reason = f"condition {name} fails at gamma = {float(observer.gamma):.6g} for the Lipschitz constant {lipschitz:.6g}"
    change = f"It holds for gamma > {smallest * (1 + 1e-6):.8g}; or give a smaller Lipschitz constant if one can be proved."
    raise Infeasible(reason, margin, change, smallest)


def riccati_gamma(*, alphas: Numbers, lipschitz: float) -> float:
    """The infimum of the gamma [1/s] for which condition (5), or (44) for n + q alphas, holds; infinite where (10) fails:

        inf {gamma > 0: rho < lambda_min(P^-1/2 Q P^-1/2) / (2 sqrt((P^-1)_NN lambda_max(P)))},      P = P(gamma).

    alphas (N,), N = n + q; lipschitz: rho > 0. ValueError for alphas that are not Hurwitz, or rho <= 0.
    Source: paper 000, (5), (10), (44); the right side increases with gamma, so the root is found by Brent's method.
    """
    a = require_alphas("riccati_gamma", alphas, np.size(alphas))
    require_positive("riccati_gamma", "lipschitz", lipschitz, SLOPE)
    if min(exact.chain_weights([Fraction(x) for x in a])) <= 0:
        return math.inf
    return _smallest_gamma(a.tolist(), lipschitz)


def _floats(alphas: Array) -> list[float]:
    return [float(a) for a in np.asarray(alphas)]


def _observer(plant: AbstractChain, alphas: Numbers, gamma: Numbers, q: int) -> HighGain | IntegralHighGain:
    dtype = dtype_of(plant)
    a, g = jnp.asarray(as_param(alphas), dtype), jnp.asarray(as_param(gamma), dtype)
    return HighGain(plant, a, g) if q == 0 else IntegralHighGain(plant, a, g, q)


def _parts(alphas: list[float], gamma: float) -> tuple[float, float, float]:
    """(lambda_min(P^-1/2 Q P^-1/2), lambda_max(P) / gamma^{2N-1}, the largest certified rho), float64, scaled by D."""
    exact_alphas = [Fraction(a) for a in alphas]
    p = np.asarray(exact.chain_riccati(exact_alphas), float)
    weights = np.asarray(exact.chain_weights(exact_alphas), float)
    root = np.sqrt(weights)
    slowest = gamma / scipy.linalg.eigvalsh(p / np.outer(root, root))[-1]
    s = float(gamma) ** np.arange(1 - len(weights), 1)
    largest = scipy.linalg.eigvalsh(p * np.outer(s, s))[-1]
    corner = float(exact.inverse_corner(exact.chain_riccati(exact_alphas)))
    return slowest, largest, slowest / (2 * np.sqrt(corner * largest))


def _smallest_gamma(alphas: list[float], lipschitz: float) -> float:
    """The root in gamma of (largest certified rho) = lipschitz; the left side increases with gamma."""

    def excess(log_gamma: float) -> float:
        return np.log(_parts(alphas, float(np.exp(log_gamma)))[2] / lipschitz)

    low, high = 0.0, 0.0
    while excess(low) > 0:
        low -= 2.0
    while excess(high) < 0:
        high += 2.0
    root = scipy.optimize.brentq(excess, low, high, xtol=1e-13)
    return math.exp(float(root))  # pyright: ignore[reportArgumentType]: without full_output it is a float


def _certify(observer: HighGain | IntegralHighGain, lipschitz: float, q: int) -> Condition5 | None:
    """Witnesses a little inside the float ones: as close as the exact check accepts."""
    gamma = float(observer.gamma)
    slowest, largest, rho = _parts(_floats(observer.alphas), gamma)
    slack = min((rho / lipschitz) ** 2 - 1, 1.0) / 6
    size = len(np.asarray(observer.alphas))
    if math.log(largest) + (2 * size - 1) * math.log(gamma) > math.log(sys.float_info.max) - 1:
        return None  # nu is no float
    for relative in (1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-2):
        inside = min(relative, slack)
        certificate = Condition5(
            alphas=tuple(float(a) for a in np.asarray(observer.alphas)),
            gamma=gamma,
            lipschitz=float(lipschitz),
            n=size - q,
            q=q,
            mu=float(slowest * (1 - inside)),
            nu=float(largest * gamma ** (2 * size - 1) * (1 + inside)),
        )
        if certificate.verify():
            return certificate
    return None
