"""The worst switching that can be found among given matrices: a lower bound on how fast errors can grow."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import scipy.linalg
import scipy.optimize

LENGTHS = 20  # of the grid of durations
CANDIDATES = 64  # matrices among which is searched
PAIRS = 400  # of matrices that are tried in alternation
WORDS = 20_000  # of discrete sequences that are tried one by one
SEGMENTS = 6  # of one period in continuous time
LETTERS = 16  # of one period in discrete time
STARTS = 3  # of the local search


@dataclasses.dataclass(frozen=True)
class Switching:
    """One period of a switching: `word` (places of the matrices, in the order of time) and `durations` ([s], or steps).

    growth: log(spectral radius over the period) / period [1/s], or the spectral radius's root per step. Found by a search, so a
    lower bound on the worst; below 0 (below 1 a step) it is no proof of decay.
    """

    growth: float
    word: tuple[int, ...]
    durations: tuple[float, ...]


def worst_switching(matrices: np.ndarray, *, step: bool = False) -> Switching:
    """The fastest growth found among periodic switchings between the matrices F_k (m, n, n), the constant ones included:

        max log r(e^{F_{k_l} t_l} ... e^{F_{k_1} t_1}) / (t_1 + ... + t_l),   or with `step`   max r(F_{k_l} ... F_{k_1})^{1/l},

    r the spectral radius: lower bounds on the Lyapunov exponent [1/s], and on the joint spectral radius, of all switchings.

    Continuous time: all alternations of two matrices on a grid of durations, the best refined by Nelder and Mead, then segments
    of any matrix inserted while that helps; a matrix that grows alone is the answer at once. Discrete: all short words, the
    best changed letter by letter while that helps. Of more than 64 matrices the search takes the 32 that decay least alone, and
    32 others. Source: Daubechies and Lagarias, 1992; Jungers, The Joint Spectral Radius, 2009; Liberzon, Switching in Systems
    and Control, 2003; the search is ours.
    """
    matrices = np.asarray(matrices, float)
    alone = _radius(matrices) if step else _abscissa(matrices)
    order = np.argsort(-alone, kind="stable")
    rest = np.random.default_rng(0).permutation(order[CANDIDATES // 2 :])
    chosen = np.sort(np.concatenate([order[: CANDIDATES // 2], rest[: CANDIDATES // 2]]))
    found = _words(matrices[chosen]) if step else _durations(matrices[chosen])
    return dataclasses.replace(found, word=tuple(int(chosen[k]) for k in found.word))


def _abscissa(matrices: np.ndarray) -> Any:
    return np.max(np.linalg.eigvals(matrices).real, axis=-1)


def _radius(matrices: np.ndarray) -> Any:
    return np.max(np.abs(np.linalg.eigvals(matrices)), axis=-1)


def _durations(matrices: np.ndarray) -> Switching:
    frozen = _abscissa(matrices)
    k = int(np.argmax(frozen))
    speeds = np.abs(np.linalg.eigvals(matrices))
    fastest, slowest = max(float(np.max(speeds)), 1e-12), max(float(np.min(speeds)), 1e-6 * float(np.max(speeds)), 1e-12)
    best = Switching(float(frozen[k]), (k,), (1 / fastest,))
    if len(matrices) == 1 or best.growth > 0:
        return best
    times = np.geomspace(0.03 / fastest, 10 / slowest, LENGTHS)
    flows = np.stack([[scipy.linalg.expm(f * t) for t in times] for f in matrices])
    pairs = list(itertools.combinations(range(len(matrices)), 2))
    if len(pairs) > PAIRS:
        pairs = [pairs[i] for i in np.random.default_rng(0).choice(len(pairs), PAIRS, replace=False)]
    found = []
    for i, j in pairs:
        radius = _radius(flows[j][None, :] @ flows[i][:, None])
        rates = _log(radius) / (times[:, None] + times[None, :])
        a, b = np.unravel_index(np.argmax(rates), rates.shape)
        found.append(Switching(float(rates[a, b]), (i, j), (float(times[a]), float(times[b]))))
    for start in sorted(found, key=lambda one: -one.growth)[:STARTS]:
        best = max(best, _extended(matrices, _refined(matrices, start)), key=lambda one: one.growth)
    return best


def _log(radius: Any) -> Any:
    """The logarithm; -inf where underflow leaves no digits."""
    return np.where(radius > 1e-250, np.log(np.maximum(radius, 1e-250)), -np.inf)


def _growth(matrices: np.ndarray, word: tuple[int, ...], durations: np.ndarray) -> float:
    period = np.eye(matrices.shape[-1])
    for k, t in zip(word, durations, strict=True):
        period = scipy.linalg.expm(matrices[k] * t) @ period
    radius = float(_radius(period)) if np.all(np.isfinite(period)) else 0.0
    return float(_log(radius) / np.sum(durations))


def _refined(matrices: np.ndarray, start: Switching) -> Switching:
    """The durations moved to a local maximum of the growth."""
    if not np.isfinite(start.growth):
        return start
    scale = 1 / max(abs(start.growth), 1e-12)
    found = scipy.optimize.minimize(
        lambda logs: -scale * max(_growth(matrices, start.word, np.exp(np.clip(logs, -60, 60))), -1e6 / scale),
        np.log(start.durations),
        method="Nelder-Mead",
        options={"maxiter": 60 * len(start.word), "xatol": 1e-4, "fatol": 1e-6},
    )
    durations = np.exp(np.clip(found.x, -60, 60))
    growth = _growth(matrices, start.word, durations)
    return Switching(growth, start.word, tuple(map(float, durations))) if growth > start.growth else start


def _extended(matrices: np.ndarray, best: Switching) -> Switching:
    """With further segments, each where and of which matrix it helps most."""
    while len(best.word) < SEGMENTS:
        shortest = min(best.durations)
        trials = []
        for place, k in itertools.product(range(len(best.word) + 1), range(len(matrices))):
            word = (*best.word[:place], k, *best.word[place:])
            durations = (*best.durations[:place], shortest / 4, *best.durations[place:])
            trials.append(Switching(_growth(matrices, word, np.array(durations)), word, durations))
        chosen = max(trials, key=lambda one: one.growth)
        if chosen.growth <= best.growth + 1e-3 * abs(best.growth):
            return best
        best = _refined(matrices, chosen)
    return best


def _words(matrices: np.ndarray) -> Switching:
    count = len(matrices)
    products, words = matrices, [(k,) for k in range(count)]
    found: list[tuple[float, tuple[int, ...]]] = []
    while True:
        rates = _radius(products) ** (1 / len(words[0]))
        found += [(float(rates[i]), words[i]) for i in np.argsort(-rates)[:STARTS]]
        if count == 1 or len(words) * count > WORDS or len(words[0]) >= LETTERS:
            break
        products = (matrices[:, None] @ products[None]).reshape(-1, *matrices.shape[1:])
        words = [(*word, k) for k in range(count) for word in words]
    best = max(_changed(matrices, *one) for one in sorted(found, reverse=True)[:STARTS])
    return Switching(best[0], best[1], (1.0,) * len(best[1]))


def _changed(matrices: np.ndarray, rate: float, word: tuple[int, ...]) -> tuple[float, tuple[int, ...]]:
    """With letters replaced, inserted or left out while that makes the growth larger."""
    while True:
        letters, places = range(len(matrices)), range(len(word))
        trials = {(*word[:i], k, *word[i + 1 :]) for i in places for k in letters}
        if len(word) < LETTERS:
            trials |= {(*word[:i], k, *word[i:]) for i in places for k in letters}
        if len(word) > 1:
            trials |= {(*word[:i], *word[i + 1 :]) for i in places}
        best = max((_rate(matrices, trial), trial) for trial in sorted(trials))
        if best[0] <= rate * (1 + 1e-9):
            return rate, word
        rate, word = best


def _rate(matrices: np.ndarray, word: tuple[int, ...]) -> float:
    period = np.eye(matrices.shape[-1])
    for k in word:
        period = matrices[k] @ period
    return float(_radius(period) ** (1 / len(word)))
