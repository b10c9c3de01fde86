"""Root mean squares over seeds, and ratios of them over the same seeds, with intervals."""

from typing import NamedTuple

import numpy as np
import scipy.stats
from jaxtyping import Float

LEVEL = 0.95


class Interval(NamedTuple):
    value: float
    low: float
    high: float


NOTHING = Interval(np.nan, np.nan, np.nan)


def root_mean_square(squares: Float[np.ndarray, " S"]) -> Interval:
    """R = sqrt(mean_s m_s) of one mean square m_s a seed, and R exp(-+ t se), se that of the mean of m_s / (2 R^2).

    Student's t with S - 1 degrees of freedom, on log R by the delta method. One seed alone has no interval.
    """
    if len(squares) == 0:
        return NOTHING
    level = float(np.mean(squares))
    return _interval(np.sqrt(level), squares / (2 * level) if level > 0 else np.zeros(len(squares)))


def relative_change(squares: Float[np.ndarray, " S"], reference: Float[np.ndarray, " S"]) -> Interval:
    """R / R_0 - 1, both over the same seeds: t on log(R / R_0), from the mean of m_s / (2 R^2) - m_0s / (2 R_0^2)."""
    if len(squares) == 0 or not np.mean(reference) > 0 or not np.mean(squares) > 0:
        return NOTHING
    level, first = np.mean(squares), np.mean(reference)
    found = _interval(np.sqrt(level / first), squares / (2 * level) - reference / (2 * first))
    return Interval(*(one - 1 for one in found))


def _interval(value: float, influence: np.ndarray) -> Interval:
    """value exp(-+ t se): the influence of each seed on log value gives the standard error."""
    count = len(influence)
    if count < 2:
        return Interval(float(value), np.nan, np.nan)
    half = scipy.stats.t.ppf((1 + LEVEL) / 2, count - 1) * np.std(influence, ddof=1) / np.sqrt(count)
    return Interval(float(value), float(value * np.exp(-half)), float(value * np.exp(half)))
