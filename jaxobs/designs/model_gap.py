"""How far a plant is from its observer's model, proved: what `ultimate_bound` asks for."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.designs._system import system
from jaxobs.designs.lpv_from import as_set, require_proof
from jaxobs.intervals import Interval, graph
from jaxobs.intervals.expressions import as_function, one_period
from jaxobs.intervals.formulas import Expression, Graph, combine
from jaxobs.intervals.jacobian import assumptions
from jaxobs.intervals.ranges import ranges


@dataclasses.dataclass(frozen=True)
class ModelGap:
    """f_plant(x, u) - f_model(x, u) = disturbance d with |d| <= size; disturbance (n, m), a column a component that differs.

    attained: some |d| is at least this. origin: what it stands on, a sentence. boxes: how many were evaluated.
    """

    disturbance: np.ndarray
    size: float
    attained: float
    origin: str
    boxes: int


def model_gap(plant: Any, model: Any, box: Any, *, inputs: Any = None, rtol: float = 1e-6, max_boxes: int = 20_000) -> ModelGap:
    """sup |f_plant(x, u) - f_model(x, u)| over the states and inputs that occur, from above, by interval arithmetic.

    plant, model: plants, or functions f(x) or f(x, u), of one size and kind. box: (lower, upper) or a set of
    `jaxobs.designs.sets`, in which the plant's state stays; inputs: (lower, upper) of u. rtol, max_boxes: as for
    `jacobian_bounds`.

    ValueError where nothing bounds the difference, where the two do not fit, and for a set whose proof fails.
    """
    domain, own, other = as_set(box), system("model_gap", plant, inputs), system("model_gap", model, inputs)
    require_proof("model_gap", domain)
    if len(own.lower) != len(other.lower) or own.step != other.step:
        fix = "Both continuous or both step systems, of the same inputs."
        raise refuse("model_gap", "model", f"inputs {other.names}", f"{own.names}, as the plant", fix)
    n, m = len(domain.lower), len(own.lower)
    z = Interval(np.append(domain.lower, own.lower), np.append(domain.upper, own.upper))

    def apart(x, w):
        return own.f(x, w) - other.f(x, w)

    formulas = graph.trace(apart, n, m) if m else graph.trace(lambda x: apart(x, x[:0]), n)
    if formulas.outputs.shape != (n,):
        fix = "Give the box of x, (n,), and two systems of that size."
        raise refuse("model_gap", "box", f"{n} states for outputs of shape {formulas.outputs.shape}", f"({n},)", fix)
    differs = [k for k in range(n) if not formulas.outputs[k].is_zero]  # what both have in common is gone, exactly
    parts, size, attained, boxes = [formulas.outputs[k] for k in differs], 0.0, 0.0, 0
    if parts:
        whole = parts[0] if len(parts) == 1 else combine(*((1, formulas.graph.power(part, 2)) for part in parts))
        low, high, below, above, boxes = _range(formulas.graph, whole, z, rtol, max_boxes)
        size, attained = max(high, -low), max(above, -below, 0.0)
        if len(parts) > 1:
            size, attained = float(np.nextafter(np.sqrt(size), np.inf)), float(np.sqrt(attained))
    if not np.isfinite(size):
        given = f"nothing bounds {' or '.join(formulas.graph.text(part) for part in parts)}"
        fix = "Give the box in which the state stays, and inputs=(lower, upper)."
        raise refuse("model_gap", "box", given, "a box on which the two stay close", fix)
    ends = zip(own.names, own.lower.tolist(), own.upper.tolist(), strict=True)
    known = [f"{name} in [{low!r}, {high!r}]" for name, low, high in ends if np.isfinite(low)]
    taken = assumptions(lambda z: apart(z[:n], z[n:]), z)
    origin = "; ".join([f"sup |plant - model| <= {size!r} by interval arithmetic, {domain.state}", *known, *taken])
    return ModelGap(np.eye(n)[:, differs], size, attained, origin, boxes)


def _range(formulas: Graph, e: Expression, z: Interval, rtol: float, max_boxes: int) -> tuple[float, float, float, float, int]:
    """(lower, upper, attained from above, attained from below, boxes) of a formula, on what it depends on."""
    if e.is_constant:
        low, high = (float(np.nextafter(float(e.constant), end)) for end in (-np.inf, np.inf))
        return low, high, high, low, 0
    inside, box = sorted(formulas.support(e)), one_period(formulas, e, z)
    places, function = {variable: k for k, variable in enumerate(inside)}, as_function(formulas, [e])

    def of_some(part):
        return function([part[places[i]] if i in places else part[0] * 0 for i in range(z.lower.size)])

    found = ranges(of_some, Interval(box.lower[inside], box.upper[inside]), rtol=rtol, max_boxes=max_boxes)
    return (*(float(one[0]) for one in found[:4]), found.boxes)  # pyright: ignore[reportReturnType]
