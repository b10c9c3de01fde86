"""The part of an observer's state that an error can be in, as one vector."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.interpreters.partial_eval import dce_jaxpr
from jaxtyping import Array, Float

from jaxobs.observers import AbstractStepObserver


class LiveState:
    """The observer's state in two: live leaves as one vector, and the rest, with its clocks advanced."""

    def __init__(self, observer, move, x, y, z, clock: float):
        leaves, self.structure = jax.tree.flatten(z)
        self.live = _live(observer.init, move, x, y, z)
        rates = jax.tree.leaves(move(z, y))
        rest = []
        for i, (leaf, rate) in enumerate(zip(leaves, rates, strict=True)):
            counts = i not in self.live and jnp.shape(leaf) == () and jnp.issubdtype(jnp.result_type(leaf), jnp.floating)
            change = rate - leaf if isinstance(observer, AbstractStepObserver) else rate
            rest.append(leaf + jnp.asarray(clock, leaf.dtype) * change if counts else leaf)
        self.rest = rest

    def take(self, z) -> Float[Array, " N"]:
        leaves = jax.tree.leaves(z)
        return jnp.concatenate([leaves[i].reshape(-1) for i in self.live])

    def put(self, live: Float[Array, " N"]):
        leaves, at = list(self.rest), 0
        for i in self.live:
            shape = jnp.shape(leaves[i])
            size = int(np.prod(shape))
            leaves[i] = live[at : at + size].reshape(shape)
            at += size
        return jax.tree.unflatten(self.structure, leaves)


def _live(init, move, x, y, z) -> tuple[int, ...]:
    """The leaves of z that the guess or the measurement reaches, by data flow through the two functions; the same for all
    values of the numbers. A leaf that is passed on as it came is none."""
    first, then = jax.make_jaxpr(init)(x).jaxpr, jax.make_jaxpr(move)(z, y).jaxpr
    count = len(then.outvars)

    def reached(jaxpr, i) -> list[bool]:
        return dce_jaxpr(jaxpr, [j == i for j in range(count)])[1]

    passed = [out is given for out, given in zip(then.outvars, then.invars, strict=False)]
    known = [jnp.issubdtype(one.aval.dtype, jnp.floating) for one in then.outvars]
    free = [i for i in range(count) if known[i] and not passed[i]]
    sources = {i: reached(then, i) for i in free}
    live = {i for i in free if any(reached(first, i)) or sources[i][count]}
    while more := {i for i in free if i not in live and any(sources[i][j] for j in live)}:
        live |= more
    return tuple(sorted(live))
