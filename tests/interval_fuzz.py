"""Random boxes and points in them: the exact value, as a ball of 128 bits, must touch the enclosure."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxobs import intervals
from tests.interval_programs import Program
from tests.oracles import ball_numbers, ball_program


class Count(NamedTuple):
    """Values compared, those whose ball lies outside, and points left out because balls decide no comparison there."""

    values: int = 0
    violations: int = 0
    left_out: int = 0

    def plus(self, other: "Count") -> "Count":
        return Count(*np.add(self, other).tolist())


def boxes(program: Program, count: int, rng: np.random.Generator) -> intervals.Interval:
    """Boxes of every size: single numbers, a few ulps, wide ones, with ends at zero, one-sided and wholly infinite ones."""
    shape, (low, high) = (count, program.n), (program.low, program.high)
    middle = rng.uniform(low, high, shape)
    radius = (high - low) / 2 * 10.0 ** rng.uniform(-16, 0, (count, 1)) * rng.random(shape)
    radius[rng.random(shape) < 0.1] = 0.0
    lower, upper = np.clip(middle - radius, low, high), np.clip(middle + radius, low, high)
    if low < 0 < high:
        at_zero = rng.random(shape) < 0.1
        lower, upper = np.where(at_zero & (lower > 0), 0.0, lower), np.where(at_zero & (upper < 0), 0.0, upper)
        lower = np.where(rng.random(shape) < 0.05, -np.inf, lower)
    return intervals.Interval(lower, np.where(rng.random(shape) < 0.05, np.inf, upper))


def points(box: intervals.Interval, each: int, rng: np.random.Generator) -> np.ndarray:
    """(boxes * each, n) floats in the boxes, finite corners among them."""
    shape = (box.shape[0], each, box.shape[1])
    far = 10.0 ** rng.uniform(-1, 5, shape)
    lower, upper = np.broadcast_to(box.lower[:, None], shape), np.broadcast_to(box.upper[:, None], shape)
    both = np.isinf(lower) & np.isinf(upper)
    first = np.where(np.isfinite(lower), lower, np.where(both, 0.0, upper) - far)
    last = np.where(np.isfinite(upper), upper, np.where(both, 0.0, lower) + far)
    share = np.clip(rng.uniform(-0.2, 1.2, shape), 0.0, 1.0)
    inside = np.clip(np.where(share == 1.0, last, first + share * (last - first)), lower, upper)
    return inside.reshape(-1, box.shape[1])


def fuzz(program: Program, count: int, each: int, seed: int) -> Count:
    """The values and the Jacobian of a program at random points of random boxes."""
    rng = np.random.default_rng(seed)
    box = boxes(program, count, rng)
    sample = points(box, each, rng)
    total = Count()
    for f in (program.f, jax.jacfwd(program.f)):
        total = total.plus(compare(jax.vmap(f), sample, intervals.bound(jax.vmap(f), box), each))
    return total


def fuzz_alone(program: Program, count: int, each: int, seed: int) -> Count:
    """The values of a program, one box and one point at a time."""
    rng = np.random.default_rng(seed)
    box = boxes(program, count, rng)
    sample = points(box, each, rng)
    enclose = intervals.trace(program.f, box[0])
    ends = [enclose(box[i]).value for i in range(count) for _ in range(each)]
    exact = [ball_program.evaluate(enclose.closed, x)[0] for x in sample]
    return Count(
        *np.sum([ball_numbers.disjoint(y, z.lower, z.upper)[::-1] for y, z in zip(exact, ends, strict=True)], 0).tolist()
    )


def compare(f: Callable[..., Any], sample: np.ndarray, enclosure: intervals.Interval, each: int) -> Count:
    """The exact values at the sample against the enclosures, of which each holds for so many points in a row."""
    try:
        (exact,) = ball_program.evaluate(intervals.trace(f, sample).closed, sample)
    except ball_numbers.AmbiguousError:  # at one of the points: halve them
        if len(sample) == 1:
            return Count(left_out=1)
        if each > 1:
            enclosure, each = intervals.Interval(*(np.repeat(end, each, 0) for end in (enclosure.lower, enclosure.upper))), 1
        half = len(sample) // 2
        return compare(f, sample[:half], enclosure[:half], 1).plus(compare(f, sample[half:], enclosure[half:], 1))
    found, values = ball_numbers.disjoint(exact, *(np.repeat(end, each, axis=0) for end in (enclosure.lower, enclosure.upper)))
    return Count(values, found)
