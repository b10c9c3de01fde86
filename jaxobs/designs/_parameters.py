"""The parameters of a Jacobian with proved bounds, and the channels b_k c_k' through which they enter."""

import dataclasses
from collections.abc import Callable
from fractions import Fraction

import numpy as np

from jaxobs.designs._factor import Parameter, Place, Terms
from jaxobs.intervals import Interval
from jaxobs.intervals.formula_ranges import formula_ranges
from jaxobs.intervals.formulas import Expression
from jaxobs.intervals.graph import Formulas


@dataclasses.dataclass(frozen=True)
class Bounded:
    """J = constants + sum_k h_k M_k (q, n), lower <= h <= upper (r,), attained up to `gap`; formulas: h_k in words."""

    shape: tuple[int, int]
    constants: dict[Place, Fraction]
    parameters: list[Parameter]
    formulas: list[str]
    lower: np.ndarray
    upper: np.ndarray
    gap: float
    boxes: int

    def texts(self) -> tuple[str, ...]:
        """Each parameter in words with its interval."""
        ends = zip(self.formulas, self.lower.tolist(), self.upper.tolist(), strict=True)
        return tuple(f"{formula} in [{low:.9g}, {high:.9g}]" for formula, low, high in ends)

    def constant(self) -> np.ndarray:
        """The entries that are constant, (q, n), zeros elsewhere."""
        return _dense(self.constants, self.shape)

    def arrays(self) -> tuple[np.ndarray, np.ndarray, list[int]]:
        """(left (q, r), right (r, n), the number of its parameter for each channel)."""
        (q, n), pairs = self.shape, [(k, pair) for k, one in enumerate(self.parameters) for pair in one.channels()]
        left, right = np.zeros((q, len(pairs))), np.zeros((len(pairs), n))
        for at, (_, (b, c)) in enumerate(pairs):
            for i, x in b.items():
                left[i, at] = float(x)
            for j, x in c.items():
                right[at, j] = float(x)
        return left, right, [k for k, _ in pairs]

    def rounding(self) -> float:
        """max_ij |J_ij - (constants_ij + sum_k h_k (b_k c_k')_ij)| over the bounds: what the floats lose, often nothing."""
        worst = {place: abs(x - Fraction(float(x))) for place, x in self.constants.items()}
        for one, low, high in zip(self.parameters, self.lower.tolist(), self.upper.tolist(), strict=True):
            made: dict[Place, Fraction] = {}
            for b, c in one.channels():
                for i, x in b.items():
                    for j, y in c.items():
                        made[i, j] = made.get((i, j), Fraction(0)) + Fraction(float(x)) * Fraction(float(y))
            for place in one.matrix.keys() | made.keys():
                lost = abs(one.matrix.get(place, Fraction(0)) - made.get(place, Fraction(0)))
                worst[place] = worst.get(place, Fraction(0)) + lost * Fraction(max(abs(low), abs(high)))
        return float(max(worst.values(), default=Fraction(0)))


def bounded(
    formulas: Formulas, way: Callable[[dict[Place, Terms]], list[Parameter]], z: Interval, *, rtol: float, max_boxes: int
) -> Bounded:
    """The parameters that `way` (factor or separate) finds in a Jacobian (q, n), each with its range over the box z (N,)."""
    q, n = formulas.outputs.shape
    table: dict[Place, Expression] = {(i, j): formulas.outputs[i][j] for i in range(q) for j in range(n)}
    parameters = way({place: e.terms for place, e in table.items() if not e.is_constant})
    constants = {place: e.constant for place, e in table.items() if e.constant}
    expressions = [Expression(Fraction(0), one.terms) for one in parameters]
    found = formula_ranges(formulas.graph, expressions, z, rtol=rtol, max_boxes=max_boxes)
    known = np.isfinite(found.lower) & np.isfinite(found.upper)
    outer_low, outer_high, low, high = (one[known] for one in found[:4])
    size = np.maximum(np.maximum(np.abs(low), np.abs(high)), np.finfo(float).tiny)
    with np.errstate(invalid="ignore"):  # both infinite: nothing is known to be attained
        gaps = np.nan_to_num(np.maximum(low - outer_low, outer_high - high), nan=np.inf, posinf=np.inf)
    texts = [formulas.graph.text(e) for e in expressions]
    with np.errstate(invalid="ignore"):
        gap = float(
            np.max(np.where(np.isinf(gaps) | np.isinf(size), np.where(gaps == 0, 0.0, np.inf), gaps / size), initial=0.0)
        )
    return Bounded((q, n), constants, parameters, texts, found.lower, found.upper, gap, found.boxes)


def _dense(entries: dict[Place, Fraction], shape: tuple[int, int]) -> np.ndarray:
    matrix = np.zeros(shape)
    for place, x in entries.items():
        matrix[place] = float(x)
    return matrix
