"""A traced function over sympy symbols: the few operations that polynomials are made of, on object arrays."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse


def evaluate(function: Callable[..., Any], dtype: Any, *arguments: Sequence[Any]) -> list[Any]:
    """function (of vectors, to a vector) at vectors of sympy symbols; floats become the rationals that they are.

    ValueError for an operation that is not polynomial.
    """
    shapes = [jax.ShapeDtypeStruct((len(a),), dtype) for a in arguments]
    closed = jax.make_jaxpr(function)(*shapes)
    objects = [np.asarray(list(a), dtype=object).reshape(len(a)) for a in arguments]
    (result,) = _run(closed.jaxpr, [_exact(np.asarray(c)) for c in closed.consts], objects)
    return list(np.asarray(result, dtype=object).reshape(-1))


def _exact(value: np.ndarray) -> np.ndarray:
    import sympy  # only reached through jaxobs.designs.elimination, which has checked that it is there

    if value.dtype.kind != "f":
        return value
    out = np.empty(value.shape, dtype=object)
    for at in np.ndindex(value.shape):
        fraction = Fraction(float(value[at]))
        out[at] = sympy.Rational(fraction.numerator, fraction.denominator)
    return out


def _run(jaxpr: Any, consts: list[Any], arguments: list[Any]) -> list[Any]:
    values: dict[Any, Any] = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *arguments], strict=True))

    def read(atom: Any) -> Any:
        return _exact(np.asarray(atom.val)) if hasattr(atom, "val") else values[atom]

    for equation in jaxpr.eqns:
        inputs = [read(atom) for atom in equation.invars]
        outputs = _apply(equation, inputs)
        values |= dict(zip(equation.outvars, outputs, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def _apply(equation: Any, given: list[Any]) -> list[Any]:
    name, params = equation.primitive.name, equation.params
    inner = params.get("jaxpr") or params.get("call_jaxpr")
    if inner is not None and name in ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call"):
        return _run(inner.jaxpr, [_exact(np.asarray(c)) for c in inner.consts], given)
    if name == "convert_element_type" and np.issubdtype(params["new_dtype"], np.floating):
        return [a if np.asarray(a).dtype == object else _exact(np.asarray(a, float)) for a in given]
    if all(np.asarray(a).dtype != object for a in given):  # integers: where an entry is
        outputs = equation.primitive.bind(*[jnp.asarray(a) for a in given], **params)
        return [np.asarray(one) for one in (outputs if equation.primitive.multiple_results else [outputs])]
    if name in ARITHMETIC:
        return [np.asarray(ARITHMETIC[name](params, *given), dtype=object)]
    if name not in MOVES:
        fix = "Elimination is for polynomial systems; write the map by hand otherwise (AbstractAlgebraicMap)."
        raise refuse("eliminate", "system", f"the operation {name!r}", "sums, products and integer powers", fix)
    # What only moves entries is asked where each entry went: the same operation on their numbers.
    sizes = [np.size(a) for a in given]
    starts = np.cumsum([0, *sizes])
    moved = [a if np.asarray(a).dtype != object else None for a in given]
    indices = [
        np.arange(start, start + np.size(a)).reshape(np.shape(a)) if m is None else m
        for a, m, start in zip(given, moved, starts, strict=False)
    ]
    where = equation.primitive.bind(*[jnp.asarray(i) for i in indices], **params)
    pool = np.concatenate([np.asarray(a, dtype=object).reshape(-1) for a in given])
    outputs = where if equation.primitive.multiple_results else [where]
    return [pool[np.asarray(w)] if np.ndim(w) else np.asarray(pool[int(w)], dtype=object) for w in outputs]


def _dot(params: Any, a: Any, b: Any) -> Any:
    (left, right), (batch, _) = params["dimension_numbers"]
    if batch:
        raise refuse("eliminate", "system", "a batched product", "plain products", "Write it as sums of products.")
    return np.tensordot(a, b, axes=(left, right))


ARITHMETIC: dict[str, Callable[..., Any]] = {
    "add": lambda _, a, b: a + b,
    "sub": lambda _, a, b: a - b,
    "mul": lambda _, a, b: a * b,
    "neg": lambda _, a: -a,
    "add_any": lambda _, a, b: a + b,
    "integer_pow": lambda params, a: a ** params["y"] if params["y"] >= 0 else _no_power(params["y"]),
    "square": lambda _, a: a * a,
    "dot_general": _dot,
    "reduce_sum": lambda params, a: np.sum(a, axis=tuple(params["axes"])),
    "copy": lambda _, a: a,
}
MOVES = {
    "concatenate", "slice", "squeeze", "reshape", "broadcast_in_dim", "transpose", "rev", "gather", "dynamic_slice", "scatter",
    "dynamic_update_slice", "expand_dims", "stack", "split",
}  # fmt: skip


def _no_power(power: int) -> Any:
    raise refuse("eliminate", "system", f"the power {power}", "powers >= 0", "Multiply the system out.")
