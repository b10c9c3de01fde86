"""Gains of chain observers on the host: their Riccati metric, and what a gain of unusual size is told."""

import warnings
from fractions import Fraction

import numpy as np

from jaxobs import hurwitz
from jaxobs._module import Numbers, refuse
from jaxobs.certificates import exact
from jaxobs.designs.infeasible import Infeasible

LARGEST_GAIN = 1e6


class LargeGain(UserWarning):
    """A gain above 1e6: exact in theory, but measurement noise is multiplied by it, and explicit steps have to be tiny."""


LESS = "lower gamma, or ask a less demanding certificate (jaxobs.designs.ladder)"


def warn_large_gain(owner: str, gain: np.ndarray, fix: str = LESS) -> None:
    """Says so when an entry of the gain exceeds 1e6; fix: what makes it smaller."""
    largest = float(np.max(np.abs(gain)))
    if largest > LARGEST_GAIN:
        given = f"{owner}: a gain of {largest:.3g}, above the limit of {LARGEST_GAIN:.0e}"
        warnings.warn(f"{given}. Noise is multiplied by it; {fix}.", LargeGain, stacklevel=3)


def require_alphas(owner: str, alphas: Numbers, count: int) -> np.ndarray:
    """The coefficients as floats: `count` of them, of a Hurwitz polynomial."""
    a, fix = np.asarray(alphas, float), f"Try jaxobs.hurwitz.binomial({count})."
    if a.shape != (count,):
        raise refuse(owner, "alphas", f"shape {a.shape}", f"shape ({count},): n + q coefficients", fix)
    if not (np.all(np.isfinite(a)) and hurwitz.is_hurwitz(a)):
        raise refuse(owner, "alphas", a.tolist(), "a Hurwitz polynomial", fix)
    return a


def require_positive(owner: str, field: str, value: object, fix: str) -> None:
    """A positive number on the host."""
    if not (isinstance(value, (int, float, np.number)) and np.isfinite(value) and value > 0):
        raise refuse(owner, field, repr(value), "a positive number", fix)


def metric(owner: str, alphas: np.ndarray) -> np.ndarray:
    """P~ of the chain Riccati equation, positive definite; Infeasible where (10) fails."""
    given = [Fraction(float(a)) for a in alphas]
    for i, weight in enumerate(exact.chain_weights(given), start=1):
        if weight <= 0:
            listed = [float(a) for a in alphas]
            reason = f"{owner}.alphas: given {listed} with q_{i} = {float(weight):.6g}; expected all q_i > 0, (10)"
            change = "Take alphas from jaxobs.hurwitz.alphas_from_log_q: all of them satisfy (10)."
            raise Infeasible(reason, float(weight), change)
    return np.asarray(exact.chain_riccati(given), float)


def as_rows(x: np.ndarray) -> tuple[tuple[float, ...], ...]:
    """A matrix as a certificate stores it."""
    return tuple(tuple(float(entry) for entry in row) for row in x)
