"""From z' = flow(t, z) to z(t + dt), one grid interval at a time."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from jaxobs._module import Module, Scalar, concrete, refuse
from jaxobs.integrators.limits import warn_step

State = PyTree


class Field(NamedTuple):
    """A vector field on pytrees, and if it has a stiff linear part, how it splits.

    split(t, z) -> (A, b) has flow = A z + b leaf by leaf: A a matrix for a vector leaf, or None where A = 0. A is constant.
    """

    flow: Callable[[Scalar, State], State]
    split: Callable[[Scalar, State], tuple[Any, State]] | None = None


class AbstractIntegrator(Module):
    """`cache = prepare(field, dt, z)` once for each trajectory, outside the loop; then `step` for each grid interval."""

    needs_uniform_grid: ClassVar[bool] = False
    stability_limit: ClassVar[float | None] = None  # the largest lambda h on z' = -lambda z of an explicit method
    stability_order: ClassVar[int | None] = None  # of an explicit method with as many stages as its order

    @abc.abstractmethod
    def prepare(self, field: Field, dt: Scalar, z: State) -> Any: ...

    @abc.abstractmethod
    def step(self, field: Field, cache: Any, t: Scalar, dt: Scalar, z: State) -> State: ...


def repeat(advance: Callable[[Scalar, State], State], substeps: int, t: Scalar, dt: Scalar, z: State) -> State:
    """`substeps` equal steps of length dt / substeps; `advance(t, z)` makes one."""
    if substeps == 1:
        return advance(t, z)
    start = jax.numpy.asarray(t, dt.dtype)
    return jax.lax.fori_loop(0, substeps, lambda i, z: advance(start + i.astype(dt.dtype) * dt / substeps, z), z)


def axpy(scale: Scalar, x: State, y: State) -> State:
    """scale * x + y, leaf by leaf."""
    return jax.tree.map(lambda a, b: scale * a + b, x, y)


def check_step(owner: str, part: Module, integrator: AbstractIntegrator, dt: Any) -> None:
    """A part that says how fast its own equations decay (`fastest_rate`) meets steps that an explicit method can take.

    ValueError, where the values are concrete, with the limit of the method and the steps that keep it. An observer whose
    constant gain puts `error_poles()` beyond the method is warned about only: what its nonlinearity does, they do not say.
    """
    warn_step(owner, part, integrator, dt)
    rate, limit = getattr(part, "fastest_rate", None), integrator.stability_limit
    if rate is None or limit is None:
        return
    known, step = concrete(rate), concrete(dt)
    if known is None or step is None:
        return
    substeps = getattr(integrator, "substeps", 1)
    product = float(np.max(known)) * float(step) / substeps
    if product >= limit:
        need = int(float(np.max(known)) * float(step) / limit) + 1
        given = f"{type(integrator).__name__} at steps of {float(step) / substeps:.6g} s, rate * step = {product:.4g}"
        fix = f"Take substeps={need} or more, a smaller period, or a step observer such as StepLyapunov."
        raise refuse(owner, "integrator", given, f"less than {limit}, its limit of stability, for {type(part).__name__}", fix)
