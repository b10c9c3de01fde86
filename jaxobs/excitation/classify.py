"""Is an input rich enough for an observer? The conditions of paper 003, measured on a grid of times and rates."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.excitation.gramian import Gramians, Pair, fading_gramians, pair_of, window_gramians
from jaxobs.plants import AbstractFlowPlant
from jaxobs.signals import AbstractSignal

FINENESS = 2  # grid times in 1/theta
ZOOMS, ZOOM_POINTS = 8, 8  # the worst time is refined by 4^8, unless nothing moves any more
SETTLED = 1e-6  # relative change of a worst value that ends its refinement
FLAT = 0.25  # a power of theta that is still called bounded: the powers that occur are multiples of 1
LASTING = 0.5  # how much of a lower bound the second half of the horizon must keep


@dataclasses.dataclass(frozen=True)
class Figure:
    """One figure of merit: its worst value for each theta (r,), when it occurs (r,), and the worst in each half of the horizon,
    (r, 2)."""

    worst: np.ndarray
    at: np.ndarray
    halves: np.ndarray

    def power(self, thetas: np.ndarray) -> float:
        """The slope of log worst over log theta at the largest three thetas; NaN where it is 0 or infinite."""
        with np.errstate(all="ignore"):
            return float(np.polyfit(np.log(thetas[-3:]), np.log(self.worst[-3:]), 1)[0])

    def lasts(self, lower: bool) -> bool:
        """Whether the second half of the horizon is about as good as the first."""
        first, second = self.halves.T
        return bool(np.all(second >= LASTING * first) if lower else np.all(second <= first / LASTING))


@dataclasses.dataclass(frozen=True)
class Excitation:
    """What `classify` measured: on `count` times in the horizon (t_0, T) [s] and at the rates thetas (r,) [1/s].

    regularity: min_t lambda_min(Delta G(t - 1/theta, t) Delta) / theta, the alpha of (11). alpha: max_t of the least alpha with
    Gamma <= alpha Psi, definition 2 i). gamma: max_t of |Gamma_jj^-1| |Gamma_ii|, ii). floor: min_t lambda_min(Psi), iii).
    lower, upper: the values of a_i(u(t)), as `designs.triangular` takes them; lowest: of |a_i(u(t))|; all (n - 1,), empty
    where A(u) has entries elsewhere than above its diagonal.
    """

    thetas: np.ndarray
    horizon: tuple[float, float]
    count: int
    regularity: Figure
    alpha: Figure
    gamma: Figure
    floor: Figure
    lower: np.ndarray
    upper: np.ndarray
    lowest: np.ndarray

    @property
    def sign_changes(self) -> np.ndarray:
        """Whether a_i changes its sign, (n - 1,)."""
        return (self.lower < 0) & (self.upper > 0)

    @property
    def locally_regular(self) -> bool:
        """Definition 1: `regularity` is positive, does not fall with theta, and lasts."""
        good = bool(np.all(self.regularity.worst > 0)) and self.regularity.power(self.thetas) > -2 * FLAT
        return good and self.regularity.lasts(lower=True)

    @property
    def comparable(self) -> bool:
        """Definition 2 i): alpha(theta) / theta falls."""
        good = bool(np.all(np.isfinite(self.alpha.worst))) and self.alpha.power(self.thetas) < 1 - FLAT
        return good and self.alpha.lasts(lower=False)

    @property
    def ordered(self) -> bool:
        """Definition 2 ii): gamma is bounded, uniformly in theta."""
        good = bool(np.all(np.isfinite(self.gamma.worst))) and self.gamma.power(self.thetas) < FLAT
        return good and self.gamma.lasts(lower=False)

    @property
    def lasting(self) -> bool:
        """iii) Psi(t, theta) >= c(theta) I with c > 0: without it the observer may lose the state (it is not in the print)."""
        return bool(np.all(self.floor.worst > 0)) and self.floor.lasts(lower=True)

    @property
    def strongly_persistent(self) -> bool:
        """Definition 2 as printed: i) and ii)."""
        return self.comparable and self.ordered

    @property
    def persistent(self) -> bool:
        """i), ii) and iii): what theorem 3 needs."""
        return self.strongly_persistent and self.lasting

    @property
    def constant_gain(self) -> bool:
        """Proposition 1: locally regular, and every a_i(u(t)) away from zero with one sign, so a constant gain will do."""
        apart = self.lowest.size > 0 and bool(np.all(self.lowest > 0)) and not np.any(self.sign_changes)
        return self.locally_regular and apart

    @property
    def why(self) -> str:
        """The verdicts with their figures at the largest theta, and what they rest on."""
        top = f"at theta = {self.thetas[-1]:g}"
        parts = [
            _said("locally regular", self.locally_regular, "alpha", self.regularity, self.thetas, top),
            _said("i)", self.comparable, "alpha(theta)", self.alpha, self.thetas, top),
            _said("ii)", self.ordered, "gamma", self.gamma, self.thetas, top),
            _said("iii)", self.lasting, "c(theta)", self.floor, self.thetas, top),
        ]
        if np.any(self.sign_changes):
            parts.append(f"the coupling a_{int(np.argmax(self.sign_changes)) + 1} changes its sign")
        rates = ", ".join(f"{theta:g}" for theta in self.thetas)
        where = f"{self.count} times in [{self.horizon[0]:g}, {self.horizon[1]:g}] s and theta in {{{rates}}} 1/s"
        return "; ".join(parts) + f". Seen at {where}: a finite grid proves nothing."


def classify(
    plant: AbstractFlowPlant,
    u: AbstractSignal | Callable[[float], Any],
    *,
    horizon: tuple[float, float],
    thetas: Sequence[float] | np.ndarray = (4.0, 8.0, 16.0, 32.0),
    breaks: Sequence[float] | np.ndarray = (),
) -> Excitation:
    """Local regularity (11) and strong persistence (definition 2, i) and ii), and the missing iii)) of an input for a plant.

    u: a signal, or a function of t (one number for m = 1). horizon (t_0, T) [s]: the times looked at; Psi starts at 0, and both
    halves should show what the input does (two periods of a periodic one). thetas [1/s]: three at least, increasing; large
    beside |A(u)|. breaks: the times at which u jumps or has a corner, so that no panel straddles them. Worst times are refined.

    What is bounded and what grows is judged by powers of theta and by the two halves of the horizon; a finite grid proves
    nothing, and the result says which grid it was. ValueError for a plant without (A(u), C), or arguments out of order.
    """
    rates = np.asarray(thetas, float)
    begin, end = (float(t) for t in horizon)
    if rates.ndim != 1 or len(rates) < 3 or not np.all(np.isfinite(rates)) or np.any(np.diff(rates, prepend=0.0) <= 0):
        raise refuse("classify", "thetas", list(thetas), "three or more positive, increasing rates", "E.g. (4, 8, 16, 32).")
    if not 1 / rates[0] <= begin < end < np.inf:
        expected = f"1/theta <= t_0 < T, with 1/theta = {1 / rates[0]:g} for the smallest theta"
        raise refuse("classify", "horizon", horizon, expected, "(11) looks back by 1/theta, and Psi starts at 0.")
    pair = pair_of("classify", plant, u)
    cuts = np.unique(np.asarray(breaks, float))
    grid = np.linspace(0, end, int(np.ceil(end * rates[-1] * FINENESS)) + 1)
    grid = np.unique(np.concatenate([grid, [begin], cuts[(cuts > 0) & (cuts < end)]]))
    gramians = fading_gramians(pair, grid, rates)
    seen = np.flatnonzero(grid >= begin)
    figures = [
        _refined(pair, gramians, measure, seen, cuts, sign)
        for measure, sign in ((Gramians.coupling, 1), (Gramians.spread, 1), (Gramians.smallest, -1))
    ]
    alpha, gamma, floor = figures
    regularity = _stacked([_window_figure(pair, grid[seen], theta, cuts) for theta in rates])
    return Excitation(rates, (begin, end), len(seen), regularity, alpha, gamma, floor, *_couplings(pair, grid[seen]))


def _said(name: str, holds: bool, symbol: str, figure: Figure, thetas: np.ndarray, top: str) -> str:
    first, second = figure.halves[-1]
    power = figure.power(thetas)
    like = f", like theta^{power:.2f}" if np.isfinite(power) else ""
    return (
        f"{name} {'holds' if holds else 'fails'} ({symbol} = {figure.worst[-1]:.4g} {top}{like}; "
        f"{first:.4g} in the first half, {second:.4g} in the second)"
    )


def _halves(times: np.ndarray) -> list[np.ndarray]:
    middle = (times[0] + times[-1]) / 2
    return [np.flatnonzero(times <= middle), np.flatnonzero(times >= middle)]


def _refined(pair: Pair, gramians: Gramians, measure, seen: np.ndarray, cuts: np.ndarray, sign: int) -> Figure:
    """The largest (sign 1) or smallest (-1) value of measure over time, for each theta and in each half, refined around it."""
    coarse = sign * measure(gramians)[seen]
    times = gramians.times[seen]
    best, where = np.empty((2, len(gramians.thetas), 2))
    for half, members in enumerate(_halves(times)):
        for r in range(len(gramians.thetas)):
            k = members[np.argmax(coarse[members, r])]
            best[r, half], where[r, half] = coarse[k, r], times[k]
            part, centre = _only(gramians, r), int(seen[k])
            low, high = max(centre - 1, int(seen[members[0]])), min(centre + 1, int(seen[members[-1]]))
            for level in range(ZOOMS if np.isfinite(best[r, half]) else 0):
                inside = np.linspace(part.times[low], part.times[high], ZOOM_POINTS + 1)
                fine = np.unique(np.concatenate([inside, cuts[(cuts > inside[0]) & (cuts < inside[-1])]]))
                if np.min(np.diff(fine), initial=1.0) < 1e-12 * max(1.0, fine[-1]):
                    break
                part = fading_gramians(pair, fine, part.thetas, (part.roots[low], part.logs[low]))
                values = sign * measure(part)[:, 0]
                centre = int(np.argmax(values))
                gain = values[centre] - best[r, half]
                if gain > 0:
                    best[r, half], where[r, half] = values[centre], fine[centre]
                if level > 1 and gain <= SETTLED * abs(best[r, half]):
                    break
                low, high = max(centre - 1, 0), min(centre + 1, len(fine) - 1)
    pick = np.argmax(best, axis=1)[:, None]
    return Figure(sign * np.take_along_axis(best, pick, 1)[:, 0], np.take_along_axis(where, pick, 1)[:, 0], sign * best)


def _only(gramians: Gramians, r: int) -> Gramians:
    one = slice(r, r + 1)
    parts = gramians.thetas[one], gramians.roots[:, one], gramians.logs[:, one]
    return Gramians(gramians.times, *parts, gramians.blocks)


def _window_figure(pair: Pair, times: np.ndarray, theta: float, cuts: np.ndarray) -> tuple[list[float], list[float]]:
    """The smallest alpha of (11) and its time, in each half."""
    graded = float(theta) ** (pair.powers - 0.5)

    def alpha(at: np.ndarray) -> np.ndarray:
        return window_gramians(pair, at, theta, cuts[(cuts > at[0] - 1 / theta) & (cuts < at[-1])]).smallest(graded)[:, 0]

    step = max(1, round(len(times) / ((times[-1] - times[0]) * theta * FINENESS)))
    best, where = [], []
    for members in _halves(times):
        own = np.unique(np.concatenate([times[members[::step]], times[members[-1:]]]))
        values = alpha(own)
        for _ in range(ZOOMS):
            k = int(np.argmin(values))
            if len(own) == ZOOM_POINTS + 1 and np.ptp(values) <= SETTLED * values[k]:
                break
            own = np.linspace(own[max(k - 1, 0)], own[min(k + 1, len(own) - 1)], ZOOM_POINTS + 1)
            values = alpha(own)
        best.append(float(np.min(values)))
        where.append(float(own[np.argmin(values)]))
    return best, where


def _stacked(rows: list[tuple[list[float], list[float]]]) -> Figure:
    halves, where = (np.asarray([row[i] for row in rows]) for i in (0, 1))
    pick = np.argmin(halves, axis=1)[:, None]
    return Figure(np.take_along_axis(halves, pick, 1)[:, 0], np.take_along_axis(where, pick, 1)[:, 0], halves)


def _couplings(pair: Pair, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(min a_i, max a_i, min |a_i|) over the times, if A(u) has entries above its diagonal alone."""
    a, _ = pair.at(times)
    above = np.diagonal(a, offset=1, axis1=-2, axis2=-1)
    rest = a - np.einsum("ki,ij->kij", np.pad(above, ((0, 0), (0, 1))), np.eye(a.shape[-1], k=1))
    if set(pair.blocks) != {1} or np.any(rest):
        return np.zeros(0), np.zeros(0), np.zeros(0)
    return np.min(above, axis=0), np.max(above, axis=0), np.min(np.abs(above), axis=0)
