"""Sets that the state enters from every start, in finite time, and never leaves: proved in exact rational arithmetic."""

import dataclasses
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import jax
import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import exact
from jaxobs.certificates.base import Verdict
from jaxobs.designs._system import system
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.sets import AbstractSet
from jaxobs.intervals import Interval, graph, require_derivatives
from jaxobs.intervals.expressions import Polynomial, of_polynomial, polynomial
from jaxobs.intervals.negative import is_negative

ROOM = 1e-6  # relative, by which levels and boxes exceed the best ones in floats
TRIALS = 64  # points of the other variables' box at which a level is tried
UNIT = Fraction(1)


@dataclasses.dataclass(frozen=True)
class Absorbing(AbstractSet):
    """{V <= level} for x' = f(x, u), u(t) anywhere in `inputs`, with a quadratic polynomial V and a number rate > 0:

        V'(x, u) + rate (V(x) - level) < 0      for all x (all x in `within`, if given) and all u.

    Then V - level falls at least like exp(-rate t) while positive, and reaches 0. V and V' are multiplied out exactly; the
    inequality is that of a quadratic form in (1, x), decided by fraction-free elimination, or where its coefficients contain u
    or coordinates bounded by `within`, by interval elimination over pieces of their box. lower, upper: a box around the set,
    proved likewise: x_i - upper_i + m (level - V) < 0 with some m > 0. Without `within` V has to be positive definite, so that
    no solution escapes. Made by `absorbing`. Source: E. N. Lorenz, J. Atmospheric Sciences 20 (1963), 130-141, section 4.
    """

    f: Any = None
    v: Callable[[Any], Any] | None = None
    level: float = 0.0
    rate: float = 0.0
    inputs: Any = None
    within: "Absorbing | None" = None

    @property
    def assumed(self) -> bool:
        return False

    @property
    def state(self) -> str:
        means = f"V <= {self.level!r} for a quadratic V" + (" inside an absorbing set" if self.within is not None else "")
        return (
            f"from every start the state enters in finite time, and never leaves, a set ({means}, V' + {self.rate!r} "
            f"(V - {self.level!r}) < 0 proved) inside the box {self.box}, from when on what follows holds"
        )

    def verify(self) -> Verdict:
        if self.within is not None and not (verdict := self.within.verify()):
            return verdict
        if not self.rate > 0:
            return Verdict(False, {}, f"not proved: rate = {self.rate!r} is not positive")
        energy, decay = _polynomials(self.f, self.v, self.inputs, len(self.lower))
        inside = _support(energy, len(self.lower))
        if self.within is None and len(inside) < len(self.lower):
            return Verdict(False, {}, "not proved: V leaves out a state, so that solutions might escape; give `within`")
        rest = _sum((UNIT, decay), (Fraction(self.rate), energy), (-Fraction(self.rate) * Fraction(self.level), {(): UNIT}))
        free = self._others()
        if not _negative(rest, inside, *free):
            return Verdict(False, {}, f"not proved: V' + {self.rate!r} (V - {self.level!r}) < 0")
        for i in inside:
            for end, sign, known in ((self.upper[i], 1, free[1][i]), (self.lower[i], -1, free[0][i])):
                if end == known:
                    continue
                ahead = _outside(energy, self.level, i, inside, float(end), sign)
                if not _negative(ahead, inside, self.lower, self.upper):
                    return Verdict(False, {}, f"not proved: x{i + 1} {'<' if sign > 0 else '>'} {end:.9g} where V <= level")
        return Verdict(True, {"rate": self.rate}, "every solution enters the set and stays: all inequalities hold")

    def _others(self) -> tuple[np.ndarray, np.ndarray]:
        """A box for the coordinates that V leaves out, and for the inputs."""
        made, n = system("Absorbing", self.f, self.inputs), len(self.lower)
        free = (np.full(n, -np.inf), np.full(n, np.inf)) if self.within is None else (self.within.lower, self.within.upper)
        return np.append(free[0], made.lower), np.append(free[1], made.upper)


def absorbing(
    f: Any, v: Callable[[Any], Any], n: int, *, inputs: Any = None, within: Absorbing | None = None, rate: float | None = None
) -> Absorbing:
    """The least level of V, a quadratic polynomial of x (n,), that is absorbing for x' = f at this rate, or at the best one:

        level = max_x (V + V' / rate),      attained where the quadratic V + V' / rate, concave for small rates, is stationary.

    f: a flow plant or a function f(x), or f(x, u) with inputs (lower, upper). within: an absorbing set that bounds what V
    leaves out; a chain of them sharpens the box. Computed in floats, widened by 1e-6, then proved: Infeasible if nothing is.
    """
    energy, decay = _polynomials(f, v, inputs, n)
    made, inside = system("absorbing", f, inputs), _support(energy, n)
    free = (np.full(n, -np.inf), np.full(n, np.inf)) if within is None else (within.lower, within.upper)
    low, high = np.append(free[0], made.lower), np.append(free[1], made.upper)

    peak = _peak(energy, decay, inside, low, high)
    if rate is None:
        rate, width = 1.0, 1e3
        while width > 1 + 1e-7:
            trials = rate * np.geomspace(1 / width, width, 81)
            rate, width = float(trials[int(np.argmin([peak(r) for r in trials]))]), width**0.05
    level = peak(rate)
    q = _numbers(_form(energy, inside) or [[{}]], np.zeros(len(low)))
    hessian, slope, start = q[1:, 1:], q[0, 1:], q[0, 0] / 2
    if not (np.isfinite(level) and np.all(np.linalg.eigvalsh(hessian) > 0)):
        change = "Choose a V that is positive definite in its states and whose third-order terms cancel in V'."
        raise Infeasible(f"V + V' / {rate:.6g} has no maximum, or V is not convex", -np.inf, change)
    centre = -np.linalg.solve(hessian, slope)
    level += ROOM * max(abs(level), abs(start))
    radius = 2 * (level - (start + slope @ centre / 2))
    half = np.sqrt(radius * np.diag(np.linalg.inv(hessian))) * (1 + ROOM)
    lower, upper = (np.array(end, float) for end in free)
    lower[inside], upper[inside] = centre - half, centre + half
    lower, upper = np.maximum(lower, free[0]), np.minimum(upper, free[1])
    made_set = Absorbing(lower, upper, f=f, v=v, level=float(level), rate=rate, inputs=inputs, within=within)
    verdict = made_set.verify()
    if not verdict:
        raise Infeasible(verdict.why, 0.0, "Choose another V, or a smaller rate.")
    return made_set


def _polynomials(f: Any, v: Any, inputs: Any, n: int) -> tuple[Polynomial, Polynomial]:
    """V and V' = grad V f in x1 .. xn and what else enters f, multiplied out."""
    made = system("absorbing", f, inputs)
    if made.step:
        raise refuse("absorbing", "f", type(f).__name__, "a flow, x' = f", "Steps need another inequality.")

    require_derivatives("absorbing", v, n)

    def rate(x, w):
        return jax.jvp(v, (x,), (made.f(x, w),))[1][None]

    m = len(made.lower)
    change = graph.trace(rate, n, m) if m else graph.trace(lambda x: rate(x, x[:0]), n)
    energy = graph.trace(lambda x: v(x)[None], n)
    quadratic = polynomial(energy.graph, energy.outputs[0])
    if any(sum(power for _, power in monomial) > 2 for monomial in quadratic):
        raise refuse("absorbing", "v", "a polynomial of higher degree", "a quadratic polynomial of x", "For example x @ P @ x.")
    return quadratic, polynomial(change.graph, change.outputs[0])


def _support(energy: Polynomial, n: int) -> list[int]:
    return sorted({i for monomial in energy for i, _ in monomial if i < n})


def _sum(*parts: tuple[Fraction, Polynomial]) -> Polynomial:
    total: Polynomial = {}
    for k, terms in parts:
        for monomial, x in terms.items():
            total[monomial] = total.get(monomial, Fraction(0)) + k * x
    return {monomial: x for monomial, x in total.items() if x}


def _form(terms: Polynomial, inside: list[int]) -> list[list[Polynomial]] | None:
    """Q with 2 terms = (1, x)'Q (1, x), x = z[inside], entries polynomials of the other variables; None if not quadratic."""
    place = {i: 1 + k for k, i in enumerate(inside)}
    form: list[list[Polynomial]] = [[{} for _ in range(1 + len(inside))] for _ in range(1 + len(inside))]
    for monomial, k in terms.items():
        own = [i for i, power in monomial if i in place for _ in range(power)]
        if len(own) > 2:
            return None
        row, column = [0, 0, *sorted(place[i] for i in own)][-2:]
        rest = tuple((i, power) for i, power in monomial if i not in place)
        for a, b in {(row, column), (column, row)}:
            form[a][b][rest] = form[a][b].get(rest, Fraction(0)) + (2 * k if row == column else k)
    return form


def _numbers(form: list[list[Polynomial]], z: np.ndarray) -> np.ndarray:
    def value(terms: Polynomial) -> float:
        return float(sum(float(k) * np.prod([z[i] ** power for i, power in monomial]) for monomial, k in terms.items()))

    return np.array([[value(entry) for entry in row] for row in form])


def _negative(terms: Polynomial, inside: list[int], lower: np.ndarray, upper: np.ndarray) -> bool:
    """terms < 0 for all values of z[inside], and for the other variables in their box: exactly where these do not enter."""
    form = _form(terms, inside)
    if form is None:
        return False
    if all(not rest for row in form for entry in row for rest in entry):
        return exact.is_positive_definite([[-entry.get((), Fraction(0)) for entry in row] for row in form])
    low, high = lower.copy(), upper.copy()
    low[inside], high[inside] = -np.inf, np.inf
    return bool(is_negative(of_polynomial(terms), Interval(low, high), max_boxes=2000))


def _peak(
    energy: Polynomial, decay: Polynomial, inside: list[int], lower: np.ndarray, upper: np.ndarray
) -> Callable[[float], float]:
    """rate -> about max (V + V' / rate), at corners of the other variables' box and points in it; infinite if there is none."""
    forms = _form(energy, inside), _form(decay, inside)
    if forms[0] is None or forms[1] is None:
        return lambda rate: np.inf
    others = sorted({i for form in forms for row in form or [] for entry in row for rest in entry for i, _ in rest})
    if not np.all(np.isfinite(lower[others]) & np.isfinite(upper[others])):
        return lambda rate: np.inf
    share = np.random.default_rng(0).random((TRIALS, len(others)))
    share[: TRIALS // 2] = np.round(share[: TRIALS // 2])
    points = np.zeros((TRIALS, len(lower)))
    points[:, others] = lower[others] + share * (upper - lower)[others]
    points = np.unique(points, axis=0)
    own, change = (np.stack([_numbers(form or [], z) for z in points]) for form in forms)

    def peak(rate: float) -> float:
        q = own + change / rate
        if np.max(np.linalg.eigvalsh(q[:, 1:, 1:])) >= 0:
            return np.inf
        best = np.linalg.solve(q[:, 1:, 1:], q[:, 1:, :1])[:, :, 0]
        return float(np.max(q[:, 0, 0] - np.sum(q[:, 0, 1:] * best, axis=1)) / 2)

    return peak


def _outside(energy: Polynomial, level: float, i: int, inside: list[int], end: float, sign: int) -> Polynomial:
    """sign (x_i - end) + m (level - V), m > 0 such that it is least: if it is negative, x_i is inside of end on V <= level."""
    q = _numbers(_form(energy, inside) or [], np.zeros(1 + max(inside)))
    inverse = np.linalg.inv(q[1:, 1:])
    height = level - (q[0, 0] - q[0, 1:] @ inverse @ q[0, 1:]) / 2
    k = inside.index(i)
    m = Fraction(float(np.sqrt(inverse[k, k] / (2 * height))))
    ahead = {((i, 1),): Fraction(sign), (): -sign * Fraction(end) + m * Fraction(level)}
    return _sum((UNIT, ahead), (-m, energy))
