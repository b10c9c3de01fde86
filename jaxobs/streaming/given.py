"""What a runner is given, checked: times, measurements, inputs, observers."""

import math
from typing import Any

import numpy as np

from jaxobs._module import check, is_real, refuse, require_instance
from jaxobs.observers import AbstractFlowObserver, AbstractStepObserver


def require_observer(owner: str, observer: Any) -> None:
    """A flow or a step observer, whose numbers fit together."""
    kinds = AbstractFlowObserver | AbstractStepObserver
    require_instance(owner, "observer", observer, kinds, "A design returns (observer, certificate): give the first.")
    check(observer)


def seconds(owner: str, field: str, value: Any) -> float:
    """A finite number. ValueError for anything else, dates too."""
    if type(value) is float and math.isfinite(value):  # as nearly always: the rest is slow
        return value
    found = _array(owner, field, value)
    if found.ndim or not is_real(found.dtype) or not math.isfinite(float(found)):
        raise refuse(owner, field, repr(value), "a finite number of seconds", "For dates: t.timestamp().")
    return float(found)


def period(owner: str, field: str, value: Any) -> float:
    """A positive number of seconds."""
    found = seconds(owner, field, value)
    if found <= 0:
        raise refuse(owner, field, repr(value), "a positive number of seconds", "It is the time between two samples.")
    return found


def measured(owner: str, y: Any, p: int, dtype: np.dtype) -> np.ndarray:
    """(p,), NaN where it is None or not finite: lost."""
    if y is None:
        return np.full(p, np.nan, dtype)
    found = _vector(owner, "y", y, p, dtype)
    lost = ~np.isfinite(found)
    if lost.any():
        found[lost] = np.nan
    return found


def driven(owner: str, u: Any, m: int, dtype: np.dtype) -> np.ndarray:
    """(m,), finite; to be left out if m = 0."""
    if u is None:
        if m == 0:
            return np.zeros(0, dtype)
        raise refuse(owner, "u", "None", f"({m},): the input from this sample on", "Zeros if it was zero.")
    found = _vector(owner, "u", u, m, dtype)
    if not np.isfinite(found).all():
        raise refuse(owner, "u", found, "finite inputs", "An input must be known at every sample.")
    return found


def _vector(owner: str, field: str, value: Any, width: int, dtype: np.dtype) -> np.ndarray:
    """A copy: the caller may reuse its buffer."""
    array = _array(owner, field, value)
    if array.dtype.kind not in "fiub" and not is_real(array.dtype):
        raise refuse(owner, field, f"dtype {array.dtype}", "real numbers", "Real and imaginary parts make two outputs.")
    if array.ndim == 0 and width == 1:
        array = array.reshape(1)
    if array.shape != (width,):
        raise refuse(owner, field, f"shape {array.shape}", f"({width},)", "Give one number for each, of one sample.")
    return np.array(array, dtype)


def _array(owner: str, field: str, value: Any) -> np.ndarray:
    try:
        return np.asarray(value)
    except ValueError as error:  # a ragged list
        raise refuse(owner, field, repr(value), "numbers", f"NumPy says: {error}") from error
