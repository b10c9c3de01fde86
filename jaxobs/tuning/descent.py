"""Gradient descent with optax in one compiled loop, several starts side by side."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float


class Descent(NamedTuple):
    """The best iterate of every start, its loss, and the loss at every step (starts, steps)."""

    theta: Any
    value: Float[Array, " starts"]
    history: Float[Array, "starts steps"]


def cosine_adam(rate: float, steps: int) -> optax.GradientTransformation:
    """Adam with clipped gradients and a rate that falls to a fiftieth along a cosine."""
    return optax.chain(optax.clip_by_global_norm(1.0), optax.adam(optax.cosine_decay_schedule(rate, steps, 0.02)))


def descend(
    loss: Callable[[Any, Any], Any],
    thetas: Any,
    args: Any = None,
    *,
    steps: int = 300,
    rate: float = 2e-2,
    optimizer: optax.GradientTransformation | None = None,
) -> Descent:
    """Minimises loss(theta, arg) from every start: `thetas` and `args` are pytrees with a leading axis of starts.

    The best iterate is kept, not the last; a step to a loss or gradient that is not finite is taken back to the best iterate.
    Everything is one `lax.scan` under `vmap`, compiled once. optimizer defaults to Adam at `rate` with a cosine decay.
    Precision: that of thetas; float64 is advised for gains (their gradients spread over decades).
    """
    optimizer = cosine_adam(rate, steps) if optimizer is None else optimizer
    starts = jax.tree.leaves(thetas)[0].shape[0]

    def one(theta, arg):
        def step(carry, _):
            theta, state, best, least = carry
            value, gradient = jax.value_and_grad(loss)(theta, arg)
            good = jnp.isfinite(value) & _all_finite(gradient)
            better = good & (value < least)
            best, least = _where(better, theta, best), jnp.where(better, value, least)
            gradient = _where(good, gradient, jax.tree.map(jnp.zeros_like, gradient))
            with jax.numpy_dtype_promotion("standard"):  # optax mixes its integer step count with floats
                updates, next_state = optimizer.update(gradient, state, theta)
            theta = _where(good, optax.apply_updates(theta, updates), best)
            return (theta, next_state, best, least), value

        start = (theta, optimizer.init(theta), theta, jnp.asarray(jnp.inf, jax.tree.leaves(theta)[0].dtype))
        (_, _, best, least), history = jax.lax.scan(step, start, None, length=steps)
        return Descent(best, least, history)

    mapped = jax.vmap(one, axis_size=starts, in_axes=(0, None if args is None else 0))
    return eqx.filter_jit(mapped)(thetas, args)


def _all_finite(tree: Any) -> Array:
    return jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree)]).all()


def _where(condition: Array, new: Any, old: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
