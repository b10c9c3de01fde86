"""The search for bisections of a box on whose leaves bounds are seen by plain interval evaluation."""

from fractions import Fraction
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import checker_bounds


class Prover:
    """Looks for bisections with the arithmetic of the checker."""

    def __init__(self, bounds: dict[str, Any]):
        self.formulas = checker_bounds.Formulas(bounds["nodes"], bounds["variables"])
        ends = zip(bounds["lower"], bounds["upper"], strict=True)
        self.box = [checker_bounds.Interval(_end(a), _end(b)) for a, b in ends]
        self.variables = bounds["variables"]

    def splits(self, rho: Any, low: float, high: float, k: int, most: int) -> list[Any]:
        """Preorder: [variable, where], then what is below, then what is above; 0 for a leaf. ValueError beyond `most` cuts,
        or where a point refutes the bounds."""
        form, limits = self.formulas.form(rho), (Fraction(low), Fraction(high))
        order = self.formulas.order(form)
        own = [self.formulas.nodes[i][2] for i in order if self.formulas.nodes[i][0] == "x"]
        found: list[Any] = []
        stack, cuts = [self.box], 0
        while stack:
            box = stack.pop()
            if self.excess(form, order, box, limits) == 0:
                found.append(0)
                continue
            cuts += 1
            middle = [checker_bounds.Interval(x, x) for x in map(_middle, box)]
            value = self.formulas.enclose(form, order, middle)
            name = f"lower[{k}], upper[{k}]"
            if value is not None and (value.high < limits[0] or value.low > limits[1]):
                at = ", ".join(f"{v} = {float(x.low):.9g}" for v, x in zip(self.variables, middle, strict=True))
                there = f"{checker_bounds.near(value.low):.9g} at {at}"
                given = f"{low!r} .. {high!r}, where rho = {self.formulas.written(form)} is {there}"
                raise refuse("with_bounds", name, given, "bounds that hold on the box", "Widen them, or shrink the box.")
            halves = [(v, *_cut(box, v)) for v in own if box[v].low < _middle(box[v]) < box[v].high]
            if cuts > most or not halves:
                given = f"{low!r} .. {high!r}, not proved with {cuts} bisections"
                fix = "Relax them (relax=1e-3), allow more bisections (most), or bound x and u."
                raise refuse("with_bounds", name, given, "bounds with a margin over the range of rho", fix)
            v, left, right = min(halves, key=lambda half: self.after(form, order, half[1:], limits))
            found.append([v, float(left[v].high).hex()])
            stack += [right, left]
        return found

    def after(self, form: Any, order: list[int], halves: Any, limits: Any) -> tuple[float, float]:
        """What is left to prove in two halves: the larger excess, then the sum."""
        excess = [self.excess(form, order, box, limits) for box in halves]
        return max(excess), sum(excess)

    def excess(self, form: Any, order: list[int], box: Any, limits: Any) -> float:
        """By how much the enclosure exceeds the limits; infinite where there is none."""
        self.formulas.left = checker_bounds.MOST_EFFORT
        value = self.formulas.enclose(form, order, box)
        if value is None:
            return np.inf
        over = max(limits[0] - value.low, value.high - limits[1])
        return checker_bounds.near(over) if over > 0 else 0.0


def _end(text: str) -> Any:
    value = float.fromhex(text)
    return value if np.isinf(value) else Fraction(value)


def _middle(x: Any) -> Fraction:
    """A float inside the interval, half way where it is bounded; its finite end where no float is beyond that."""
    low, high = float(x.low), float(x.high)
    if np.isinf(low) and np.isinf(high):
        return Fraction(0)
    if np.isinf(low) or np.isinf(high):
        end = high if np.isinf(low) else low
        inside = end + (1.0 + abs(end)) * (-1.0 if np.isinf(low) else 1.0)
        return Fraction(end if np.isinf(inside) else inside)
    return Fraction(low / 2 + high / 2 if np.isinf(high - low) else low + (high - low) / 2)


def _cut(box: Any, v: int) -> tuple[Any, Any]:
    x = _middle(box[v])
    left, right = (checker_bounds.Interval(*ends) for ends in ((box[v].low, x), (x, box[v].high)))
    return [*box[:v], left, *box[v + 1 :]], [*box[:v], right, *box[v + 1 :]]
