"""Gradients of long runs with few parameters, in forward mode whatever is asked for outside."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jax.flatten_util import ravel_pytree

from jaxobs._module import Scalar


def by_forward_mode(function: Callable[[Any, Any], Scalar], tree: Any, rest: Any) -> Scalar:
    """function(tree, rest), with derivatives for the floats of `tree` alone, one carried along for each that has a tangent.

    jax.grad of it needs no memory over time. Everything enters as an argument: no closure over traced values.
    """
    leaves, structure = jax.tree.flatten(tree)
    given, constant = jax.tree.flatten(rest)
    floats = [i for i, leaf in enumerate(leaves) if eqx.is_inexact_array(leaf)]
    arrays = [i for i, leaf in enumerate(given) if eqx.is_array(leaf)]

    def value(numbers: list[Any], operands: list[Any]) -> Scalar:
        mine, theirs = list(leaves), list(given)
        for i, number in zip(floats, numbers, strict=True):
            mine[i] = number
        for i, operand in zip(arrays, operands, strict=True):
            theirs[i] = operand
        return function(jax.tree.unflatten(structure, mine), jax.tree.unflatten(constant, theirs))

    @jax.custom_jvp
    def run(numbers, operands):
        return value(numbers, operands)

    def rule(primals, tangents):
        numbers, operands = primals
        moving = [i for i, tangent in enumerate(tangents[0]) if not isinstance(tangent, SymbolicZero)]
        if not moving:
            found = value(numbers, operands)
            return found, jnp.zeros_like(found)

        def along(directions):
            full = list(numbers)

            def place(*those):
                for i, one in zip(moving, those, strict=True):
                    full[i] = one
                return value(list(full), operands)

            return jax.jvp(place, tuple(numbers[i] for i in moving), directions)

        flat, unravel = ravel_pytree(tuple(numbers[i] for i in moving))
        units = jax.vmap(unravel)(jnp.eye(flat.size, dtype=flat.dtype))
        found, slopes = jax.vmap(along, out_axes=(None, 0))(units)
        return found, slopes @ ravel_pytree(tuple(tangents[0][i] for i in moving))[0]

    run.defjvp(rule, symbolic_zeros=True)
    return run([leaves[i] for i in floats], [given[i] for i in arrays])
