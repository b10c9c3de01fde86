"""The ranges of the components of a function over a box, from both sides; its values and slopes on many boxes at a time."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxobs.intervals.declared import require_derivatives
from jaxobs.intervals.interval import Interval, where, whole
from jaxobs.intervals.jaxpr import Program, trace
from jaxobs.intervals.search import Enclosure, Supremum, middle_of, run

SIZES = (8, 64, 128)  # of the batches for which a function is traced
APART = 4  # boxes that are not told apart where g may jump on one of them
SEEDS = 64  # points tried first
FAR = 1e3  # how far points are tried at random where the box has no end


class Ranges(NamedTuple):
    """lower <= g <= upper on the box, g <= inner_lower and g >= inner_upper somewhere in it, (r,); boxes evaluated."""

    lower: np.ndarray
    upper: np.ndarray
    inner_lower: np.ndarray
    inner_upper: np.ndarray
    boxes: int


Function = Callable[[Any], Any]


def ranges(g: Function, z: Interval, *, rtol: float = 1e-6, max_boxes: int = 20_000, edges: Function | None = None) -> Ranges:
    """The ranges of the components of g: z (N,) -> (r,) over a box, from both sides, each to rtol of its largest |value|.

    edges: z -> (s,), if it is known what is 0 wherever g jumps or is undefined; by default the notes of each evaluation tell.
    """
    enclose = enclosures(g, z.lower.size, edges)
    seeds = _seeds(z)
    low, high, *_ = enclose(seeds, seeds)
    sizes, left, sides = np.where(np.isfinite(low), np.maximum(low, -high), 0.0).max(axis=0), [max_boxes], []
    for k, size in enumerate(np.maximum(sizes, 0.0)):
        shared = [float(size)]
        sides += [Supremum(float(np.max(low[:, k])), shared, left), Supremum(float(np.max(-high[:, k])), shared, left)]
    searches = {number: side.search(z.lower[None], z.upper[None], rtol) for number, side in enumerate(sides)}

    def chosen(numbers, lower, upper):
        rows, of = np.arange(len(numbers)), numbers // 2
        low, high, slope_low, slope_high = (part[rows, of] for part in enclose(lower, upper))
        below = numbers % 2 == 1  # the search for the supremum of -g
        pair = np.where(below, -high, low), np.where(below, -low, high)
        slopes = np.where(below[:, None], -slope_high, slope_low), np.where(below[:, None], -slope_low, slope_high)
        return Enclosure(*pair, *slopes)

    run(searches, chosen)
    above, below = sides[0::2], sides[1::2]
    outer = np.array([[-s.outer for s in below], [s.outer for s in above]])
    inner = np.array([[-s.inner for s in below], [s.inner for s in above]])
    return Ranges(outer[0], outer[1], inner[0], inner[1], max_boxes - left[0])


def _seeds(z: Interval) -> np.ndarray:
    """Points of the box: its middle, corners, and some at random."""
    size, rng = SEEDS, np.random.default_rng(0)
    low, high = (np.clip(end, -FAR, FAR) for end in (z.lower, z.upper))
    share = rng.random((size, len(low)))
    share[1 : size // 2] = np.round(share[1 : size // 2])
    points = np.clip(low + share * (high - low), z.lower, z.upper)
    points[0] = middle_of(z.lower, z.upper)
    return points


def enclosures(g: Function, n: int, edges: Function | None = None) -> Callable[[np.ndarray, np.ndarray], list[np.ndarray]]:
    """g: z (n,) -> (r,), as enclosures of values (k, r) and gradients (k, r, n) on k boxes at a time; gradients are the whole
    line, and values at points unknown, where g may jump or be undefined on the box. ValueError for declared derivatives."""
    require_derivatives("enclosures", g, n)
    programs: dict[int, Program] = {}

    def parts(z):
        return g(z), jax.jacfwd(g)(z), g(z)[:0] if edges is None else edges(z)

    def program(size: int) -> Program:
        if size not in programs:
            programs[size] = trace(jax.vmap(parts), jax.ShapeDtypeStruct((size, n), np.float64))
        return programs[size]

    def enclose(lower: np.ndarray, upper: np.ndarray) -> list[np.ndarray]:
        count = len(lower)
        size = next((size for size in SIZES if size >= count), SIZES[-1])
        if count > size:
            return _joined(enclose(lower[:size], upper[:size]), enclose(lower[size:], upper[size:]))
        places = np.minimum(np.arange(size), count - 1)  # the last box again, to fill the batch
        found = program(size)(Interval(lower[places], upper[places]))
        value, slopes, edge = (part[:count] for part in found.value)
        rough = np.any(edge.contains(0.0), axis=1)
        if edges is None and found.assumptions:
            if count > APART:
                half = count // 2
                return _joined(enclose(lower[:half], upper[:half]), enclose(lower[half:], upper[half:]))
            rough = np.ones(count, bool)
        slopes = where(rough[:, None, None], whole(slopes.shape), slopes)
        value = where((rough & np.all(lower == upper, axis=1))[:, None], whole(value.shape), value)
        return [value.lower, value.upper, slopes.lower, slopes.upper]

    return enclose


def _joined(first: list[np.ndarray], second: list[np.ndarray]) -> list[np.ndarray]:
    return [np.concatenate(both) for both in zip(first, second, strict=True)]
