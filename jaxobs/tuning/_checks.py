"""The arguments of `tune`, and what a loss has to be."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse, require_instance
from jaxobs.tuning.certifiers.base import AbstractCertifier

NUDGE = 1e-2  # where a loss is looked at again: its slope may vanish at one point by chance


def require_arguments(
    theta0: Any, starts: Sequence[Any], certify: AbstractCertifier | None, rate: float | None
) -> tuple[list[Any], float]:
    """(the thetas to start from, the rate)."""
    if jnp.result_type(float) != jnp.float64:
        fix = "Call jax.config.update('jax_enable_x64', True) first: gains and their slopes spread over decades."
        raise refuse("tune", "precision", "float32", "float64", fix)
    thetas = [jax.tree.map(_number, theta) for theta in (theta0, *starts)]
    if not jax.tree.leaves(thetas[0]):
        raise refuse("tune", "theta0", repr(theta0), "at least one number", "Give what is to be tuned.")
    for i, theta in enumerate(thetas[1:]):
        if _shapes(theta) != _shapes(thetas[0]):
            raise refuse("tune", f"starts[{i}]", _shapes(theta), f"{_shapes(thetas[0])}, as theta0", "Encode them alike.")
    if certify is None:
        if rate is not None:
            raise refuse("tune", "rate", rate, "nothing with certify=None", "Without a certificate no rate is proved.")
        return thetas, 0.0
    require_instance("tune", "certify", certify, AbstractCertifier, "E.g. jaxobs.tuning.Quadratic(model), or None.")
    step = certify.unit == "a step"
    rate = (1.0 if step else 0.0) if rate is None else rate
    if not (isinstance(rate, (int, float, np.number)) and np.isfinite(rate) and (0 < rate <= 1 if step else rate >= 0)):
        expected = "a factor in ]0, 1]" if step else "a number >= 0, in 1/s"
        raise refuse("tune", "rate", repr(rate), expected, "Leave it out to ask for decay alone.")
    return thetas, float(rate)


def require_finite_loss(mean: Callable[[Any], Any], theta: Any, start: int) -> None:
    """ValueError naming the start and the key; mean(theta) = (values (losses,), the first bad key or -1)."""
    values, lane = mean(theta)
    if jnp.ndim(values) != 1:
        raise refuse("tune", "loss", f"shape {jnp.shape(values)[1:]}", "a number", "Choose one state, or add them up.")
    if not np.all(np.isfinite(values)):
        value = float(values[np.argmin(np.isfinite(values))])
        which = "theta0" if start == 0 else f"starts[{start - 1}]"
        given = f"{value} at {which}, step 0, lane keys[{int(lane)}]" if int(lane) >= 0 else f"{value} at {which}"
        fix = "Start from gains with which this run does not diverge, or use a shorter step."
        raise refuse("tune", "loss", given, "a finite number", fix)


def require_dependence(mean: Callable[[Any], Any], theta: Any) -> None:
    """ValueError naming a part of theta along which the loss has no slope at all, here and a little further."""
    slope = jax.jit(jax.grad(mean))
    near = jax.tree.map(lambda leaf: leaf + NUDGE * jnp.cos(jnp.arange(leaf.size, dtype=leaf.dtype)).reshape(leaf.shape), theta)
    slopes = [jax.tree_util.tree_flatten_with_path(slope(at))[0] for at in (theta, near)]
    for (path, one), (_, other) in zip(*slopes, strict=True):
        if not (np.any(np.asarray(one)) or np.any(np.asarray(other))):
            name = jax.tree_util.keystr(path) or "theta itself"
            fix = "Leave it out of theta, or let make or loss use it."
            raise refuse(
                "tune", f"theta0{name if path else ''}", "a loss with no slope along it", "one that depends on it", fix
            )


def _number(leaf: Any) -> Any:
    return jnp.asarray(leaf, jnp.float64)


def _shapes(theta: Any) -> str:
    return str(jax.tree.map(jnp.shape, theta))
