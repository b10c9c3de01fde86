"""What is given as a system, a plant or a plain function, as one function of the state and of everything else that enters."""

import dataclasses
import inspect
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import astype, refuse
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant

INF = np.inf


@dataclasses.dataclass(frozen=True)
class System:
    """x' = f(x, w) or x+ = f(x, w), w in lower .. upper: the inputs, and the time of a plant; h(x, w) the output, if known."""

    f: Callable[..., Any]
    h: Callable[..., Any] | None
    lower: np.ndarray
    upper: np.ndarray
    names: tuple[str, ...]
    step: bool


def system(owner: str, f: Any, inputs: Any = None) -> System:
    """A plant, its inputs u in inputs = (lower, upper), its time anything; or a function f(x), or f(x, u) with inputs given."""
    if isinstance(f, (AbstractFlowPlant, AbstractStepPlant)):
        plant, step = exact(f), isinstance(f, AbstractStepPlant)
        low, high = _bounds(owner, inputs, plant.m) if inputs is not None else (np.full(plant.m, -INF), np.full(plant.m, INF))
        move = plant.step if isinstance(plant, AbstractStepPlant) else plant.flow
        names = (*(f"u{i + 1}" for i in range(plant.m)), "k" if step else "t")
        return System(
            lambda x, w: move(w[-1], x, w[:-1]),
            lambda x, w: plant.h(x, w[:-1]),
            np.append(low, 0.0 if step else -INF),
            np.append(high, INF),
            names,
            step,
        )
    if not callable(f):
        raise refuse(owner, "f", repr(f), "a plant, or a function f(x) or f(x, u)", "Write x' = f(x) with jax.numpy.")
    if inputs is None:
        if len(inspect.signature(f).parameters) > 1:
            given = f"a function of {list(inspect.signature(f).parameters)}, and no inputs"
            raise refuse(owner, "inputs", given, "bounds on u for an f(x, u)", "Give inputs=(lower, upper).")
        return System(lambda x, w: f(x), None, np.empty(0), np.empty(0), (), False)
    low, high = _bounds(owner, inputs, None)
    return System(f, None, low, high, tuple(f"u{i + 1}" for i in range(len(low))), False)


def exact(plant: Any) -> Any:
    """The plant with float64 leaves: the numbers it has, whatever JAX's precision is."""
    with jax.enable_x64(True):
        return astype(plant, jnp.float64)


def _bounds(owner: str, inputs: Any, m: int | None) -> tuple[np.ndarray, np.ndarray]:
    low, high = (np.atleast_1d(np.asarray(end, float)) for end in inputs)
    if low.shape != high.shape or low.ndim != 1 or (m is not None and low.shape != (m,)):
        expected = "(lower, upper), one number an input each" + (f": {m}" if m is not None else "")
        raise refuse(owner, "inputs", f"shapes {low.shape} and {high.shape}", expected, "For example ([-0.5], [0.5]).")
    if not np.all(low <= high):
        raise refuse(owner, "inputs", f"{low.tolist()} .. {high.tolist()}", "lower <= upper", "Swap the two.")
    return low, high
