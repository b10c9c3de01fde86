"""What each JAX primitive is in formulas, element by element."""

import dataclasses
import math
from collections.abc import Callable
from fractions import Fraction
from functools import reduce
from typing import Any

import numpy as np

from jaxobs.intervals.formulas import FUNCTIONS, Expression, Graph, combine, constant
from jaxobs.intervals.table import UnknownPrimitiveError


@dataclasses.dataclass(frozen=True)
class Predicate:
    """kind "<=": parts[0] <= 0; "not", "and", "or" of predicates."""

    kind: str
    parts: tuple[Any, ...]


Element = Expression | Predicate | bool | np.bool_


def element(x: Any) -> Element:
    """An entry of a known array: truth values stay, numbers become constants."""
    if isinstance(x, Element):
        return x
    number = x.item() if isinstance(x, np.generic) else x
    if isinstance(number, float) and not math.isfinite(number):
        raise UnknownPrimitiveError(f"the number {number} has no formula. Write the function without it.")
    return constant(number)


def choose(graph: Graph, which: Any, yes: Any, no: Any) -> Any:
    """yes where the predicate holds, no elsewhere."""
    if not isinstance(which, Predicate):
        return yes if which else no
    if isinstance(yes, Predicate | bool | np.bool_):
        return _or(_and(which, yes), _and(_not(which), no))
    if which.kind == "<=":
        return graph.where(which.parts[0], yes, no)
    if which.kind == "not":
        return choose(graph, which.parts[0], no, yes)
    p, q = which.parts
    if which.kind == "and":
        return choose(graph, p, choose(graph, q, yes, no), no)
    return choose(graph, p, yes, choose(graph, q, yes, no))


def _not(p: Any) -> Any:
    return Predicate("not", (p,)) if isinstance(p, Predicate) else not p


def _and(p: Any, q: Any) -> Any:
    known = [x for x in (p, q) if not isinstance(x, Predicate)]
    if not all(known):
        return False
    return Predicate("and", (p, q)) if not known else q if p is known[0] else p


def _or(p: Any, q: Any) -> Any:
    return _not(_and(_not(p), _not(q)))


def _at_most(e: Expression) -> Any:
    return bool(e.constant <= 0) if e.is_constant else Predicate("<=", (e,))


def _minus(e: Expression) -> Expression:
    return combine((-1, e))


def _difference(e: Expression, f: Expression) -> Expression:
    return combine((1, e), (-1, f))


def _equal(g: Graph, e: Any, f: Any) -> Any:
    if not isinstance(e, Expression):
        return _or(_and(e, f), _and(_not(e), _not(f)))
    return _and(_at_most(_difference(e, f)), _at_most(_difference(f, e)))


def _power(g: Graph, e: Expression, f: Expression) -> Expression:
    """e^f; e > 0 unless f is an integer, or half of one and e >= 0."""
    if f.is_constant and f.constant.denominator == 1:
        return g.power(e, int(f.constant))
    if f.is_constant and f.constant.denominator == 2:
        return g.power(g.atom("sqrt", e), int(2 * f.constant))
    return g.atom("exp", g.times(f, g.atom("log", e)))


def _tanh(g: Graph, e: Expression, scale: Fraction = Fraction(1)) -> Expression:
    return g.atom("tanh", combine((scale, e)))


def largest(g: Graph, e: Expression, f: Expression) -> Expression:
    """max(e, f) = -min(-e, -f)."""
    return _minus(g.least(_minus(e), _minus(f)))


def _sign(g: Graph, e: Expression) -> Expression:
    return choose(g, _at_most(e), choose(g, _at_most(_minus(e)), constant(0), constant(-1)), constant(1))


HALF = Fraction(1, 2)
ELEMENTWISE: dict[str, Callable[..., Any]] = {
    "add": lambda g, e, f: combine((1, e), (1, f)),
    "add_any": lambda g, e, f: combine((1, e), (1, f)),
    "sub": lambda g, e, f: _difference(e, f),
    "mul": lambda g, e, f: g.times(e, f),
    "div": lambda g, e, f: g.times(e, g.power(f, -1)),
    "neg": lambda g, e: _minus(e),
    "square": lambda g, e: g.power(e, 2),
    "integer_pow": lambda g, e, y: g.power(e, y),
    "pow": _power,
    "max": largest,
    "min": lambda g, e, f: g.least(e, f),
    "abs": lambda g, e: largest(g, e, _minus(e)),
    "sign": _sign,
    "clamp": lambda g, low, e, high: g.least(largest(g, low, e), high),
    **{name: (lambda g, e, name=name: g.atom(name, e)) for name in FUNCTIONS},
    "tan": lambda g, e: g.times(g.atom("sin", e), g.power(g.atom("cos", e), -1)),
    "rsqrt": lambda g, e: g.power(g.atom("sqrt", e), -1),
    "logistic": lambda g, e: combine((HALF, constant(1)), (HALF, _tanh(g, e, HALF))),
    "log1p": lambda g, e: g.atom("log", combine((1, constant(1)), (1, e))),
    "expm1": lambda g, e: combine((1, g.atom("exp", e)), (-1, constant(1))),
    "erfc": lambda g, e: combine((1, constant(1)), (-1, g.atom("erf", e))),
    "sinh": lambda g, e: combine((HALF, g.atom("exp", e)), (-HALF, g.atom("exp", _minus(e)))),
    "cosh": lambda g, e: combine((HALF, g.atom("exp", e)), (HALF, g.atom("exp", _minus(e)))),
    "le": lambda g, e, f: _at_most(_difference(e, f)),
    "ge": lambda g, e, f: _at_most(_difference(f, e)),
    "lt": lambda g, e, f: _not(_at_most(_difference(f, e))),
    "gt": lambda g, e, f: _not(_at_most(_difference(e, f))),
    "eq": _equal,
    "ne": lambda g, e, f: _not(_equal(g, e, f)),
    "and": lambda g, p, q: _and(p, q),
    "or": lambda g, p, q: _or(p, q),
    "not": lambda g, p: _not(p),
    **dict.fromkeys(("stop_gradient", "copy", "copy_p", "name", "optimization_barrier"), lambda g, e: e),
}

REDUCE: dict[str, Callable[[Graph, list[Any]], Any]] = {
    "reduce_sum": lambda g, es: combine(*((1, e) for e in es)),
    "reduce_prod": lambda g, es: reduce(g.times, es, constant(1)),
    "reduce_max": lambda g, es: reduce(lambda e, f: largest(g, e, f), es),
    "reduce_min": lambda g, es: reduce(g.least, es),
    "reduce_and": lambda g, es: reduce(_and, es, True),
    "reduce_or": lambda g, es: reduce(_or, es, False),
}


def contract(g: Graph, dimensions: Any, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """`dot_general`: the batch axes first, then those of x, then those of y."""
    (cx, cy), (bx, by) = dimensions
    left, batch, rows = _in_three(x, list(bx), list(cx))
    right, _, columns = _in_three(y, list(by), list(cy))
    flat = np.empty((left.shape[0], left.shape[1], right.shape[1]), object)
    for b, i, j in np.ndindex(flat.shape):
        flat[b, i, j] = combine(*((1, g.times(e, f)) for e, f in zip(left[b, i], right[b, j], strict=True)))
    return flat.reshape((*batch, *rows, *columns))


def _in_three(z: np.ndarray, batch: list[int], contracted: list[int]) -> tuple[np.ndarray, tuple[int, ...], tuple[int, ...]]:
    """z as (batch, free, contracted), and the shapes of the first two."""
    free = [k for k in range(z.ndim) if k not in (*batch, *contracted)]
    shape = [tuple(z.shape[k] for k in axes) for axes in (batch, free, contracted)]
    return z.transpose(*batch, *free, *contracted).reshape([int(np.prod(s)) for s in shape]), shape[0], shape[1]
