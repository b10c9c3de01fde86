"""Gains of chain observers on the host: their Riccati metric, and what a gain of unusual size is told."""

import warnings
from fractions import Fraction
from typing import Any

import numpy as np

from jaxobs import hurwitz
from jaxobs._module import Numbers, refuse
from jaxobs.certificates import exact
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.norm_bounded import NormBounded
from jaxobs.designs.polytope import as_tuples

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


def chain_error(gain: np.ndarray, *, slope: NormBounded | None = None, q: int = 0, dt: float | None = None) -> dict[str, Any]:
    """The fields of a Corners certificate for e' = (A - L C + M Delta N) e behind q integrators; with dt those of StepCorners,
    for e+ = (I + dt A - L C + dt M Delta N) e, dt M rounded away from zero."""
    size = len(gain)
    a = np.eye(size, k=1) if dt is None else np.eye(size) + dt * np.eye(size, k=1)
    none = np.zeros((size, 0))
    fields = {"a": a, "b": none, "c": none.T, "output": np.eye(1, size), "gain": np.asarray(gain, float)[:, None]}
    if slope is not None:
        m, n = slope.behind(q)
        fields["left"] = m if dt is None else np.where(m == 0, 0.0, np.nextafter(dt * m, np.copysign(np.inf, m)))
        fields["right"] = n
    return {name: as_tuples(value) for name, value in fields.items()} | {"lower": (), "upper": ()}
