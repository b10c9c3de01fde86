"""The values of a JAX function, and of its Jacobian, as exact formulas: its jaxpr, evaluated on expressions.

The formulas are those of the jaxpr over the real numbers, its float64 constants being exact fractions, with one exception: what
is computed from constants alone is computed as JAX does it, in float64, for these floats are the coefficients of the model.
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse
from jaxobs.intervals import jaxpr as programs
from jaxobs.intervals.formulas import ZERO, Expression, Graph, constant
from jaxobs.intervals.graph_rules import ELEMENTWISE, REDUCE, choose, contract, element
from jaxobs.intervals.graph_slopes import slopes
from jaxobs.intervals.interval import point
from jaxobs.intervals.table import RULES, Call, Notes, UnknownPrimitiveError


@dataclasses.dataclass(frozen=True)
class Formulas:
    """outputs: the entries of what a function returns, an object array of Expression in its shape; graph: their atoms.
    jumps: the formulas of f at whose sign it switches, where it may be discontinuous (min, max, abs, clip never are)."""

    graph: Graph
    outputs: np.ndarray
    jumps: tuple[str, ...] = ()


def trace(f: Callable[..., Any], n: int, m: int = 0) -> Formulas:
    """f(x), x (n,), or f(x, u), u (m,), m > 0, as formulas in x1, ..., xn, u1, ..., um; f returns one array.

    UnknownPrimitiveError names what f uses that has no formula here: it needs sums, products, quotients, powers, sin, cos, tan,
    tanh, exp, log, sqrt, atan, erf and what is made of them, min, max, abs, comparisons, indexing.
    """
    args = [jax.ShapeDtypeStruct((n,), np.float64)] + [jax.ShapeDtypeStruct((m,), np.float64)] * (m > 0)
    program = programs.trace(f, *args)
    graph = Graph([f"x{i + 1}" for i in range(n)] + [f"u{i + 1}" for i in range(m)])
    variables = [graph.atom("x", k) for k in range(n + m)]
    inputs = [_array(variables[:n], (n,))] + [_array(variables[n:], (m,))] * (m > 0)
    jaxpr = program.closed.jaxpr
    if len(jaxpr.outvars) != 1:
        raise refuse("trace", "f", f"a function that returns {len(jaxpr.outvars)} arrays", "one array", "Stack its results.")
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        (result,) = Run(graph)(jaxpr, [np.asarray(c) for c in program.closed.consts], inputs, (program.name,))
    outputs = symbolic(result)
    return Formulas(graph, outputs, graph.jumps(list(outputs.flat)))


def jacobian(f: Callable[..., Any], n: int, m: int = 0) -> Formulas:
    """df/dx (..., n) of f(x) or f(x, u), x (n,), u (m,): the formulas of f, differentiated. Equal to `jax.jacfwd(f)` wherever
    f has a derivative.

    What f switches (jnp.where, lax.select) is taken for continuous: see `jumps`.
    """
    values = trace(f, n, m)
    entries = list(values.outputs.flat)
    columns = [slopes(values.graph, entries, k) for k in range(n)]
    rows = [e for row in zip(*columns, strict=True) for e in row]
    return Formulas(values.graph, _array(rows, (*values.outputs.shape, n)), values.graph.jumps(entries))


DATA = {"gather": (0,), "dynamic_slice": (0,), "dynamic_update_slice": (0, 1), "scatter": (0, 2)}  # the others are indices
MOVES = (
    *(
        "reshape",
        "squeeze",
        "expand_dims",
        "transpose",
        "broadcast_in_dim",
        "slice",
        "split",
        "concatenate",
        "stack",
        "unstack",
    ),
    *("tile", "rev", "pad", *DATA),
)
INNER = ("jaxpr", "call_jaxpr", "fun_jaxpr")


class Run:
    """Evaluates jaxprs on arrays of expressions and predicates (object), and on known numbers (any other dtype)."""

    def __init__(self, graph: Graph):
        self.graph = graph

    def __call__(self, jaxpr: Any, consts: Sequence[Any], args: Sequence[Any], path: tuple[str, ...]) -> list[Any]:
        values = dict(zip(jaxpr.constvars, consts, strict=True)) | dict(zip(jaxpr.invars, args, strict=True))

        def read(v: Any) -> Any:
            return np.asarray(v.val) if hasattr(v, "val") else values[v]

        for eqn in programs.needed(jaxpr):
            results = self.equation(eqn, [read(v) for v in eqn.invars], path)
            values.update(zip(eqn.outvars, results, strict=True))
        return [read(v) for v in jaxpr.outvars]

    def equation(self, eqn: Any, args: list[Any], path: tuple[str, ...]) -> list[Any]:
        name, params = eqn.primitive.name, eqn.params
        if name == "scan":
            return self.scan(params, args, path)
        if name == "cond":
            return self.cond(params, args, path)
        inner = next((params[key] for key in INNER if key in params), None)
        if inner is not None:
            consts = [np.asarray(c) for c in getattr(inner, "consts", ())]
            return self(getattr(inner, "jaxpr", inner), consts, args, (*path, params.get("name", name)))
        if all(x.dtype != object for x in args):  # as JAX computes it, rounding included
            result = eqn.primitive.bind(*map(jnp.asarray, args), **params)
            return [np.asarray(r) for r in (result if eqn.primitive.multiple_results else [result])]
        if name in MOVES:
            return self.move(eqn, args, path)
        shape = eqn.outvars[0].aval.shape
        if name == "integer_pow":
            return [_each(shape, lambda e: self.graph.power(e, params["y"]), args)]
        if name in ELEMENTWISE:
            return [_each(shape, partial(ELEMENTWISE[name], self.graph), args)]
        if name in REDUCE:
            return [self.fold(REDUCE[name], args[0], [int(a) for a in params["axes"]])]
        if name == "dot_general":
            return [contract(self.graph, params["dimension_numbers"], *map(symbolic, args))]
        if name == "select_n" and len(args) == 3:
            return [_each(shape, partial(choose, self.graph), [args[0], args[2], args[1]])]
        if name == "convert_element_type" and (np.issubdtype(eqn.outvars[0].aval.dtype, np.float64) or _truths(args[0])):
            return [_each(shape, lambda e: e if isinstance(e, Expression) else choose(self.graph, e, constant(1), ZERO), args)]
        if name == "cumsum":
            x = np.flip(args[0], params["axis"]) if params["reverse"] else args[0]
            sums = [
                self.fold(REDUCE["reduce_sum"], x.take(range(k + 1), params["axis"]), [params["axis"]])
                for k in range(x.shape[params["axis"]])
            ]
            sums = np.stack(sums, params["axis"])
            return [np.flip(sums, params["axis"]) if params["reverse"] else sums]
        where = " in ".join([name, *reversed(path)])
        raise UnknownPrimitiveError(
            f"{where}: the primitive {name!r} of these arguments has no formula. Write the function with sums, products, "
            "quotients, powers, sin, cos, tan, tanh, exp, log, sqrt, atan, erf, min, max, abs, comparisons and fixed indices."
        )

    def move(self, eqn: Any, args: list[Any], path: tuple[str, ...]) -> list[Any]:
        """Equations that only move entries, tried on their places."""
        data = DATA.get(eqn.primitive.name, range(len(args)))
        entries, places = [], []
        for k, x in enumerate(args):
            if k in data:
                places.append(point(np.arange(len(entries), len(entries) + x.size, dtype=np.float64).reshape(x.shape)))
                entries += [element(e) for e in x.flat]
            elif x.dtype == object:
                fix = "Use indices that do not depend on the state."
                raise UnknownPrimitiveError(f"{eqn.primitive.name} in {path[-1]}: an index depends on a variable. {fix}")
            else:
                places.append(point(x))
        call = Call(eqn, Notes(), path, {}, lambda v: point(v.val), lambda *_: [])
        found = RULES[eqn.primitive.name](call, *places)
        moved = []
        for one in found if isinstance(found, Sequence) else [found]:
            if not (np.all(one.lower == one.upper) and np.all((one.lower >= 0) & (one.lower < len(entries)))):
                raise UnknownPrimitiveError(f"{eqn.primitive.name} in {path[-1]}: an index is outside its array. Shorten it.")
            moved.append(_array([entries[int(i)] for i in np.ravel(one.lower)], np.shape(one.lower)))
        return moved

    def fold(self, rule: Callable[..., Any], x: np.ndarray, axes: list[int]) -> np.ndarray:
        kept = [k for k in range(x.ndim) if k not in axes]
        shape = [x.shape[k] for k in kept]
        rows = x.transpose(*kept, *axes).reshape(int(np.prod(shape)), -1)
        return _array([rule(self.graph, [element(e) for e in row]) for row in rows], shape)

    def scan(self, params: Any, args: list[Any], path: tuple[str, ...]) -> list[Any]:
        """Turn by turn: carry, y = body(constants, carry, x)."""
        ends = params["num_consts"], params["num_consts"] + params["num_carry"]
        constants, carry, xs = args[: ends[0]], args[ends[0] : ends[1]], args[ends[1] :]
        turns, ys, body = range(params["length"]), [], params["jaxpr"]
        for i in reversed(turns) if params["reverse"] else turns:
            consts = [np.asarray(c) for c in body.consts]
            results = self(
                body.jaxpr, consts, [*constants, *carry, *(x[i : i + 1].reshape(x.shape[1:]) for x in xs)], (*path, "scan")
            )
            carry = [np.asarray(r) for r in results[: len(carry)]]
            ys.append(results[len(carry) :])
        ys = ys[::-1] if params["reverse"] else ys
        return [*carry, *(_stack(each) for each in zip(*ys, strict=True))]

    def cond(self, params: Any, args: list[Any], path: tuple[str, ...]) -> list[Any]:
        """The branch that a known index takes."""
        which, branches = args[0], params["branches"]
        if which.dtype == object:
            raise UnknownPrimitiveError(f"cond in {path[-1]}: the branch depends on a variable. Write it with jnp.where.")
        branch = branches[int(np.clip(which, 0, len(branches) - 1))]
        return self(branch.jaxpr, [np.asarray(c) for c in branch.consts], args[1:], (*path, "cond"))


def symbolic(x: np.ndarray) -> np.ndarray:
    """Known numbers as constants."""
    return x if x.dtype == object else _array([element(e) for e in x.flat], x.shape)


def _array(entries: Sequence[Any], shape: Sequence[int]) -> np.ndarray:
    array = np.empty(len(entries), object)
    for k, e in enumerate(entries):
        array[k] = e
    return array.reshape(tuple(shape))


def _stack(parts: Sequence[np.ndarray]) -> np.ndarray:
    parts = [symbolic(part) for part in parts] if any(part.dtype == object for part in parts) else list(parts)
    return np.stack(parts)


def _each(shape: Sequence[int], rule: Callable[..., Any], args: Sequence[np.ndarray]) -> np.ndarray:
    """The rule, entry by entry; scalars go with every entry."""
    flat = [[element(e) for e in np.broadcast_to(x, shape).flat] for x in args]
    return _array([rule(*entries) for entries in zip(*flat, strict=True)], shape)


def _truths(x: np.ndarray) -> bool:
    return not any(isinstance(e, Expression) for e in x.flat)
