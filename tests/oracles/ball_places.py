"""Where a jaxpr's gather and scatter read and write, asked of JAX itself with positions in place of numbers."""

import jax
import jax.numpy as jnp
import numpy as np
from flint import arb


def _places(eqn, shape, *index):
    """For each number of the result, the place in the operand it was read from, plus 1; 0 for none."""
    places = jnp.arange(1, 1 + int(np.prod(shape))).reshape(shape)
    params = dict(eqn.params)
    if "fill_value" in params:
        params["fill_value"] = 0
    return np.asarray(eqn.primitive.bind(places, *map(jnp.asarray, index), **params))


def read_from(eqn, x, *index):
    at = _places(eqn, x.shape, *index)
    flat = np.append(np.asarray([arb("nan")] if x.dtype == object else [0]), x.ravel())
    return flat[at] if x.dtype != object else np.asarray(flat.astype(object)[at], dtype=object)


def scatter(eqn, x, index, update):
    if update.dtype != object:
        return np.asarray(eqn.primitive.bind(jnp.asarray(x), jnp.asarray(index), jnp.asarray(update), **eqn.params))
    n = x.size
    old, new = jnp.arange(n).reshape(x.shape), jnp.arange(n, n + update.size).reshape(update.shape)
    at = np.asarray(eqn.primitive.bind(old, jnp.asarray(index), new, **eqn.params))
    return np.asarray(np.append(x.ravel(), update.ravel())[at], dtype=object)


def scatter_with(pair):
    """Where each update goes is the gradient of the scattered sum of all, weighted by place."""

    def apply(eqn, x, index, update):
        if update.dtype != object:
            return np.asarray(eqn.primitive.bind(jnp.asarray(x), jnp.asarray(index), jnp.asarray(update), **eqn.params))
        params = {k: eqn.params[k] for k in ("indices_are_sorted", "unique_indices", "mode")}
        place = jnp.arange(1.0, x.size + 1, dtype=jnp.float64).reshape(x.shape)

        @jax.jit
        def sent(index):
            def put(values):
                zero = jnp.zeros(x.shape, jnp.float64)
                return jax.lax.scatter_add(zero, index, values, eqn.params["dimension_numbers"], **params)

            return jax.vjp(put, jnp.zeros(update.shape, jnp.float64))[1](place)[0]

        back = np.asarray(sent(jnp.asarray(index))).astype(int)
        found = x.ravel().copy()
        for at, number in zip(back.ravel(), update.ravel(), strict=True):
            if at:
                found[at - 1] = pair(found[at - 1], number)
        return found.reshape(x.shape)

    return apply


def update_slice(eqn, x, update, *starts):
    x, sizes = x.copy(), zip(starts, x.shape, update.shape, strict=True)
    begin = [int(np.clip(int(start), 0, n - m)) for start, n, m in sizes]
    x[tuple(slice(b, b + m) for b, m in zip(begin, update.shape, strict=True))] = update
    return x
