"""Progress meters: diffrax's, in the loops of `simulate`, `score` and `observe`, and around the pieces of a study."""

from collections.abc import Callable
from typing import Any

import diffrax
import jax
import jax.numpy as jnp

ProgressMeter = diffrax.AbstractProgressMeter


def metered_scan(body: Callable[[Any, Any], tuple[Any, Any]], carry: Any, xs: Any, meter: ProgressMeter | None) -> Any:
    """jax.lax.scan(body, carry, xs), the meter told after each step which share of them is done."""
    if meter is None:
        return jax.lax.scan(body, carry, xs)
    count = jax.tree.leaves(xs)[0].shape[0]
    shares = jnp.arange(1, count + 1).astype(jnp.result_type(float)) / count

    def told(both: Any, row: Any) -> tuple[Any, Any]:
        inner, state = both
        x, share = row
        inner, out = body(inner, x)
        return (inner, meter.step(state, share)), out

    (carry, state), out = jax.lax.scan(told, (carry, meter.init()), (xs, shares))
    meter.close(state)
    return carry, out
