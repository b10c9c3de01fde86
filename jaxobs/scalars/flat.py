"""A function as flat equations: every call inlined, every variable in one scope."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.extend import core

from jaxobs.scalars.rules import CALLS


class Equation(NamedTuple):
    """primitive(inputs) -> outputs with the calls of the jaxpr inlined; inputs are variables or literal arrays."""

    primitive: Any
    inputs: tuple[Any, ...]
    outputs: tuple[Any, ...]
    params: dict[str, Any]


class Program(NamedTuple):
    """A flat function: variables of the inputs and outputs, constants, and equations in order."""

    inputs: tuple[Any, ...]
    outputs: tuple[Any, ...]
    constants: dict[Any, Any]
    equations: tuple[Equation, ...]


def trace(function: Callable[..., Any], *arguments: Any) -> tuple[Program, Any]:
    """The function of arrays as a flat program, traced for arguments of these shapes, and the shapes of its result."""
    closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
    return flatten(closed), shape


def flatten(closed: Any) -> Program:
    """Calls are inlined: every variable is then known in one scope, however deeply it was nested."""
    constants: dict[Any, Any] = {}
    equations: list[Equation] = []

    def resolve(atom: Any, scope: dict[Any, Any]) -> Any:
        if not isinstance(atom, core.Literal):
            return scope[atom]
        return np.asarray(atom.val, getattr(atom.aval, "dtype"))  # noqa: B009 (an abstract value need not have one)

    def inline(jaxpr: Any, consts: Sequence[Any], inputs: Sequence[Any]) -> list[Any]:
        scope = dict(zip(jaxpr.invars, inputs, strict=True))
        for variable, value in zip(jaxpr.constvars, consts, strict=True):
            fresh = Variable(variable.aval)
            constants[fresh], scope[variable] = value, fresh
        for equation in jaxpr.eqns:
            given = [resolve(atom, scope) for atom in equation.invars]
            inner = CALLS.get(equation.primitive.name)
            if inner is not None and (body := equation.params.get(inner)) is not None:
                consts = getattr(body, "consts", ())
                results = inline(getattr(body, "jaxpr", body), consts, given)
            else:
                results = [Variable(variable.aval) for variable in equation.outvars]
                equations.append(Equation(equation.primitive, tuple(given), tuple(results), equation.params))
            scope.update(zip(equation.outvars, results, strict=True))
        return [resolve(atom, scope) for atom in jaxpr.outvars]

    inputs = [Variable(variable.aval) for variable in closed.jaxpr.invars]
    outputs = inline(closed.jaxpr, closed.consts, inputs)
    return Program(tuple(inputs), tuple(outputs), constants, tuple(equations))


class Variable:
    """A name with a shape and a dtype; equal to itself only."""

    __slots__ = ("aval",)

    def __init__(self, aval: Any):
        self.aval = aval


def split(program: Program, known: set[Any]) -> tuple[list[Equation], list[Equation]]:
    """The equations that the known variables and the constants determine, and those of the rest that the outputs need."""
    first, rest = [], []
    known = known | set(program.constants)
    for equation in program.equations:
        if all(isinstance(one, np.ndarray) or one in known for one in equation.inputs):
            known |= set(equation.outputs)
            first.append(equation)
        else:
            rest.append(equation)
    needed = {one for one in program.outputs if isinstance(one, Variable)}
    kept = []
    for equation in reversed(rest):
        if needed & set(equation.outputs):
            needed |= {one for one in equation.inputs if isinstance(one, Variable)}
            kept.append(equation)
    return first, kept[::-1]
