"""StableHLO: the step as XLA takes it, for runtimes that have XLA but no Python."""

from typing import Any

import jax
import jax.export
import jax.numpy as jnp

from jaxobs._module import dtype_of, refuse
from jaxobs.export.tick import Tick

CALL = "step(*state, k, u, y) -> (*state, xhat); start(xhat0) -> (*state,)"


def stablehlo(tick: Tick, platforms: tuple[str, ...] = ("cpu",)) -> tuple[jax.export.Exported, jax.export.Exported]:
    """(start, step) as `jax.export.Exported`, compiled for these platforms when they are called; parameters are constants.

    start(xhat0) -> (*state,); step(*state, k, u, y) -> (*state, xhat): flat, the state's leaves in order, k an int32 scalar, u
    (m,), y (p,) with NaN where lost. ValueError for no or unknown platforms.
    """
    if not platforms or not set(platforms) <= {"cpu", "cuda", "rocm", "tpu"}:
        raise refuse("export", "platforms", platforms, "some of cpu, cuda, rocm, tpu", "One file serves several.")
    dtype = dtype_of(tick.observer)
    xhat0, u, y = (jax.ShapeDtypeStruct((size,), dtype) for size in (tick.observer.n, tick.observer.m, tick.observer.p))
    leaves, tree = jax.tree.flatten(jax.eval_shape(tick.start, xhat0))

    def start(xhat0: Any) -> tuple[Any, ...]:
        return tuple(jax.tree.leaves(tick.start(xhat0)))

    def step(*arguments: Any) -> tuple[Any, ...]:
        *state, k, u, y = arguments
        after, xhat = tick(k, jax.tree.unflatten(tree, state), u, y)
        return (*jax.tree.leaves(after), xhat)

    k = jax.ShapeDtypeStruct((), jnp.int32)
    return (
        jax.export.export(jax.jit(start), platforms=platforms)(xhat0),
        jax.export.export(jax.jit(step), platforms=platforms)(*leaves, k, u, y),
    )
