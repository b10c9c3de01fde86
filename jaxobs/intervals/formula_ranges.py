"""The ranges of exact formulas over a box: each in the variables that it has, over one period, proportional ones once."""

from collections.abc import Callable, Sequence
from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from jaxobs.intervals.expressions import as_function, is_float, one_period
from jaxobs.intervals.formulas import Expression, Graph, combine
from jaxobs.intervals.interval import Interval, interval
from jaxobs.intervals.ranges import Ranges, ranges

SMOOTH = ("x", "*", "sin", "cos", "tanh", "exp", "atan", "erf")


def formula_ranges(
    graph: Graph, expressions: Sequence[Expression], z: Interval, *, rtol: float = 1e-6, max_boxes: int = 20_000
) -> Ranges:
    """The ranges (`ranges`) of expressions constant + factor core over the box z (N,), one search for each core.

    Smooth cores with the same variables are searched side by side, others by themselves: a kink of one would hide the slopes
    of all.
    """
    parts = [e.split() for e in expressions]
    cores = list(dict.fromkeys(core for _, factor, core in parts if factor))
    groups: dict[tuple, list[Expression]] = {}
    for core in cores:
        box, support = one_period(graph, core, z), tuple(sorted(graph.support(core)))
        smooth = all(_is_smooth(graph.atoms[i]) for i in graph.nodes([core]))
        key = (support, tuple(box.lower[list(support)]), tuple(box.upper[list(support)]), None if smooth else core)
        groups.setdefault(key, []).append(core)
    found: dict[Expression, tuple[float, float, float, float]] = {}
    used = 0
    for left, ((support, lower, upper, _), members) in zip(range(len(groups), 0, -1), groups.items(), strict=True):
        function = _of_some(as_function(graph, members), support, len(z.lower))
        small, budget = Interval(np.array(lower), np.array(upper)), max((max_boxes - used) // left, 2)
        edges = _of_some(_edges(graph, members), support, len(z.lower))
        some = ranges(function, small, rtol=rtol, max_boxes=budget, edges=edges)
        used += some.boxes
        found |= dict(zip(members, zip(*(one.tolist() for one in some[:4]), strict=True), strict=True))
    ends = np.array([_affine(c, k, found.get(core, (0.0, 0.0, 0.0, 0.0))) for c, k, core in parts]).reshape(-1, 4)
    return Ranges(ends[:, 0], ends[:, 1], ends[:, 2], ends[:, 3], used)


def _is_smooth(atom: tuple) -> bool:
    return atom[0] in SMOOTH or (atom[0] == "^" and atom[2] > 0)


def _edges(graph: Graph, members: Sequence[Expression]) -> Callable:
    """z -> (s,), one of them 0 wherever a formula jumps or is undefined."""
    signs, positive = [], []
    for i in graph.nodes(members):
        name, *parts = graph.atoms[i]
        if name == "min":
            signs.append(combine((1, parts[0]), (-1, parts[1])))
        elif name in ("<=", "^") and not _is_smooth(graph.atoms[i]):
            signs.append(parts[0])
        elif name in ("log", "sqrt"):
            positive.append(parts[0])
    ones = Expression(Fraction(1))
    conditions, limits = as_function(graph, [ones, *signs]), as_function(graph, [ones, *positive])
    return lambda z: jnp.concatenate([conditions(z), jnp.maximum(limits(z), 0.0)])


def _of_some(function: Callable, support: Sequence[int], size: int) -> Callable:
    """The function of the variables on which it depends."""
    places = {i: k for k, i in enumerate(support)}
    return lambda part: function([part[places[i]] if i in places else part[0] * 0 for i in range(size)])


def _affine(constant: Fraction, factor: Fraction, ends: tuple[float, float, float, float]) -> tuple[float, ...]:
    """(lower, upper, inner_lower, inner_upper) of constant + factor core, outer ones rounded outward, inner ones inward."""
    lower, upper, least, most = ends if factor >= 0 else (ends[1], ends[0], ends[3], ends[2])

    def value(x: float) -> Interval:
        if np.isinf(x):
            return interval(np.float64(x if factor > 0 else -x), np.float64(x if factor > 0 else -x))
        return _enclosed(constant) + _enclosed(factor) * interval(np.float64(x), np.float64(x))

    if not factor:
        found = _enclosed(constant)
        return float(found.lower), float(found.upper), float(found.upper), float(found.lower)
    return float(value(lower).lower), float(value(upper).upper), float(value(least).upper), float(value(most).lower)


def _enclosed(x: Fraction) -> Interval:
    near = np.float64(float(x))
    if is_float(x):
        return interval(near, near)
    return interval(np.nextafter(near, -np.inf), np.nextafter(near, np.inf))
