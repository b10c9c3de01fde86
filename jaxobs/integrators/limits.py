"""How far explicit steps may go: the linear stability limit, said before a run is lost to it."""

import math
import warnings
from typing import Any

import numpy as np

from jaxobs._module import Module, concrete

BISECTIONS = 60


class UnstableStep(UserWarning):
    """An explicit step too long for the linear part of an observer's error: it grows, whatever the observer's proof says."""


def largest_step(poles: np.ndarray, order: int) -> float:
    """The largest h with |R(h s)| <= 1 at all poles s with Re s < 0, R(z) = sum_{k <= order} z^k / k!; infinite without any.

    R is the stability function of the explicit methods whose order equals their number of stages: Euler (1) and RK4 (4).
    """
    stable = np.asarray(poles, complex)[np.real(poles) < 0]
    if not stable.size:
        return math.inf
    low, high = 0.0, 4 * order / float(np.min(np.abs(stable)))
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if is_stable(poles, middle, order) else (low, middle)
    return low


def is_stable(poles: np.ndarray, step: float, order: int) -> bool:
    """Whether |R(h s)| <= 1 at all poles s with Re s < 0, h = step."""
    stable = np.asarray(poles, complex)[np.real(poles) < 0]
    coefficients = [1 / math.factorial(k) for k in range(order, -1, -1)]
    # An error of rounding above 1 is what the neighbourhood of h = 0 has.
    return bool(np.all(np.abs(np.polyval(coefficients, step * stable)) <= 1 + 1e-12))


def warn_step(owner: str, part: Module, integrator: Any, dt: Any) -> None:
    """Warns when an explicit method meets a part whose `error_poles()` are beyond it, where all values are concrete."""
    poles, order, step = getattr(part, "error_poles", None), integrator.stability_order, concrete(dt)
    if poles is None or order is None or step is None or (known := poles()) is None:
        return
    substeps = getattr(integrator, "substeps", 1)
    if is_stable(known, float(step) / substeps, order):
        return
    longest = largest_step(known, order)
    if float(step) / substeps > longest * (1 + 1e-6):
        name, need = type(integrator).__name__, math.ceil(float(step) / longest)
        given = f"{owner}: steps of {float(step) / substeps:.4g} s by {name} for {type(part).__name__}"
        fix = f"Take {name}(substeps={need}) or more, or jaxobs.integrators.Exponential()."
        limit = f"the linear part of its error is stable below {longest:.4g} s"
        warnings.warn(f"{given}; {limit}. {fix}", UnstableStep, stacklevel=4)
