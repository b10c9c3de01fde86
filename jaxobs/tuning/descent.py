"""Gradient descent with optax in compiled blocks, several starts side by side."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float

SHRINK, GROW = 0.5, 1.1  # of the step after one that failed, and after one that did not
Loss = Callable[[Any, Any], Any]


class Descent(NamedTuple):
    """The best iterate of every start, its loss, and the loss at every step (starts, steps)."""

    theta: Any
    value: Float[Array, " starts"]
    history: Float[Array, "starts steps"]


class State(NamedTuple):
    """Of every start: the iterate, that of the optimiser, the best so far with its loss, and what steps are scaled by."""

    theta: Any
    optimizer: Any
    best: Any
    value: Any
    scale: Any


class Record(NamedTuple):
    """Of every start and step, before the step: the loss, what else it returned, the norm of its gradient, whether the step
    counts (finite loss and gradient)."""

    value: Any
    parts: Any
    slope: Any
    good: Any


def cosine_adam(rate: float, steps: int) -> optax.GradientTransformation:
    """Adam with clipped gradients and a rate that falls to a fiftieth along a cosine."""
    return optax.chain(optax.clip_by_global_norm(1.0), optax.adam(optax.cosine_decay_schedule(rate, steps, 0.02)))


def backtracking_lbfgs() -> optax.GradientTransformation:
    """L-BFGS whose line search goes back from where the loss is not finite. Nocedal and Wright, Numerical Optimization, 7.2."""
    return optax.lbfgs(linesearch=optax.scale_by_backtracking_linesearch(max_backtracking_steps=50, decrease_factor=0.5))


class Search:
    """loss(theta, arg, shared) -> (value, parts), descended upon from several starts; `run` is compiled once for each number of
    steps.

    The best iterate is kept, not the last. A step to a loss or gradient that is not finite is taken back to the best iterate,
    and the next ones are shorter. optimizer: any of optax, with a line search too (optax.lbfgs()). Precision: that of theta.
    """

    def __init__(self, loss: Callable[[Any, Any, Any], Any], optimizer: optax.GradientTransformation):
        self.loss, self.optimizer = loss, optax.with_extra_args_support(optimizer)

    def begin(self, thetas: Any) -> State:
        """thetas: a pytree with a leading axis of starts."""

        def one(theta: Any) -> State:
            dtype = jax.tree.leaves(theta)[0].dtype
            return State(theta, self.optimizer.init(theta), theta, jnp.asarray(jnp.inf, dtype), jnp.ones((), dtype))

        # Of a strong dtype: otherwise the second block would be compiled again.
        return jax.tree.map(lambda a: jax.lax.convert_element_type(a, a.dtype), jax.vmap(one)(thetas))

    def run(self, state: State, args: Any, steps: int, shared: Any = None) -> tuple[State, Record]:
        """args: a pytree with a leading axis of starts, shared: the same for all. Records have the shape (starts, steps)."""
        return self._run(state, args, steps, shared)

    @functools.cached_property
    def _run(self) -> Any:
        def many(state: State, args: Any, steps: int, shared: Any) -> tuple[State, Record]:
            def one(state: State, arg: Any) -> tuple[State, Record]:
                return jax.lax.scan(lambda carry, _: self._step(carry, arg, shared), state, None, length=steps)

            return jax.vmap(one)(state, args)

        return eqx.filter_jit(many)

    def _step(self, state: State, arg: Any, shared: Any) -> tuple[State, Record]:
        theta = state.theta
        (value, parts), gradient = jax.value_and_grad(self.loss, has_aux=True)(theta, arg, shared)
        good = jnp.isfinite(value) & _all_finite(gradient)
        better = good & (value < state.value)
        best, least = _where(better, theta, state.best), jnp.where(better, value, state.value)
        slope = optax.tree.norm(gradient)
        gradient = _where(good, gradient, jax.tree.map(jnp.zeros_like, gradient))
        with jax.numpy_dtype_promotion("standard"):  # optax mixes its integer step count with floats
            more = {"value": value, "grad": gradient, "value_fn": lambda x: self.loss(x, arg, shared)[0]}
            updates, optimizer = self.optimizer.update(gradient, state.optimizer, theta, **more)
        scale = jnp.where(good, jnp.minimum(state.scale * GROW, 1), state.scale * SHRINK)
        moved = jax.tree.map(lambda x, step: x + scale * step, theta, updates)
        moved = _where(_all_finite(moved), moved, best)  # a line search that saw no finite value
        return State(_where(good, moved, best), optimizer, best, least, scale), Record(value, parts, slope, good)


def descend(
    loss: Loss,
    thetas: Any,
    args: Any = None,
    *,
    steps: int = 300,
    rate: float = 2e-2,
    optimizer: optax.GradientTransformation | None = None,
) -> Descent:
    """Minimises loss(theta, arg) from every start: `thetas` and `args` are pytrees with a leading axis of starts.

    optimizer defaults to Adam at `rate` with a cosine decay. float64 is advised for gains: their gradients spread over decades.
    See `Search` for what happens at steps that fail.
    """
    optimizer = cosine_adam(rate, steps) if optimizer is None else optimizer
    search = Search(lambda theta, arg, _: (loss(theta, arg), ()), optimizer)
    args = jnp.zeros(jax.tree.leaves(thetas)[0].shape[0]) if args is None else args
    state, record = search.run(search.begin(jax.tree.map(jnp.asarray, thetas)), args, steps)
    return Descent(state.best, state.value, record.value)


def _all_finite(tree: Any) -> Array:
    return jnp.stack([jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(tree)]).all()


def _where(condition: Array, new: Any, old: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
