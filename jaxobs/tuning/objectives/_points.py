"""What the objectives at operating points share."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import refuse, require_finite
from jaxobs.observers import Observer
from jaxobs.tuning.linear_error import LinearError, linearise

WEIGHT = "Weights (n,) of the states, or a matrix (s, n) with one row for each weighted sum of them."


def check_points(objective: Any) -> None:
    """points (S, n), inputs (S, m) or (S, m, r) or None, weight (n,) or (s, n) or None: ValueError otherwise."""
    plant, points, inputs = objective.plant, objective.points, objective.inputs
    if np.ndim(points) != 2 or np.shape(points)[1] != plant.n or np.shape(points)[0] == 0:
        fix = "One row for each operating point: points=[[0.0, 0.0]]."
        raise refuse(objective, "points", f"shape {np.shape(points)}", f"(any, {plant.n})", fix)
    if inputs is not None and (np.ndim(inputs) < 2 or np.shape(inputs)[:2] != (np.shape(points)[0], plant.m)):
        expected = f"({np.shape(points)[0]}, {plant.m})"
        raise refuse(objective, "inputs", f"shape {np.shape(inputs)}", expected, "One row for each operating point.")
    if hasattr(objective, "weight"):
        check_weight(objective, plant.n)


def check_weight(objective: Any, n: int) -> None:
    if objective.weight is None:
        return
    shape = np.shape(objective.weight)
    if len(shape) not in (1, 2) or shape[-1] != n:
        raise refuse(objective, "weight", f"shape {shape}", f"({n},) or (any, {n})", WEIGHT)
    require_finite(objective, "weight", objective.weight)


def weight_matrix(weight: Float[Array, "..."] | None, n: int, dtype: Any) -> Float[Array, "s n"]:
    """E of the weighted error E (xhat - x): the identity if not given, a diagonal for n numbers."""
    if weight is None:
        return jnp.eye(n, dtype=dtype)
    return jnp.diag(weight.astype(dtype)) if weight.ndim == 1 else weight.astype(dtype)


def linear_errors(objective: Any, observer: Observer, process: Any = None, noise: Any = None) -> LinearError:
    """The linear error at every operating point, along a leading axis."""
    options = {"process": process, "noise": noise}
    if objective.inputs is None:
        return jax.vmap(lambda x: linearise(observer, objective.plant, x, **options))(objective.points)
    points = (objective.points, objective.inputs)
    return jax.vmap(lambda x, u: linearise(observer, objective.plant, x, u, **options))(*points)


def root(mean: Float[Array, ""]) -> Float[Array, ""]:
    """The square root, with the gradient 0 at 0; infinity stays."""
    positive = mean > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, mean, 1)), mean)
