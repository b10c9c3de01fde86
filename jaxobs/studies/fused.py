"""A loop as one kernel: on CPUs XLA starts every fused operation of a loop's body by itself, which costs more than its work."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend import core

from jaxobs.studies.scalar_rules import CALLS, ELEMENTWISE, MOVES, REDUCTIONS

PLAIN = (
    ELEMENTWISE | MOVES | set(REDUCTIONS) | {"while", "scan", "iota", "bitcast_convert_type", *CALLS}
)  # no calls of libraries


def fused(function: Callable[..., Any], alive: Any, *arguments: Any) -> Any:
    """function(*arguments), compiled into one kernel where XLA can: on CPUs, for functions of plain arithmetic and loops.

    `alive` is True in a way that no compiler knows. XLA stops the process over a kernel that is given a constant or does not
    use what it is given, so that all goes in and out through operations on `alive`.
    """
    closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
    if jax.default_backend() != "cpu" or not is_plain(closed.jaxpr):
        return function(*arguments)
    count = len(closed.consts)

    def body(alive: Any, *given: Any) -> list[Any]:
        out = core.jaxpr_as_fun(closed.replace(consts=list(given[:count])))(*given[count:])
        for one in (one for one in given if one.size):
            first = one.reshape(-1)[0]
            alive = alive | (first if first.dtype == bool else first > 0)
        return [_made(one, alive) for one in out]

    given = [_made(one, alive) for one in map(jnp.asarray, [*closed.consts, *jax.tree.leaves(arguments)])]
    kernel = jax.jit(body)
    with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
        out = kernel(alive, *given)
    return jax.tree.unflatten(jax.tree.structure(shape), out)


def _made(value: Any, alive: Any) -> Any:
    """The value, by an operation that no compiler removes."""
    return jnp.where(alive, value, jnp.ones_like(value))


def is_plain(jaxpr: Any) -> bool:
    """Whether it has arithmetic, moves of data and loops only."""
    for equation in jaxpr.eqns:
        if equation.primitive.name not in PLAIN:
            return False
        for inner in jax.tree.leaves(
            list(equation.params.values()), is_leaf=lambda a: hasattr(a, "eqns") or hasattr(a, "jaxpr")
        ):
            if hasattr(inner, "jaxpr") or hasattr(inner, "eqns"):
                if not is_plain(getattr(inner, "jaxpr", inner)):
                    return False
    return True
