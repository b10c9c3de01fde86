"""Reverse mode: the derivatives in all directions at once, for parameters by the hundred; time runs back over checkpoints."""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxobs.studies.sensitive import Sensitive, replaced


def run_adjoints(sensitive: Sensitive, indices: Any, of: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    """value (lanes,), gradient (lanes, P) and diverged_at (lanes,) of the lanes with these indices (axes, lanes).

    The state is kept every `block` samples within one of about sqrt(T / block) stretches, and at the start of each stretch; all
    between is computed again on the way back. Memory grows with sqrt(T), and only that of the tile at work. Each lane is an
    array of its own here: slower than the loop of a study, whatever the number of parameters.
    """
    traced, arrays = sensitive.traced, sensitive.traced.arrays
    samples, size, grid = traced.samples, traced.block, traced.grid
    count = -(-samples // size)
    stretch = math.isqrt(count - 1) + 1
    stretches = -(-count // stretch)

    def lane(values: list[Any], index: Any) -> tuple[Any, Any]:
        start = traced._setup(replaced(arrays, sensitive.where, values), tuple(index))

        def step(carry: Any, given: Any) -> tuple[Any, None]:
            k, drawn = given
            there = jnp.minimum(k, samples - 1)
            time = (there, grid.ts[there], grid.dts[there])
            moved = jax.checkpoint(lambda carry: traced._step(start.fixed, carry, time, drawn)[0], prevent_cse=False)
            return jax.lax.cond(k < samples, moved, lambda carry: carry, carry), None

        def block(carry: Any, i: Any) -> tuple[Any, None]:
            ks = i * size + jnp.arange(size, dtype=jnp.int32)
            drawn = traced._draw(start.fixed, start.keys, grid.ts[jnp.minimum(ks, samples - 1)], i)
            return jax.lax.scan(step, carry, (ks, drawn))

        def many(carry: Any, numbers: Any) -> tuple[Any, None]:
            return jax.lax.scan(jax.checkpoint(block, prevent_cse=False), carry, numbers)

        numbers = jnp.arange(stretches * stretch, dtype=jnp.int32).reshape(stretches, stretch)
        carry, _ = jax.lax.scan(jax.checkpoint(many, prevent_cse=False), start.carry, numbers)
        return of(traced.results(carry)), carry[-1]

    def both(values: list[Any], index: Any) -> dict[str, Any]:
        (value, lost), slopes = jax.value_and_grad(lane, has_aux=True)(values, index)
        return {"value": value, "gradient": jnp.concatenate([one.reshape(-1) for one in slopes]), "diverged_at": lost}

    return jax.vmap(both, in_axes=(None, 1))(sensitive.values(arrays), indices)
