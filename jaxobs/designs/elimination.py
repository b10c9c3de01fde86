"""The map x = phi(y, y', ..., u, u', ...) of a polynomial system, by elimination (needs sympy: the extra `jaxobs[algebra]`)."""

import dataclasses
import importlib
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import jax.numpy as jnp

from jaxobs._module import dtype_of, refuse, require_instance, require_integer
from jaxobs.designs._symbolic import evaluate
from jaxobs.observers import RationalMap
from jaxobs.plants import AbstractFlowPlant


def algebra() -> Any:
    """sympy, imported when it is needed. ImportError that says how to get it."""
    try:
        return importlib.import_module("sympy")
    except ImportError as error:
        raise ImportError("Elimination needs sympy. Install it with `pip install 'jaxobs[algebra]'`.") from error


@dataclasses.dataclass(frozen=True)
class Relation:
    """One state's equation `polynomial` = 0 in (x_i, y, y', ..., u, ...), of degree `degree` in x_i.

    degree 1: x_i = numerator / denominator. Otherwise x_i is one of `degree` roots, and `denominator` is the leading
    coefficient. on_trajectories: the denominator with the true derivatives put in, a polynomial in x and u: where it vanishes,
    this relation does not determine x_i.
    """

    state: Any
    polynomial: Any
    degree: int
    numerator: Any
    denominator: Any
    on_trajectories: Any


@dataclasses.dataclass(frozen=True)
class Elimination:
    """x = phi(y, ..., y^(order), u, ..., u^(input_order)), one relation a state; y and u (m, input_order + 1) are symbols."""

    model: AbstractFlowPlant | None
    relations: tuple[Relation, ...]
    states: tuple[Any, ...]
    y: tuple[Any, ...]
    u: tuple[tuple[Any, ...], ...]

    @property
    def order(self) -> int:
        return len(self.y) - 1

    def map(self, model: AbstractFlowPlant | None = None) -> RationalMap:
        """The rational map as a part of an observer; `model` where the system was not given as a plant.

        ValueError if a relation has a degree above 1: its root has to be chosen by hand, or one more derivative makes it
        rational.
        """
        model = self.model if model is None else model
        require_instance("map", "model", model, AbstractFlowPlant, "The observer starts from the plant's derivatives.")
        assert model is not None
        sympy, variables = algebra(), (*self.y, *(v for row in self.u for v in row))
        tables, numbers = [], []
        for one in self.relations:
            if one.degree != 1:
                given = f"{one.state} as a root of degree {one.degree}: {one.polynomial} = 0"
                raise refuse("map", "relations", given, "degree 1", "Eliminate with one more derivative: order + 1.")
            for part in (one.numerator, one.denominator):
                terms = sympy.Poly(part, *variables).terms()
                tables.append(tuple(tuple(int(e) for e in exponents) for exponents, _ in terms))
                numbers += [float(value) for _, value in terms]
        input_order = len(self.u[0]) - 1 if self.u else 0
        return RationalMap(model, self.order, input_order, tuple(tables), jnp.asarray(numbers, dtype_of(model)))


def derivatives(f: Sequence[Any], h: Any, states: Sequence[Any], u: Sequence[Sequence[Any]], order: int) -> list[Any]:
    """(y, y', ..., y^(order)) as polynomials in the states and in u (m rows: u_i, u_i', ...); h for the first of them."""
    sympy, found = algebra(), [h]
    for _ in range(order):
        last = found[-1]
        along = sum(sympy.diff(last, x) * g for x, g in zip(states, f, strict=True))
        along += sum(sympy.diff(last, row[k]) * row[k + 1] for row in u for k in range(len(row) - 1))
        found.append(sympy.expand(along))
    return found


def eliminate(
    system: AbstractFlowPlant | tuple[Sequence[Any], Any, Sequence[Any], Sequence[Any]], *, order: int | None = None
) -> Elimination:
    """The state from the output's derivatives: for each x_i a relation in (x_i, y, y', ..., u, u', ...) from the ideal of

        y^(k) - L_k(x, u, u', ...),   k = 0..order,      L_0 = h,      L_{k+1} = dL_k/dx f + sum_r dL_k/du^(r) u^(r+1),

    by Groebner bases with all states but one eliminated; of all relations for x_i that of the least degree in x_i, then that
    whose denominator has the least degree on the trajectories (the fewest places where it vanishes), then that of the least
    total degree.

    system: a plant with one output whose flow and h are polynomials (its numbers are taken exactly as the floats they are), or
    (f, h, states, inputs) in sympy. order: how many derivatives; None takes the smallest number, from n - 1 to 2 n, that makes
    every x_i rational. Groebner bases can take minutes: three states with products seen through an awkward output are near
    the limit. ValueError if the derivatives do not determine some state (then no map of this order exists), for what is not
    polynomial, a plant with several outputs and an order that is no integer >= 0; ImportError without sympy. Source: paper 001,
    (39); Cox, Little and O'Shea, Ideals, Varieties, and Algorithms, chapter 3 (elimination).
    """
    sympy = algebra()
    if isinstance(system, AbstractFlowPlant):
        if system.p != 1:
            raise refuse("eliminate", "system", f"{system.p} outputs", "one output", "Choose one of them.")
        states, inputs = sympy.symbols(f"x1:{system.n + 1}"), sympy.symbols(f"u1:{system.m + 1}")
        f = evaluate(lambda x, u: system.flow(jnp.zeros((), dtype_of(system)), x, u), dtype_of(system), states, inputs)
        h = evaluate(system.h, dtype_of(system), states, inputs)[0]
    else:
        f, h, states, inputs = system
    for expression in (*f, h):
        if not sympy.sympify(expression).is_polynomial(*states, *inputs):
            fix = "Elimination is for polynomial systems; write the map by hand otherwise (AbstractAlgebraicMap)."
            raise refuse("eliminate", "system", str(expression), "a polynomial in states and inputs", fix)
    n, model = len(states), system if isinstance(system, AbstractFlowPlant) else None
    if order is not None:
        require_integer("eliminate", "order", order, 0, "It counts the derivatives of y that may be used.")
    orders = range(max(n - 1, 1), 2 * n + 1) if order is None else (order,)
    found, missing = None, None
    for tried in orders:
        outcome = _of_order(model, f, h, states, inputs, tried)
        if isinstance(outcome, Elimination):
            found = outcome
            if all(one.degree == 1 for one in found.relations):
                break
        else:
            missing = outcome
    if found is None:
        fix = "Use more derivatives; if 2 n do not help either, another output is needed."
        raise refuse("eliminate", "order", orders[-1], f"derivatives that determine {missing}", fix)
    return found


def _of_order(model: Any, f: Any, h: Any, states: Any, inputs: Any, order: int) -> Any:
    """The Elimination, or the symbol of a state that stays undetermined."""
    sympy = algebra()
    y = sympy.symbols(f"y:{order + 1}")
    u = tuple((v, *sympy.symbols(f"{v}_1:{order + 1}")) for v in inputs)
    jet = derivatives(f, h, states, u, order)
    used = [k for row in u for k, v in enumerate(row) if any(expression.has(v) for expression in jet)]
    u = tuple(row[: max(used, default=0) + 1] for row in u)
    flat = [v for row in u for v in row]
    equations = [sympy.expand(a - b) for a, b in zip(y, jet, strict=True)]
    on_track = dict(zip(y, jet, strict=True))

    def ranked(x: Any, candidates: list[Any]) -> list[Any]:
        """(rank, relation) of those whose leading coefficient does not vanish on every trajectory."""
        out = []
        for p in candidates:
            leading = sympy.expand(p.LC().subs(on_track))
            if leading != 0:
                whole = sympy.Poly(p.as_expr(), x, *y, *flat).clear_denoms()[1].primitive()[1]
                zeros = sympy.Poly(leading, *states, *flat).total_degree()
                out.append(((p.degree(), zeros, whole.total_degree()), sympy.Poly(whole.as_expr(), x)))
        return sorted(out, key=lambda one: one[0])

    relations = []
    for x in states:
        found = ranked(x, _free_of_others(equations, x, states, (*reversed(y), *flat), graded=True))
        if (
            not found or found[0][0][0] > 1
        ):  # the lexicographic basis holds a relation of the least degree in x, if not the best
            found = sorted(found + ranked(x, _free_of_others(equations, x, states, (*reversed(y), *flat), graded=False)),
                           key=lambda one: one[0])  # fmt: skip
        if not found:
            return x
        p = found[0][1]
        numerator = -p.coeff_monomial(1) if p.degree() == 1 else None
        leading = sympy.factor(sympy.expand(p.LC().subs(on_track)))
        relations.append(Relation(x, p.as_expr(), int(p.degree()), numerator, p.LC(), leading))
    return Elimination(model, tuple(relations), tuple(states), tuple(y), u)


def _free_of_others(equations: Any, x: Any, states: Any, known: Any, *, graded: bool) -> list[Any]:
    """A Groebner basis of what the equations say about x and the known symbols alone, as polynomials in x."""
    sympy = algebra()
    others = [other for other in states if other != x]
    count, grevlex = len(others), sympy.polys.orderings.grevlex

    def block(monomial: Any) -> Any:  # the other states first; inside each block by total degree, which keeps relations small
        return grevlex(monomial[:count]), grevlex(monomial[count:])

    order = block if graded else "lex"
    basis = sympy.groebner(equations, *others, x, *known, order=order, domain="QQ")
    return [sympy.Poly(p, x) for p in basis.exprs if p.has(x) and not any(p.has(other) for other in others)]


def bound_on_box(expression: Any, box: dict[Any, float]) -> Fraction:
    """sum of |coefficient| prod box^exponent >= |expression| wherever |symbol| <= box[symbol]; exact, from the floats given."""
    poly = algebra().Poly(expression, *box)
    sides = [Fraction(float(side)) for side in box.values()]
    total = Fraction(0)
    for exponents, value in poly.terms():
        term = abs(Fraction(int(value.p), int(value.q)))
        for side, exponent in zip(sides, exponents, strict=True):
            term *= side**exponent
        total += term
    return total
