"""The LPV/LMI design of paper 004: one gain for all slopes of f between their bounds."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import Numbers, dtype_of, refuse
from jaxobs.certificates import Corners, StepCorners
from jaxobs.designs import corner_lmi
from jaxobs.designs._chain_gain import warn_large_gain
from jaxobs.designs.detectability import undetectable
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.lpv_model import Channels, lpv_model, slope_entries
from jaxobs.designs.polytope import Polytope
from jaxobs.integrators import Euler
from jaxobs.observers import InnerInjection, Luenberger, OutputInjection, Sampled, StepLuenberger, measured
from jaxobs.plants import AbstractChain, AbstractFlowPlant, AbstractStepPlant, Discretised, Saturated

Plant = AbstractFlowPlant | AbstractStepPlant
Observer = Luenberger | StepLuenberger | InnerInjection | OutputInjection | Sampled
Certificate = Corners | StepCorners


def lpv_lmi(
    plant: Plant,
    *,
    bounds: Channels | tuple[Any, Any],
    rate: float | None = None,
    gain: Numbers | None = None,
    inner: bool = False,
    process: Any = None,
    noise: Any = None,
) -> tuple[Observer, Certificate]:
    """L and P > 0 for the error e' = (A(rho) - L C) e of the observer z' = A z + B f(z) + g(y, u) + L (y - C z), with

        A(alpha)'P + P A(alpha) - C'R - R'C + 2 rate P < 0   at all corners alpha,    L = P^-1 R'      (paper 004, (7), (12))
        F'P F < rate^2 P,   F = A(alpha) - L C               at all corners alpha, for Discretised(plant, Euler(), T)    (16)

    bounds: (lower, upper) on the entries of the Jacobian of f, both (q, n), 0, 0 where it vanishes; or `Channels` for tied
    entries, exact midpoints, scalar slopes. rate [1/s], or the factor a step in ]0, 1]; decay alone if not given
    (`lpv_rate` gives the largest). Among the gains that do it the least sensitive to white noise, see corner_lmi.synthesise for
    process and noise. gain: prove this one instead. inner: f of the observer sees the measurement in place of measured states.

    The bounds hold for slopes between x and its estimate, so for both in one box; a model wrapped in `Saturated` is exempt
    from that for the estimate. The certificate states where the bounds come from; it is about the gain that the observer has.
    Infeasible names an undetectable point, before anything is solved, or the best rate found; ValueError for bad arguments.
    """
    channels = bounds if isinstance(bounds, Channels) else slope_entries(*_pair(bounds))
    model = lpv_model(plant, channels, inner=inner)
    step = isinstance(plant, Discretised)
    _require_detectable(model, rate, step)
    options = {"rate": rate, "step": step, "origin": _origin(plant, channels)}
    if gain is None:
        found, certificate = corner_lmi.synthesise(model, process=process, noise=noise, **options)
    else:
        found = np.asarray(gain, float)
        certificate = corner_lmi.prove(model, found, **options)
    observer, carried = _observer(plant, found, inner)
    if not np.array_equal(carried, found):  # rounded to the plant's precision
        certificate = corner_lmi.prove(model, carried, **options)
    warn_large_gain("lpv_lmi", carried, "ask for a lower rate, or give a larger noise intensity")
    return observer, certificate


def lpv_rate(plant: Plant, *, bounds: Channels | tuple[Any, Any], gain: Numbers | None = None, inner: bool = False) -> float:
    """The supremum of the rates [1/s] that (7) or (12) proves, by bisection; of one gain, or of any within reach. For
    Discretised plants the infimum of the factors a step. A negative rate, or a factor above 1: nothing is certified."""
    channels = bounds if isinstance(bounds, Channels) else slope_entries(*_pair(bounds))
    model = lpv_model(plant, channels, inner=inner)
    given = None if gain is None else np.asarray(gain, float)
    return corner_lmi.largest_rate(model, given, step=isinstance(plant, Discretised))


def _pair(bounds: Any) -> tuple[Any, Any]:
    if not (isinstance(bounds, (tuple, list)) and len(bounds) == 2):
        fix = "Or Channels, from jaxobs.designs.midpoint_channels or simulated_entries."
        raise refuse("lpv_lmi", "bounds", type(bounds).__name__, "(lower, upper) of the Jacobian of f", fix)
    return bounds[0], bounds[1]


def _require_detectable(model: Polytope, rate: float | None, step: bool) -> None:
    point = undetectable(model, rate=rate or 0.0, step=step)
    if point is not None:
        margin = 1 - abs(point.eigenvalue) if step else -point.eigenvalue.real
        change = "No gain moves this mode: measure something else, or give bounds that exclude the point."
        tried = ("the pair (A(rho), C) on the box, before any solve",)
        raise Infeasible(str(point), margin, change, tried=tried, certificate=point.certificate)


def _origin(plant: Plant, channels: Channels) -> str:
    if channels.complete:
        return channels.origin
    inside = plant.plant if isinstance(plant, Discretised) else plant
    if isinstance(inside, Saturated):
        box = f"{np.asarray(inside.lower).tolist()} .. {np.asarray(inside.upper).tolist()}"
        return f"{channels.origin}; the plant is assumed to stay in {box}, its estimate is free"
    return f"{channels.origin}; they hold between the state and its estimate"


def _observer(plant: Any, gain: np.ndarray, inner: bool) -> tuple[Observer, np.ndarray]:
    """The observer, and the gain it carries as a plant of its kind has it."""
    dtype = dtype_of(plant)
    model: Any = plant.plant if isinstance(plant, Discretised) else plant
    injects = inner or (not isinstance(model, AbstractChain) and _knows_output(model))
    if not injects:
        own = jnp.asarray(gain, dtype)
        observer = StepLuenberger(plant, own) if isinstance(plant, Discretised) else Luenberger(plant, own)
        return observer, np.asarray(own, float)
    dt = float(plant.dt) if isinstance(plant, Discretised) else 1.0
    flow_gain = jnp.asarray(gain / dt, dtype)
    if isinstance(model, AbstractChain):
        observer = OutputInjection(model, flow_gain)
    else:
        known = measured(model)
        observer = InnerInjection(model, flow_gain, known if inner else jnp.zeros_like(known))
    carried = np.asarray(flow_gain, float) * dt
    if np.allclose(carried, gain, rtol=4 * np.finfo(float).eps, atol=0):
        carried = gain  # times dt and back: the certificate is about real arithmetic
    return (Sampled(observer, Euler(), plant.dt), carried) if isinstance(plant, Discretised) else (observer, carried)


def _knows_output(model: Any) -> bool:
    """Whether g(y, u) depends on y: then the observer has to be given y itself, as in (4)."""
    dtype = dtype_of(model)
    slopes = jax.jacfwd(model.g)
    points = np.random.default_rng(0).normal(size=(4, model.p + model.m))
    return any(bool(jnp.any(slopes(jnp.asarray(x[: model.p], dtype), jnp.asarray(x[model.p :], dtype)) != 0)) for x in points)
