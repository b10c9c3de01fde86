"""Exact formulas: expressions that are equal are equal data.

An expression is a constant plus a sum of coefficients times atoms, in fractions; an atom is a variable or a nonlinear
operation on expressions, and has a number. So structural zeros, equal entries and proportional entries of a matrix of
expressions are seen without any search for identities.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

ONE = Fraction(1)
LONGEST = 2000  # characters of a part of a formula, for reading
FUNCTIONS = ("sin", "cos", "tanh", "exp", "log", "sqrt", "atan", "erf")
EXACT = {"sin": (0, 0), "cos": (0, 1), "tanh": (0, 0), "exp": (0, 1), "log": (1, 0), "atan": (0, 0), "erf": (0, 0)}  # f(a) = b


@dataclasses.dataclass(frozen=True, order=True)
class Expression:
    """constant + sum_k coefficient_k atom_k, terms = ((atom_k, coefficient_k), ...) with increasing atoms, no coefficient 0."""

    constant: Fraction
    terms: tuple[tuple[int, Fraction], ...] = ()

    @property
    def is_zero(self) -> bool:
        return not self.terms and self.constant == 0

    @property
    def is_constant(self) -> bool:
        return not self.terms

    def split(self) -> tuple[Fraction, Fraction, "Expression"]:
        """(constant, factor, core) with self = constant + factor core, the core without constant and with first coefficient 1;
        factor 0 for constants. Two expressions are proportional, up to constants, where their cores are equal."""
        if not self.terms:
            return self.constant, Fraction(0), ZERO
        factor = self.terms[0][1]
        return self.constant, factor, Expression(Fraction(0), tuple((i, x / factor) for i, x in self.terms))


ZERO = Expression(Fraction(0))


def constant(x: Any) -> Expression:
    """A number as an expression, exactly."""
    return Expression(Fraction(x))


def combine(*parts: tuple[Any, Expression]) -> Expression:
    """The sum of coefficient times expression."""
    total, terms = Fraction(0), {}
    for k, e in parts:
        total += Fraction(k) * e.constant
        for i, x in e.terms:
            terms[i] = terms.get(i, 0) + k * x
    return Expression(total, tuple((i, x) for i, x in sorted(terms.items()) if x))


class Graph:
    """The numbered operations of a graph: (name, expressions..., [an integer]).

    ("x", k) the k-th variable; ("*", e, f); ("^", e, n), n an integer, also negative; ("min", e, f); ("<=", e, f, g), which is
    f where e <= 0 and g elsewhere; and the functions of FUNCTIONS. Factors and bases have the first coefficient 1, so that
    proportional expressions share an atom.
    """

    def __init__(self, variables: Sequence[str]):
        self.variables = tuple(variables)
        self.atoms: list[tuple[Any, ...]] = []
        self._numbers: dict[tuple[Any, ...], int] = {}

    def atom(self, *key: Any) -> Expression:
        if key[0] in FUNCTIONS and key[1].is_constant and (value := _exact(key[0], key[1].constant)) is not None:
            return Expression(value)
        number = self._numbers.setdefault(key, len(self.atoms))
        if number == len(self.atoms):
            self.atoms.append(key)
        return self._alone(number)

    def times(self, e: Expression, f: Expression) -> Expression:
        if e.is_constant or f.is_constant:
            return combine((e.constant, f) if e.is_constant else (f.constant, e))
        (k, e), (m, f) = _normal(e), _normal(f)
        (base, power), (other, more) = self._as_power(e), self._as_power(f)
        if base == other and (power > 0) == (more > 0):  # x x^2; but x / x is left as it is, without value at 0
            return combine((k * m, self.power(base, power + more)))
        return combine((k * m, self.atom("*", *sorted((e, f)))))

    def _as_power(self, e: Expression) -> tuple[Expression, int]:
        """(base, n) with e = base^n."""
        if len(e.terms) == 1 and e.constant == 0:
            name, *args = self.atoms[e.terms[0][0]]
            if name == "^":
                return args[0], args[1]
        return e, 1

    def power(self, e: Expression, n: int) -> Expression:
        if n in (0, 1):
            return e if n else constant(1)
        if e.is_constant:
            return constant(e.constant**n)
        k, e = _normal(e)
        base, m = self._as_power(e)
        return combine((k**n, self.atom("^", base, m * n) if m > 0 and n > 0 else self.atom("^", e, n)))

    def over(self, e: Expression, f: Expression) -> Expression:
        return self.times(e, self.power(f, -1))

    def least(self, e: Expression, f: Expression) -> Expression:
        if e.is_constant and f.is_constant:
            return min(e, f)
        return e if e == f else self.atom("min", *sorted((e, f)))

    def where(self, e: Expression, yes: Expression, no: Expression) -> Expression:
        """yes where e <= 0, no elsewhere."""
        if yes == no or e.is_constant:
            return yes if yes == no or e.constant <= 0 else no
        k, _ = _normal(e)
        return self.atom("<=", combine((1 / abs(k), e)), yes, no)

    def nodes(self, expressions: Iterable[Expression]) -> list[int]:
        """The atoms on which these expressions stand, in order."""
        found, waiting = set(), [i for e in expressions for i, _ in e.terms]
        while waiting:
            if (i := waiting.pop()) not in found:
                found.add(i)
                waiting += [j for part in self.atoms[i] if isinstance(part, Expression) for j, _ in part.terms]
        return sorted(found)

    def support(self, e: Expression) -> set[int]:
        """The variables on which an expression depends."""
        return {self.atoms[i][1] for i in self.nodes([e]) if self.atoms[i][0] == "x"}

    def jumps(self, expressions: Sequence[Expression]) -> tuple[str, ...]:
        """The formulas at whose sign these expressions switch."""
        switches = [self.atoms[i] for i in self.nodes(expressions) if self.atoms[i][0] == "<="]
        return tuple(dict.fromkeys(f"{self.text(e)} = 0" for _, e, *_ in switches))

    def evaluate(self, expressions: Sequence[Expression], values: Sequence[Any], rules: Mapping[str, Any]) -> list[Any]:
        """The expressions where the variables have these values, in an arithmetic of your own.

        rules: "+" of (constant, [(coefficient, value), ...]), all Fractions; "^" of (value, integer); "*", "min", "<=" and the
        functions of FUNCTIONS of values.
        """
        known: dict[int, Any] = {}

        def total(e: Expression) -> Any:
            return rules["+"](e.constant, [(k, known[i]) for i, k in e.terms])

        for i in self.nodes(expressions):
            name, *parts = self.atoms[i]
            args = [total(part) if isinstance(part, Expression) else part for part in parts]
            known[i] = values[args[0]] if name == "x" else rules[name](*args)
        return [total(e) for e in expressions]

    def text(self, e: Expression) -> str:
        """The formula, in decimals of 6 digits; parts of more than 2000 characters are only named."""
        known: dict[int, str] = {}
        for i in self.nodes([e]):
            name, *parts = self.atoms[i]
            args = [_sum(part, known) if isinstance(part, Expression) else part for part in parts]
            text = self.variables[parts[0]] if name == "x" else _WRITTEN.get(name, f"{name}({{}})").format(*args)
            known[i] = text if len(text) < LONGEST else f"[{name} of {len(self.support(self._alone(i)))} variables]"
        return _sum(e, known)

    def _alone(self, i: int) -> Expression:
        return Expression(Fraction(0), ((i, ONE),))


_WRITTEN = {"*": "({})*({})", "^": "({})^{}", "min": "min({}, {})", "<=": "({} <= 0 ? {} : {})"}


def _sum(e: Expression, known: Mapping[int, str]) -> str:
    parts = [known[i] if k == 1 else f"-{known[i]}" if k == -1 else f"{float(k):.6g}*{known[i]}" for i, k in e.terms]
    if e.constant or not parts:
        parts.append(f"{float(e.constant):.6g}")
    return " + ".join(parts).replace("+ -", "- ")


def _exact(name: str, x: Fraction) -> Fraction | None:
    """The value of a function at a number, where it is a fraction."""
    if name == "sqrt":
        roots = [math.isqrt(part) for part in (max(x.numerator, 0), x.denominator)]
        return Fraction(*roots) if Fraction(*roots) ** 2 == x else None
    at, value = EXACT[name]
    return Fraction(value) if x == at else None


def _normal(e: Expression) -> tuple[Fraction, Expression]:
    """(k, e / k), k the first coefficient."""
    k = e.terms[0][1]
    return k, combine((1 / k, e))
