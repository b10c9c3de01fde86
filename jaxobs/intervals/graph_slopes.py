"""Derivatives of exact formulas, as exact formulas."""

from fractions import Fraction
from typing import Any

from jaxobs.intervals.formulas import ZERO, Expression, Graph, combine, constant

RULES: dict[str, Any] = {  # d name(e) / de, where own = name(e)
    "sin": lambda g, e, own: g.atom("cos", e),
    "cos": lambda g, e, own: combine((-1, g.atom("sin", e))),
    "tanh": lambda g, e, own: combine((1, constant(1)), (-1, g.power(own, 2))),
    "exp": lambda g, e, own: own,
    "log": lambda g, e, own: g.power(e, -1),
    "sqrt": lambda g, e, own: combine((Fraction(1, 2), g.power(own, -1))),
    "atan": lambda g, e, own: g.power(combine((1, constant(1)), (1, g.power(e, 2))), -1),
    "erf": lambda g, e, own: g.times(_two_over_root_pi(g), g.atom("exp", combine((-1, g.power(e, 2))))),
}


def _two_over_root_pi(g: Graph) -> Expression:
    """2 / sqrt(pi) = 1 / sqrt(atan 1)."""
    return g.power(g.atom("sqrt", g.atom("atan", constant(1))), -1)


def slopes(g: Graph, expressions: list[Expression], variable: int) -> list[Expression]:
    """The derivatives along one variable. Where a minimum or a switch is undecided, that of one branch: the enclosure over
    both branches contains the generalised gradient of a continuous function."""
    known: dict[int, Expression] = {}

    def total(e: Expression) -> Expression:
        return combine(*((k, known[i]) for i, k in e.terms))

    for i in g.nodes(expressions):
        known[i] = _atom(g, i, variable, total)
    return [total(e) for e in expressions]


def _atom(g: Graph, i: int, variable: int, total: Any) -> Expression:
    name, *args = g.atoms[i]
    if name == "x":
        return constant(args[0] == variable)
    inner = [total(e) for e in args if isinstance(e, Expression)]
    if name == "min":
        return g.where(combine((1, args[0]), (-1, args[1])), *inner)
    if name == "<=":
        return g.where(args[0], *inner[1:])
    if name == "*":
        return combine((1, g.times(inner[0], args[1])), (1, g.times(args[0], inner[1])))
    if inner[0] == ZERO:
        return ZERO
    if name == "^":
        return g.times(combine((args[1], g.power(args[0], args[1] - 1))), inner[0])
    return g.times(RULES[name](g, args[0], Expression(Fraction(0), ((i, Fraction(1)),))), inner[0])
