"""Enclosures of the values of a JAX function: its jaxpr, evaluated equation by equation on intervals.

The function is taken as a map of real numbers: its literals and constants are the exact floats of the jaxpr, its operations
have no rounding errors, and neither infinity nor NaN is a value.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import is_real, refuse
from jaxobs.intervals.interval import Interval, point
from jaxobs.intervals.table import RULES, Call, Notes, UnknownPrimitiveError


@dataclasses.dataclass(frozen=True)
class Bounded:
    """Enclosures, and what they assume beyond the program.

    value: pytree of Interval with the structure of what the function returns.
    jumps: each switch that the box leaves undecided, where the enclosure holds but the function may be discontinuous; a mean
        value needs it to be continuous there. undefined: where an argument leaves the domain of a function or a denominator
        reaches 0, so that the enclosure speaks of the rest of the box.
    """

    value: Any
    jumps: tuple[str, ...]
    undefined: tuple[str, ...]

    @property
    def assumptions(self) -> tuple[str, ...]:
        return self.jumps + self.undefined


@dataclasses.dataclass(frozen=True)
class Program:
    """A function traced in float64 for arguments of given shapes, ready to be evaluated on many boxes.

    `program(*args)` takes pytrees of Interval or exact arrays of these shapes and returns a Bounded.
    """

    closed: Any  # jax.extend.core.ClosedJaxpr
    structs: Any
    result: Any
    name: str

    def __call__(self, *args: Any) -> Bounded:
        leaves, tree = jax.tree.flatten(args, is_leaf=_is_interval)
        expected, expected_tree = jax.tree.flatten(self.structs)
        shapes, given = [s.shape for s in expected], [np.shape(x) if not _is_interval(x) else x.shape for x in leaves]
        if tree != expected_tree or shapes != given:
            raise refuse("Program", "args", f"shapes {given}", f"shapes {shapes}, as traced", "Trace again.")
        notes = Notes()
        inputs = [x if isinstance(x, Interval) else _exact(x) for x in leaves]
        outputs = evaluate(self.closed.jaxpr, [_exact(c) for c in self.closed.consts], inputs, notes, (self.name,))
        value = jax.tree.unflatten(jax.tree.structure(self.result), outputs)
        return Bounded(value, tuple(notes.jumps), tuple(notes.undefined))


def trace(f: Callable[..., Any], *args: Any) -> Program:
    """The program of f for arguments like these (pytrees of Interval, arrays, or `jax.ShapeDtypeStruct`), in float64.

    JAX's x64 flag is set while f is traced, not beyond.
    """
    structs = jax.tree.map(_struct, args, is_leaf=_is_interval)
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        closed, result = jax.make_jaxpr(f, return_shape=True)(*structs)
    return Program(closed, structs, result, getattr(f, "__name__", type(f).__name__))


def bound(f: Callable[..., Any], *args: Any) -> Any:
    """{f(z) : z in args}, enclosed: a pytree of Interval with the structure of what f returns.

    args: pytrees of Interval, or of exact arrays. `evaluate(f, *args)` also tells the assumptions.

    Raises UnknownPrimitiveError where f uses a primitive without a rule.
    """
    return bounded(f, *args).value


def bounded(f: Callable[..., Any], *args: Any) -> Bounded:
    """`bound` together with what it assumes."""
    return trace(f, *args)(*args)


def evaluate(
    jaxpr: Any, consts: Sequence[Interval], args: Sequence[Interval], notes: Notes, path: tuple[str, ...]
) -> list[Interval]:
    """Evaluate the equations of a jaxpr in order; `path` names the functions that enclose it, for messages."""
    values: dict[Any, Interval] = dict(zip(jaxpr.constvars, consts, strict=True))
    values.update(zip(jaxpr.invars, args, strict=True))
    read = functools.partial(_read, values)
    defined_by: dict[Any, Any] = {}
    for eqn in needed(jaxpr):
        apply = RULES.get(eqn.primitive.name)
        if apply is None:
            raise UnknownPrimitiveError(
                f"{' in '.join([eqn.primitive.name, *reversed(path)])}: no interval rule for the primitive "
                f"{eqn.primitive.name!r}. Write the function with primitives that have one (the keys of "
                f"jaxobs.intervals.RULES), or register a rule there with jaxobs.intervals.rule."
            )
        call = Call(eqn, notes, path, defined_by, read, _run)
        result = apply(call, *[read(v) for v in eqn.invars])
        values.update(zip(eqn.outvars, [result] if isinstance(result, Interval) else result, strict=True))
        defined_by.update(dict.fromkeys(eqn.outvars, eqn))
    return [read(v) for v in jaxpr.outvars]


def needed(jaxpr: Any) -> list[Any]:
    """The equations on which the outputs depend."""
    wanted = {v for v in jaxpr.outvars if not hasattr(v, "val")}
    kept = []
    for eqn in reversed(jaxpr.eqns):
        if not wanted.isdisjoint(eqn.outvars):
            wanted.update(v for v in eqn.invars if not hasattr(v, "val"))
            kept.append(eqn)
    return kept[::-1]


def _run(call: Call, jaxpr: Any, args: Sequence[Interval]) -> list[Interval]:
    """Evaluate the jaxpr that an equation carries, open or closed."""
    consts = [_exact(c) for c in getattr(jaxpr, "consts", ())]
    path = (*call.path, call.params.get("name", call.name))
    return evaluate(getattr(jaxpr, "jaxpr", jaxpr), consts, args, call.notes, path)


def _read(values: dict[Any, Interval], variable: Any) -> Interval:
    return point(variable.val) if hasattr(variable, "val") else values[variable]


def _is_interval(value: Any) -> bool:
    return isinstance(value, Interval)


def _exact(value: Any) -> Interval:
    dtype = getattr(value, "dtype", None)
    if dtype is not None and not is_real(dtype):
        raise refuse("bound", "args", f"an array of dtype {dtype}", "real numbers", "Split complex numbers, draw keys outside.")
    return point(value)


def _struct(value: Any) -> jax.ShapeDtypeStruct:
    if isinstance(value, jax.ShapeDtypeStruct):
        return value
    if isinstance(value, Interval):
        return jax.ShapeDtypeStruct(value.shape, np.float64)
    array = np.asarray(value)
    if not is_real(array.dtype):
        raise refuse("bound", "args", f"an array of dtype {array.dtype}", "real numbers", "Give floats, integers or Intervals.")
    return jax.ShapeDtypeStruct(array.shape, np.float64 if jnp.issubdtype(array.dtype, jnp.floating) else array.dtype)
