"""Bounds on the slopes of a plant's f, proved, in the form that `lpv_lmi` and `lpv_model` take; also for saturated plants."""

from collections.abc import Iterator
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxobs._module import dtype_of, refuse, require_instance
from jaxobs.designs._parameters import Bounded, bounded
from jaxobs.designs._system import System, exact, system
from jaxobs.designs.lpv_from import as_set, derivative, require_bounded, require_proof, sentence, way_of
from jaxobs.designs.lpv_model import Channels
from jaxobs.designs.sets import AbstractSet
from jaxobs.intervals import Interval
from jaxobs.intervals.jacobian import assumptions
from jaxobs.plants import AbstractChain, AbstractFlowPlant, AbstractLipschitz, AbstractStepPlant, Discretised, Saturated

Channel = tuple[np.ndarray, np.ndarray, float, float, Any]  # left, right, lower, upper, the name of the parameter


def proved_channels(
    plant: AbstractFlowPlant | AbstractStepPlant,
    box: AbstractSet | tuple[Any, Any],
    channels: str = "auto",
    *,
    inputs: Any = None,
    rtol: float = 1e-6,
    max_boxes: int = 20_000,
) -> Channels:
    """Channels of f in x' = A x + B f(x) + g(y, u), or of phi(x, u) in a chain: f(x) - f(z) = sum_k h_k b_k c_k' (x - z).

    For `Saturated(plant, lower, upper)`, x in the set and z anything, f(x) - f(sat z) = J (x - sat z) = J D (x - z), where D is
    diagonal with entries in [0, 1] and J a mean of df/dx on the saturation box, which has to contain the set: each parameter
    and column j makes the channel h_k d_j M_k e_j e_j', bounded by the hull of 0 and [lower_k, upper_k]. Columns that do not
    saturate (both ends infinite) have d_j = 1 and keep what they share.

    Arguments and errors as for `lpv_from`. The channels' origin says what is proved and what is assumed.
    """
    domain, way = as_set(box), way_of("proved_channels", channels)
    model = plant.plant if isinstance(plant, Discretised) else plant
    fix = "Write it as x' = A x + B f(x) + g(y, u), y = C x: a subclass of AbstractLipschitz; or use lpv_from."
    require_instance("proved_channels", "plant", model, AbstractLipschitz | AbstractChain, fix)
    require_proof("proved_channels", domain)
    inner = exact(model.plant if isinstance(model, Saturated) else model)
    made, n = _slopes_of(inner, inputs), model.n
    if len(domain.lower) != n:
        raise refuse("proved_channels", "box", f"{len(domain.lower)} states", f"{n}, those of the plant", "One pair a state.")
    cut = model if isinstance(model, Saturated) else domain
    low, high = np.asarray(cut.lower, float), np.asarray(cut.upper, float)
    if np.any(domain.lower < low) or np.any(domain.upper > high):
        given = f"{domain.lower.tolist()} .. {domain.upper.tolist()}, saturated to {low.tolist()} .. {high.tolist()}"
        raise refuse("proved_channels", "box", given, "a set inside the saturation box", "Saturate to the set's own box.")
    z = Interval(np.append(low, made.lower), np.append(high, made.upper))
    slopes = derivative(made, n)
    slopes.graph.variables = (*(f"x{i + 1}" for i in range(n)), *made.names)
    found = bounded(slopes, way, z, rtol=rtol, max_boxes=max_boxes)
    require_bounded("proved_channels", found, domain, made)
    flat = np.isfinite(low) | np.isfinite(high) if isinstance(model, Saturated) else np.zeros(n, bool)
    parts = list(_channels(found, flat))
    names = {name: number for number, name in enumerate(dict.fromkeys(part[4] for part in parts))}
    taken = assumptions(lambda z: made.f(z[:n], z[n:]), z)
    estimate = "its estimate is anything, f being saturated to a box that contains the set" if flat.any() else None
    return Channels(
        np.reshape([part[0] for part in parts], (-1, found.shape[0])).T,
        np.reshape([part[1] for part in parts], (-1, n)),
        np.array([part[2] for part in parts]),
        np.array([part[3] for part in parts]),
        tuple(names[part[4]] for part in parts),
        sentence(domain, made, found, taken, estimate),
        complete=True,
    )


def _slopes_of(inner: Any, inputs: Any) -> System:
    """f(x), or phi(x, u) of a chain, as a system."""
    if isinstance(inner, AbstractChain):
        whole = system("proved_channels", inner, inputs)
        low, high, names = whole.lower[:-1], whole.upper[:-1], whole.names[:-1]
        return System(lambda x, w: inner.phi(x, w)[None], None, low, high, names, False)
    return System(lambda x, w: inner.f(x), None, np.empty(0), np.empty(0), (), False)


def _channels(found: Bounded, flat: np.ndarray) -> Iterator[Channel]:
    """Channels of J = J_0 + sum_k h_k M_k, or where column j saturates of J D."""
    n, constant = found.shape[1], found.constant()
    for j in np.flatnonzero(np.any(constant != 0, axis=0)):
        yield constant[:, j], np.eye(n)[j], 0.0 if flat[j] else 1.0, 1.0, ("constant", int(j) if flat[j] else None)
    left, right, numbers = found.arrays()
    for b, c, k in zip(left.T, right, numbers, strict=True):
        low, high = float(found.lower[k]), float(found.upper[k])
        if np.any(rest := np.where(flat, 0.0, c)):
            yield b, rest, low, high, (k, None)
        for j in np.flatnonzero(np.where(flat, c, 0.0)):
            yield b * c[j], np.eye(n)[j], min(low, 0.0), max(high, 0.0), (k, int(j))


def saturated(plant: AbstractLipschitz, domain: AbstractSet) -> Saturated:
    """The plant with its f saturated to the box of a set, its ends rounded outward in the plant's precision."""
    dtype = np.dtype(dtype_of(plant))
    ends = []
    for end, out in ((domain.lower, -np.inf), (domain.upper, np.inf)):
        rounded = end.astype(dtype)
        inside = rounded > end if out < 0 else rounded < end
        ends.append(np.where(inside, np.nextafter(rounded, dtype.type(out)), rounded))
    return Saturated(plant, *(jnp.asarray(end, dtype) for end in ends))
