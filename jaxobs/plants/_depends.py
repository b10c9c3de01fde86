"""What a function's value is made from, read off its traced program; plants whose equations change with time."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

from jaxobs import scalars
from jaxobs._module import dtype_of, refuse


def depends(f: Callable[..., Any], place: int, *arguments: Any) -> bool:
    """Whether f's result may depend on its argument at this place: False is sure, for every value of the others."""
    program, _ = scalars.trace(f, *arguments)
    reached = scalars.lane_variables(list(program.equations), {program.inputs[place]}, {})
    return any(isinstance(one, scalars.Variable) and one in reached for one in program.outputs)


def timed(plant: Any) -> bool:
    """Whether the plant's flow or step may change with time."""
    dtype = dtype_of(plant)
    move: Callable[..., Any] = plant.step if hasattr(plant, "step") else plant.flow
    return depends(move, 0, jnp.zeros((), dtype), jnp.zeros((plant.n,), dtype), jnp.zeros((plant.m,), dtype))


def require_timeless(owner: Any, plant: Any) -> None:
    """ValueError for a plant whose flow or step may change with time: what is taken at one time would be said of all."""
    if timed(plant):
        fix = "Let the time enter as an input: f(x, u) with u its functions of t."
        raise refuse(owner, "plant", "equations that change with time", "x' = f(x, u), or x+ = f(x, u)", fix)
