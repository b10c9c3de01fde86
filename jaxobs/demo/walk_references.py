"""What a signal-processing user would reach for instead: filters of the recorded angle, tuned on the same training block."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import scipy.signal


class Reference(NamedTuple):
    """A filter from the angle to the rate."""

    name: str
    parameters: str
    free: int
    filter: Callable[[np.ndarray], np.ndarray]


def references(y: np.ndarray, rate: np.ndarray, dt: float, train: slice) -> Iterator[Reference]:
    """Each family at its best on the training block (RMSE against the gyroscope)."""

    def loss(candidate: Reference) -> float:
        return float(np.mean((candidate.filter(y)[train] - rate[train]) ** 2))

    yield min((butterworth(order, cut, dt) for order in (1, 2, 3, 4) for cut in np.geomspace(3.0, 50.0, 30)), key=loss)
    for taps in (10, 80):
        yield least_squares_fir(taps, y, rate, train)
    yield min((savitzky_golay(w, k, dt) for k in (2, 3, 4) for w in range(2 * (k // 2) + 3, 41, 2)), key=loss)


def butterworth(order: int, cut: float, dt: float) -> Reference:
    """A causal Butterworth low-pass (cut in Hz), then the backward difference."""
    sections = scipy.signal.butter(order, cut, fs=1 / dt, output="sos")

    def apply(y: np.ndarray) -> np.ndarray:
        smooth = np.asarray(scipy.signal.sosfilt(sections, y, zi=scipy.signal.sosfilt_zi(sections) * y[0])[0])
        return np.diff(smooth, prepend=smooth[0]) / dt

    return Reference("causal Butterworth + difference", f"order {order}, {cut:.3g} Hz", 2, apply)


def least_squares_fir(taps: int, y: np.ndarray, rate: np.ndarray, train: slice) -> Reference:
    """The causal FIR filter of the last `taps` samples that fits the gyroscope best on the training block."""

    def regressors(y: np.ndarray) -> np.ndarray:
        padded = np.concatenate([np.full(taps - 1, y[0]), y])
        return np.column_stack([np.lib.stride_tricks.sliding_window_view(padded, taps), np.ones_like(y)])

    coefficients = np.linalg.lstsq(regressors(y)[train], rate[train], rcond=None)[0]
    return Reference(
        f"causal least-squares FIR, {taps} taps", f"{taps} taps, offset", taps + 1, lambda y: regressors(y) @ coefficients
    )


def savitzky_golay(window: int, degree: int, dt: float) -> Reference:
    """A local polynomial on both sides of the sample: not causal, for orientation."""
    return Reference(
        "Savitzky–Golay (off-line)",
        f"window {window}, degree {degree}",
        2,
        lambda y: np.asarray(scipy.signal.savgol_filter(y, window, degree, deriv=1, delta=dt)),
    )
