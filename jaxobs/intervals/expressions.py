"""Exact formulas put to use: as JAX functions, multiplied out, over one period."""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import reduce
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse
from jaxobs.intervals.formulas import Expression, Graph
from jaxobs.intervals.interval import Interval

Monomial = tuple[tuple[int, int], ...]  # ((variable, power), ...)
Polynomial = dict[Monomial, Fraction]
FUNCTIONS = {name: getattr(jnp, name) for name in ("sin", "cos", "tanh", "exp", "log", "sqrt")}
FUNCTIONS |= {"atan": jnp.arctan, "erf": jax.scipy.special.erf}
PI = Fraction(355, 113)  # above pi by less than 3e-7


def as_function(graph: Graph, expressions: Sequence[Expression]) -> Callable[[Any], Any]:
    """z (N,) -> the values (r,) of the expressions; its only roundings are those of its operations, which intervals enclose."""

    def total(constant: Fraction, parts: Sequence[tuple[Fraction, Any]]) -> Any:
        values = [_times(k, value) for k, value in parts]
        return reduce(jnp.add, values if values and constant == 0 else [*values, _number(constant)])

    rules = {
        "+": total,
        "*": jnp.multiply,
        "^": jax.lax.integer_pow,
        "min": jnp.minimum,
        "<=": lambda e, yes, no: jnp.where(e <= 0, yes, no),
        **FUNCTIONS,
    }
    return lambda z: jnp.stack([value + jnp.zeros_like(z[0]) for value in graph.evaluate(expressions, list(z), rules)])


def polynomial(graph: Graph, expression: Expression) -> Polynomial:
    """{((variable, power), ...): coefficient} of an expression made of sums, products and powers, multiplied out exactly.

    ValueError for any other operation.
    """

    def total(constant: Fraction, parts: Sequence[tuple[Fraction, Polynomial]]) -> Polynomial:
        found: Polynomial = {(): constant}
        for k, terms in parts:
            for monomial, x in terms.items():
                found[monomial] = found.get(monomial, Fraction(0)) + k * x
        return {monomial: x for monomial, x in found.items() if x}

    def power(base: Polynomial, n: int) -> Polynomial:
        if n < 0:
            raise refuse("polynomial", "expression", f"a power {n}", "sums, products and powers", "It is no polynomial.")
        return reduce(_product, [base] * n, {(): Fraction(1)})

    variables = [{((k, 1),): Fraction(1)} for k in range(len(graph.variables))]
    try:
        return graph.evaluate([expression], variables, {"+": total, "*": _product, "^": power})[0]
    except KeyError as error:
        given, fix = f"the operation {error.args[0]!r}", "It is no polynomial."
        raise refuse("polynomial", "expression", given, "sums, products and powers", fix) from error


def of_polynomial(terms: Polynomial) -> Callable[[Any], Any]:
    """z (N,) -> the value of the polynomial."""

    def value(z):
        total = jnp.zeros_like(z[0])
        for monomial, k in terms.items():
            factors = [jax.lax.integer_pow(z[i], n) for i, n in monomial]
            total = total + _times(k, reduce(jnp.multiply, factors, jnp.ones_like(z[0])))
        return total

    return value


def one_period(graph: Graph, expression: Expression, z: Interval) -> Interval:
    """The box, with one period for each unbounded variable that enters the expression in sin(a z_k + ...) and cos only."""
    lower, upper = z.lower.copy(), z.upper.copy()
    for k in np.flatnonzero(np.isinf(lower) & np.isinf(upper)):
        slopes = _frequencies(graph, expression, int(k))
        if slopes:
            common = math.lcm(*(slope.denominator for slope in slopes))
            base = Fraction(math.gcd(*(int(slope * common) for slope in slopes)), common)
            upper[k] = math.nextafter(float(PI / base), math.inf)
            lower[k] = -upper[k]
    return Interval(lower, upper)


def _frequencies(graph: Graph, expression: Expression, k: int) -> set[Fraction] | None:
    """The |a| of all sin(a z_k + rest) and cos(a z_k + rest), the rest without z_k; None if z_k occurs elsewhere too."""
    found, nodes = set(), graph.nodes([expression])
    variable = next((i for i in nodes if graph.atoms[i] == ("x", k)), None)
    if variable is None or any(i == variable for i, _ in expression.terms):
        return None
    for i in nodes:
        name, *parts = graph.atoms[i]
        slopes = [abs(x) for part in parts if isinstance(part, Expression) for j, x in part.terms if j == variable]
        if slopes and name not in ("sin", "cos"):
            return None
        found.update(slopes)
    return found


def _product(a: Polynomial, b: Polynomial) -> Polynomial:
    found: Polynomial = {}
    for left, x in a.items():
        for right, y in b.items():
            powers = dict(left)
            for k, n in right:
                powers[k] = powers.get(k, 0) + n
            monomial = tuple(sorted(powers.items()))
            found[monomial] = found.get(monomial, Fraction(0)) + x * y
    return {monomial: x for monomial, x in found.items() if x}


def is_float(x: Fraction) -> bool:
    """Whether rounding to a float changes nothing."""
    try:
        return Fraction(float(x)) == x
    except OverflowError:
        return False


def _times(k: Fraction, value: Any) -> Any:
    return value if k == 1 else _number(k) * value


def _number(k: Fraction) -> Any:
    """A float, or where k is none a quotient of sums of floats, exactly k before rounding."""
    if is_float(k):
        return jnp.float64(float(k))
    above, below = (reduce(jnp.add, map(jnp.float64, _floats(part))) for part in (k.numerator, k.denominator))
    return above / below


def _floats(n: int) -> list[float]:
    """Floats whose sum is n exactly."""
    parts = []
    while n:
        parts.append(float(n))
        n -= int(parts[-1])
    return parts
