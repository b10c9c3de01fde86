"""Sums, products and quotients with the sign of their rounding error, so that exact results are not widened.

a + b = s + e (Knuth's TwoSum) and a b = p + e (Dekker's TwoProduct with Veltkamp's splitting) hold exactly in round to
nearest as long as nothing overflows or underflows. An error that is not known is NaN, which rounds outward.
"""

from typing import Any, TypeAlias

import numpy as np

Numbers: TypeAlias = np.ndarray | np.floating[Any]  # NumPy makes scalars of arrays without axes
Truths: TypeAlias = np.ndarray | np.bool_

_SPLITTER = 2.0**27 + 1
_SMALL, _LARGE = 2.0**-450, 2.0**450  # products of factors between the two neither overflow nor lose their error
_MAX = np.finfo(
    np.float64
).max  # unless the first summand is this large, no step overflows before the sum does (Boldo et al. 2017)


def down(value: Numbers, error: Numbers) -> Numbers:
    """The largest float known to be <= value + error."""
    return np.where(error >= 0, value, np.nextafter(value, -np.inf))


def up(value: Numbers, error: Numbers) -> Numbers:
    """The least float known to be >= value + error."""
    return np.where(error <= 0, value, np.nextafter(value, np.inf))


def two_sum(a: Numbers, b: Numbers) -> tuple[Numbers, Numbers]:
    """a + b = s + e; s is NaN for inf - inf, e is NaN where something is infinite."""
    s = a + b
    c = s - a
    e = (a - (s - c)) + (b - c)
    return s, np.where(np.abs(a) < _MAX, e, np.nan)


def two_product(a: Numbers, b: Numbers) -> tuple[Numbers, Numbers]:
    """a b = p + e, with 0 times anything, infinity included, exactly 0."""
    p = a * b
    (a1, a2), (b1, b2) = _split(a), _split(b)
    e = ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2
    zero = (a == 0) | (b == 0)
    return np.where(zero, 0.0, p), np.where(zero, 0.0, np.where(_safe(a) & _safe(b), e, np.nan))


def quotient(a: Numbers, b: Numbers) -> tuple[Numbers, Numbers]:
    """a / b = q + e up to the size of e, of which only the sign is used; 0 / b = 0 exactly, inf / inf is taken as 0."""
    q = a / b
    p, e = two_product(q, b)
    left = ((a - p) - e) * np.sign(b)  # q b is within a rounding of a, so a - p is exact (Sterbenz)
    # An infinite denominator stands for a limit that is not reached; its quotient is exactly 0.
    zero = (a == 0) | np.isinf(b)
    known = _safe(a) & _safe(q) & _safe(b)
    return np.where(zero, 0.0, q), np.where(zero, 0.0, np.where(known, left, np.nan))


def root(a: Numbers) -> tuple[Numbers, Numbers]:
    """sqrt(a) = r + e up to the size of e; the square root of IEEE 754 is rounded to nearest."""
    r = np.sqrt(a)
    p, e = two_product(r, r)
    left = (a - p) - e
    return r, np.where(a == 0, 0.0, np.where(_safe(a) & _safe(r), left, np.nan))


def _split(a: Numbers) -> tuple[Numbers, Numbers]:
    c = _SPLITTER * a
    high = c - (c - a)
    return high, a - high


def _safe(a: Numbers) -> Truths:
    return (np.abs(a) > _SMALL) & (np.abs(a) < _LARGE)
