"""A loop as one kernel: on CPUs XLA starts every fused operation of a loop's body by itself, which costs more than its work."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend import core

from jaxobs.scalars.rules import CALLS, ELEMENTWISE, MOVES, REDUCTIONS

LARGE = 2**18  # bytes of one result: XLA splits operations on as many over threads, which no kernel of its own can do
PLAIN = ELEMENTWISE | MOVES | {*REDUCTIONS, *CALLS, "while", "scan", "iota"}


def fused(function: Callable[..., Any], alive: Any, *arguments: Any) -> Any:
    """function(*arguments), compiled into one kernel where XLA can: on CPUs, for functions of plain arithmetic and loops.

    `alive` is True in a way that no compiler knows. XLA stops the process over a kernel that is given a constant or does not
    use what it is given, so that all goes in and out through operations on `alive`.
    """
    closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
    if jax.default_backend() != "cpu" or not is_plain(closed.jaxpr):
        return function(*arguments)
    if any(var.aval.size * var.aval.dtype.itemsize >= LARGE for var in closed.jaxpr.outvars):
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
    """The value, by an operation that no compiler removes, whatever the value: what stands in if not alive is no constant."""
    if value.dtype == bool:
        return value ^ ~alive
    return jnp.where(alive, value, alive.astype(value.dtype) + 1)


def is_plain(jaxpr: Any) -> bool:
    """Whether it has arithmetic, moves of data and loops only: no calls of libraries, no random keys."""
    keys = any(jnp.issubdtype(var.aval.dtype, jax.dtypes.extended) for var in (*jaxpr.invars, *jaxpr.constvars))
    return not keys and all(one.primitive.name in PLAIN and all(map(is_plain, _bodies(one.params))) for one in jaxpr.eqns)


def _bodies(params: dict[str, Any]) -> Iterator[Any]:
    """The functions that a loop or a call has among its parameters."""
    for value in params.values():
        for one in value if isinstance(value, tuple | list) else (value,):
            body = getattr(one, "jaxpr", one)
            if hasattr(body, "eqns"):
                yield body
