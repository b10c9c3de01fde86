"""The least upper bounds of functions over a box, from both sides: best-first bisection with interval enclosures.

Source: R. Moore, R. Kearfott, M. Cloud, Introduction to Interval Analysis, 2009, chapters 6 (mean value form) and 11 (global
optimisation); E. Hansen, G. W. Walster, Global Optimization Using Interval Analysis, 2004, chapter 12 (monotonicity).
"""

import dataclasses
from collections.abc import Callable, Generator
from typing import NamedTuple

import numpy as np

BATCH = 32  # boxes that one search halves at a time
COLLAPSES = 2  # times that a box, one of whose faces suffices, is evaluated again before it is halved
Pair = tuple[np.ndarray, np.ndarray]
FEW = 4  # the same while nothing bounds g: where it is given up is soon found in depth, and late in breadth
ENDLESS = 1e16  # a value beyond this, and no bound: the search for a bound is given up
TINY = 2.0**-30  # of the box in every direction (of 1 where it is endless), and no bound: the same


class Enclosure(NamedTuple):
    """g on each box, in [low, high], (k,), and its gradient there, in [slope_low, slope_high], (k, n).

    The gradient is the whole line where g may jump, or be undefined, on the box.
    """

    low: np.ndarray
    high: np.ndarray
    slope_low: np.ndarray
    slope_high: np.ndarray


class Boxes(NamedTuple):
    """Boxes lower <= z <= upper (k, n), an upper bound of g on each (k,), the coordinate to halve (k,), -1 for none."""

    lower: np.ndarray
    upper: np.ndarray
    bound: np.ndarray
    axis: np.ndarray

    def at(self, chosen: np.ndarray) -> "Boxes":
        return Boxes(*(part[chosen] for part in self))


@dataclasses.dataclass
class Supremum:
    """inner <= sup g <= outer; size: a number that |g| reaches, shared by the searches of g and of -g; left: how many boxes may
    still be evaluated, shared by all searches."""

    inner: float
    size: list[float]
    left: list[int]
    outer: float = np.inf

    def search(self, lower: np.ndarray, upper: np.ndarray, rtol: float) -> Generator[Pair, Enclosure, None]:
        """A generator that yields boxes (lower, upper) and is sent the Enclosure of g there. Those with the largest bounds

            g <= min(natural extension, g(m) + sum_k G_k (Z_k - m_k)),     G enclosing the gradient, m the midpoint,

        are halved until outer - inner <= rtol size, or no boxes are left; of those with none the smallest first, until one of
        them is tiny. Where G_k keeps its sign, the face on which g is largest replaces the box.
        """
        with np.errstate(over="ignore"):
            width = np.max(upper - lower, axis=0)
        tiny = TINY * np.where(np.isfinite(width), width, 1.0)
        fixed, parent = -np.inf, np.array([np.inf])
        queue, fresh = Boxes(lower[:0], lower[:0], np.empty(0), np.empty(0, int)), (lower, upper)
        while True:
            found = yield from self._evaluated(*fresh, parent)
            points = found.axis < 0
            fixed = max(fixed, float(np.max(found.bound[points], initial=-np.inf)))
            queue = Boxes(*(np.concatenate(parts) for parts in zip(queue, found.at(~points), strict=True)))
            queue = queue.at(queue.bound > self.inner)
            self.outer = max(self.inner, fixed, float(np.max(queue.bound, initial=-np.inf)))
            with np.errstate(over="ignore"):
                size = np.max(queue.upper - queue.lower - tiny, axis=1, initial=-np.inf)
            without = queue.bound == np.inf
            endless = self.outer == np.inf and (self.inner > ENDLESS or np.any(without & (size <= 0)))
            if self.outer == self.inner or endless or not queue.bound.size or self.left[0] <= 0:
                return
            if self.outer - self.inner <= rtol * self.size[0]:
                return
            order = np.lexsort((np.where(without, size, 0.0), -queue.bound))
            count = FEW if without.any() else BATCH
            taken, queue = queue.at(order[:count]), queue.at(order[count:])
            fresh, parent = _halved(taken), np.concatenate([taken.bound, taken.bound])

    def _evaluated(self, lower: np.ndarray, upper: np.ndarray, parent: np.ndarray) -> Generator[Pair, Enclosure, Boxes]:
        """The boxes, on their faces where these suffice, with their bounds."""
        lower, upper, bound = lower.copy(), upper.copy(), parent.copy()
        slopes = np.full(lower.shape, -np.inf), np.full(lower.shape, np.inf)
        open_ = np.arange(len(lower))
        for last in [False] * COLLAPSES + [True]:
            low, high = lower[open_], upper[open_]
            middle = middle_of(low, high)
            found = yield np.concatenate([low, middle]), np.concatenate([high, middle])
            count = len(open_)
            self.left[0] -= count
            self._attained(found.low[count:], found.high[count:])
            near = [part[:count] for part in found]
            mean = mean_value(found.high[count:], middle, low, high, near[2], near[3])
            bound[open_] = np.minimum(bound[open_], np.minimum(near[1], mean))
            slopes[0][open_], slopes[1][open_] = near[2], near[3]
            if last:
                break
            moved = self._collapse(lower, upper, *slopes)
            open_ = np.flatnonzero(moved & (bound > self.inner))
            if not open_.size:
                break
        return Boxes(lower, upper, bound, _widest(lower, upper, *slopes))

    def _attained(self, low: np.ndarray, high: np.ndarray) -> None:
        self.inner = max(self.inner, float(np.max(low, initial=-np.inf)))
        sizes = np.maximum(np.maximum(low, -high), 0)  # |g| is at least this there
        self.size[0] = max(self.size[0], float(np.max(sizes[np.isfinite(sizes)], initial=0.0)))

    def _collapse(self, lower, upper, slope_low, slope_high) -> np.ndarray:
        """Puts each box on the faces where g is largest, in place: which boxes moved. An endless rise is noted."""
        wide = lower < upper
        grows, falls = wide & (slope_low >= 0), wide & (slope_high <= 0)
        if np.any((wide & (slope_low > 0) & (upper == np.inf)) | (wide & (slope_high < 0) & (lower == -np.inf))):
            self.inner = np.inf
        at = np.where(grows & falls, middle_of(lower, upper), np.where(grows, upper, lower))
        moved = (grows | falls) & np.isfinite(at)
        lower[moved], upper[moved] = at[moved], at[moved]
        return moved.any(axis=1)


def run(
    searches: dict[int, Generator[Pair, Enclosure, None]], enclose: Callable[[np.ndarray, np.ndarray, np.ndarray], Enclosure]
) -> None:
    """All searches side by side: in each round their boxes are evaluated together, enclose(number, lower, upper)."""
    asked = {number: next(search) for number, search in searches.items()}
    while asked:
        numbers = np.concatenate([np.full(len(boxes[0]), number) for number, boxes in asked.items()])
        lower, upper = (np.concatenate([boxes[side] for boxes in asked.values()]) for side in (0, 1))
        found, start, later = enclose(numbers, lower, upper), 0, {}
        for number, boxes in asked.items():
            part = Enclosure(*(one[start : start + len(boxes[0])] for one in found))
            start += len(boxes[0])
            try:
                later[number] = searches[number].send(part)
            except StopIteration:
                continue
        asked = later


def middle_of(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """A finite point of [lower, upper], at which it is halved: the middle, or 0, or twice the finite end."""
    largest = np.finfo(float).max
    with np.errstate(invalid="ignore", over="ignore"):
        half = lower / 2 + upper / 2
        right = np.where(lower < 0, 0.0, np.clip(2 * lower, 1.0, largest))
        left = np.where(upper > 0, 0.0, np.clip(2 * upper, -largest, -1.0))
    return np.clip(np.where(np.isposinf(upper), right, np.where(np.isneginf(lower), left, half)), lower, upper)


def mean_value(centre, middle, lower, upper, slope_low, slope_high) -> np.ndarray:
    """An upper bound of g(m) + sum_k G_k (Z_k - m_k), each operation rounded up."""
    left = np.where(lower == middle, 0.0, np.nextafter(lower - middle, -np.inf))
    right = np.where(upper == middle, 0.0, np.nextafter(upper - middle, np.inf))
    terms = np.maximum.reduce([_product_up(slope, side) for slope in (slope_low, slope_high) for side in (left, right)])
    total = centre
    for term in terms.T:
        total = np.where(term == 0, total, np.nextafter(total + term, np.inf))
    return np.where(np.isnan(total), np.inf, total)


def _product_up(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore", over="ignore", under="ignore"):
        return np.where((a == 0) | (b == 0), 0.0, np.nextafter(a * b, np.inf))


def _widest(lower, upper, slope_low, slope_high) -> np.ndarray:
    """The coordinate with the largest |G_k| width_k, -1 where none can be halved."""
    middle = middle_of(lower, upper)
    can = (lower < middle) & (middle < upper)
    with np.errstate(over="ignore", invalid="ignore"):
        width = np.where(can, upper - lower, 0.0)
        smear = np.where(can, np.maximum(np.abs(slope_low), np.abs(slope_high)) * width, -1.0)
    smear = np.where(np.isnan(smear), np.inf, smear)
    axis = np.argmax(np.where(smear == smear.max(axis=1, keepdims=True), width, -1.0), axis=1)
    return np.where(can.any(axis=1), axis, -1)


def _halved(boxes: Boxes) -> tuple[np.ndarray, np.ndarray]:
    rows = np.arange(len(boxes.axis))
    middle = middle_of(boxes.lower, boxes.upper)[rows, boxes.axis]
    lower, upper = np.concatenate([boxes.lower, boxes.lower]), np.concatenate([boxes.upper, boxes.upper])
    upper[rows, boxes.axis] = middle
    lower[rows + len(rows), boxes.axis] = middle
    return lower, upper
