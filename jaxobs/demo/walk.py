"""The recorded walk: the shank's angle in, its rate out, checked against a gyroscope that no observer sees at run time.

Three blocks in time. The first half trains; the next quarter chooses between methods; the last quarter is looked at once, in
the final table. Every estimate is causal but for the one row that says so.
"""

import dataclasses
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.signal

from jaxobs._observe import observe
from jaxobs.datasets import Walk, shank_walk
from jaxobs.demo.walk_candidates import DT, Candidate, backward_difference, candidates
from jaxobs.demo.walk_references import references
from jaxobs.observers import Observer
from jaxobs.tuning import descend

TRAIN = slice(200, 1756)  # the first 200 samples, standing and starting up, are left out
CHOOSE = slice(1756, 2634)
LAST = slice(2634, 3511)
SECOND_HALF = slice(1756, 3511)


@dataclasses.dataclass(frozen=True)
class Row:
    """One line of the table. RMSE of the rate in rad/s on each block; `rmse` is that of the last quarter, with its interval.

    free: the number of tuned parameters. delay_ms: the shift that fits the gyroscope best. noise_gain: rad/s of rate per rad of
    added white noise. seconds: tuning time.
    """

    name: str
    kind: str  # "observer", "reference" or "off-line"
    tuned: str  # "gyroscope", "innovation" or "none"
    parameters: str
    free: int
    rmse: float
    rmse_low: float
    rmse_high: float
    rmse_train: float
    rmse_choose: float
    rmse_second_half: float
    delay_ms: float
    noise_gain: float
    seconds: float


class Entry(NamedTuple):
    """A tuned competitor: the filter from the angle to the rate, and what the table says of it."""

    kind: str
    tuned: str
    name: str
    parameters: str
    free: int
    seconds: float
    filter: Callable[[np.ndarray], np.ndarray]


class WalkStudy(NamedTuple):
    """The rows, the estimated rate of each, and the observer with the least error on the choosing block."""

    walk: Walk
    rows: list[Row]
    rates: list[np.ndarray]
    chosen: Row


def study_walk(*, quick: bool = False, progress: Callable[[str], None] = lambda done: None) -> WalkStudy:
    """Tunes every candidate on the training block and looks at each once. `quick` takes a tenth of the steps (for tests).

    Needs float64 (jax_enable_x64): the gains spread over decades.
    """
    if not jax.config.read("jax_enable_x64"):
        raise ValueError("study_walk: given float32; expected float64. Call jax.config.update('jax_enable_x64', True) first.")
    walk = shank_walk()
    entries = [Entry("observer", "none", "backward difference", "", 0, 0.0, rate_of(backward_difference()))]
    for ref in references(walk.angle, walk.rate, DT, TRAIN):
        kind = "off-line" if "off-line" in ref.name else "reference"
        entries.append(Entry(kind, "gyroscope", ref.name, ref.parameters, ref.free, 0.0, ref.filter))
        progress(ref.name)
    with ThreadPoolExecutor(2) as pool:  # compiling and loops this small keep one core busy each
        for tuned in pool.map(lambda candidate: _tune(candidate, walk, quick), candidates(tones(walk.angle[TRAIN]))):
            entries += tuned
            progress(tuned[0].name)
        rates = list(pool.map(lambda entry: entry.filter(walk.angle), entries))
        rows = list(pool.map(lambda entry, rate: row_of(walk, entry, rate), entries, rates))
    chosen = min((row for row in rows if row.kind == "observer"), key=lambda row: row.rmse_choose)
    return WalkStudy(walk, rows, rates, chosen)


def _tune(candidate: Candidate, walk: Walk, quick: bool) -> list[Entry]:
    """Every start descends twice side by side: against the gyroscope, and without it (innovation likelihood)."""
    begin = time.perf_counter()
    ts, y, rate = (jnp.asarray(a[: TRAIN.stop]) for a in walk)

    def loss(theta, with_gyroscope):
        est = observe(candidate.make(theta), ts, y, xhat0=_start(candidate.make(theta).n, y[0]))
        against = jnp.sqrt(jnp.mean((est.xhat[TRAIN, 1] - rate[TRAIN]) ** 2))
        # The Gaussian likelihood of the innovations, their variance concentrated out.
        likelihood = jnp.log(jnp.mean(est.innovation[TRAIN] ** 2)) / 2
        return jnp.where(with_gyroscope, against, likelihood) + candidate.penalty(theta)

    count = jax.tree.leaves(candidate.starts)[0].shape[0]
    both = jax.tree.map(lambda a: jnp.concatenate([jnp.asarray(a)] * 2), candidate.starts)
    modes = jnp.arange(2 * count) < count
    found = descend(loss, both, modes, steps=candidate.steps // 10 if quick else candidate.steps, rate=candidate.rate)
    entries = []
    for tuned, lanes in (("gyroscope", slice(0, count)), ("innovation", slice(count, None))):
        best = lanes.start + int(jnp.argmin(found.value[lanes]))
        observer = candidate.make(jax.tree.map(lambda a, best=best: a[best], found.theta))
        seconds = time.perf_counter() - begin
        about = (candidate.name, candidate.parameters, candidate.free)
        entries.append(Entry("observer", tuned, *about, seconds, rate_of(observer)))
    return entries


def _start(n: int, y0: Any) -> Any:
    return jnp.zeros((n,)).at[0].set(y0)


def rate_of(observer: Observer) -> Callable[[np.ndarray], np.ndarray]:
    """The filter from the angle to the rate that an observer is."""
    ts = shank_walk().ts
    return lambda y: np.asarray(observe(observer, ts[: len(y)], y, xhat0=_start(observer.n, y[0])).xhat[:, 1])


def row_of(walk: Walk, entry: Entry, rate: np.ndarray) -> Row:
    """The line of the table for a filter whose estimate of the record is `rate`."""
    error = rate - walk.rate
    low, high = block_bootstrap(error[LAST], stride(walk.rate[TRAIN]))
    small = 1e-4 * np.random.default_rng(0).normal(size=len(walk.angle))
    moved = (entry.filter(walk.angle + small) - rate)[CHOOSE]
    return Row(
        **{name: value for name, value in entry._asdict().items() if name != "filter"},
        rmse=rms(error[LAST]),
        rmse_low=low,
        rmse_high=high,
        rmse_train=rms(error[TRAIN]),
        rmse_choose=rms(error[CHOOSE]),
        rmse_second_half=rms(error[SECOND_HALF]),
        delay_ms=1e3 * delay(rate[SECOND_HALF], walk.rate[SECOND_HALF]),
        noise_gain=rms(moved) / 1e-4,
    )


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


def stride(rate: np.ndarray) -> int:
    """Samples in a stride: where the rate resembles itself best, between half a second and two."""
    centred = rate - rate.mean()
    lags = np.arange(60, 240)
    return int(lags[np.argmax([np.mean(centred[lag:] * centred[:-lag]) for lag in lags])])


def tones(angle: np.ndarray, count: int = 3) -> tuple[float, ...]:
    """The lines [Hz], above 15 and 4 apart, that stand out most in the angle's spectrum: starts for the tuning."""
    frequency, power = scipy.signal.welch(angle, fs=1 / DT, nperseg=600)
    prominence = power / scipy.signal.medfilt(power, 61)
    peaks = [i for i in scipy.signal.find_peaks(prominence, distance=20)[0] if frequency[i] > 15]
    return tuple(float(frequency[i]) for i in sorted(peaks, key=lambda i: -prominence[i])[:count])


def resampled(errors: np.ndarray, block: int, draws: int = 2000) -> np.ndarray:
    """RMS of each column over circular blocks drawn with replacement, (draws, columns): the same blocks for every column."""
    rng = np.random.default_rng(0)
    count = len(errors)
    starts = rng.integers(count, size=(draws, -(-count // block)))
    index = (starts[:, :, None] + np.arange(block)).reshape(draws, -1)[:, :count] % count
    return np.sqrt(np.mean(errors[index] ** 2, axis=1))


def block_bootstrap(error: np.ndarray, block: int) -> tuple[float, float]:
    """A 95 % interval of the RMSE by blocks of one stride: errors within a stride are not independent."""
    low, high = np.quantile(resampled(error[:, None], block)[:, 0], [0.025, 0.975])
    return float(low), float(high)


def paired_change(study: WalkStudy, row: Row, against: Row) -> tuple[float, float, float]:
    """The relative change of the RMSE on the last quarter and its 95 % interval, both rows on the same blocks."""
    pair = [study.rates[study.rows.index(r)][LAST] - study.walk.rate[LAST] for r in (row, against)]
    drawn = resampled(np.stack(pair, axis=1), stride(study.walk.rate[TRAIN]))
    low, high = np.quantile(drawn[:, 0] / drawn[:, 1] - 1, [0.025, 0.975])
    return row.rmse / against.rmse - 1, float(low), float(high)


def delay(estimate: np.ndarray, truth: np.ndarray, most: int = 12, finer: int = 20) -> float:
    """The shift [s] of the estimate that minimises its distance to the truth, on a grid of a twentieth of a sample; NaN if it
    lies at the end of the range, 12 samples."""
    fine_truth = scipy.signal.resample_poly(truth, finer, 1)[: (len(truth) - 1) * finer + 1]
    inner = np.arange(most, len(estimate) - most)
    shifts = np.arange(-most * finer, most * finer + 1)
    errors = [np.mean((estimate[inner] - fine_truth[inner * finer - shift]) ** 2) for shift in shifts]
    best = int(np.argmin(errors))
    return float(shifts[best] / finer * DT) if 0 < best < len(shifts) - 1 else float("nan")
