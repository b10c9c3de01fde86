"""A certificate of the recursion itself: in the form that the theorem about this observer takes."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import Sampled as SampledCertificate
from jaxobs.certificates import SampledTube, StepCorners
from jaxobs.designs import corner_lmi, current_form, held_behind, sampled_data, tracker_form
from jaxobs.designs.error_gain import error_gain
from jaxobs.designs.polytope import Polytope
from jaxobs.observers import (
    AbstractStepObserver,
    CurrentLuenberger,
    DiscreteTracker,
    HighGain,
    InnerInjection,
    IntegralHighGain,
    Luenberger,
    Sampled,
    StepIntegral,
    StepLuenberger,
)
from jaxobs.plants import IntegratorChain, Linear, LinearStep, SampledChain, WithTones

LINEAR = (IntegratorChain, Linear, LinearStep, SampledChain, WithTones)
ROOM = 0.02  # of 1 - factor, from the best factor to one that a rounded gain still has


def prove(
    observer: AbstractStepObserver, model: Polytope | None = None, *, rate: float | None = None, origin: str = "given"
) -> SampledCertificate | SampledTube | StepCorners:
    """The exact certificate of what `observer` does from sample to sample:

        Sampled(..., holds="innovation")    designs.sampled_data for its period, behind integrators by designs.held_behind
        StepLuenberger, StepIntegral        F'P F < rate^2 P by designs.corner_lmi
        CurrentLuenberger, DiscreteTracker  the same in the form of designs.current_form and designs.tracker_form

    model: the error of the observer's model without a gain (`designs.lpv_model`, or the `.model` of `designs.lpv_from`), not
    needed where that is linear. rate: decay [1/s], 0 if not given, of Sampled; else the factor a step, near the best one if not
    given. origin: where the bounds come from. Infeasible if it is not proved; ValueError for an observer without such a form.
    """
    if isinstance(observer, Sampled):
        return _held(observer, model, rate, origin)
    if isinstance(observer, DiscreteTracker):
        form = tracker_form(observer.n, observer.q, float(observer.dt))
    elif isinstance(observer, CurrentLuenberger | StepLuenberger | StepIntegral):
        form = _form(observer, _model(observer.model, model))
    else:
        fix = "Export it without a certificate."
        raise refuse("prove", "observer", type(observer).__name__, "Sampled, or a step observer with a constant gain", fix)
    gain = _gain(observer).reshape(-1, form.p)
    if rate is None:
        best = corner_lmi.largest_rate(form, gain, step=True)
        rate = min(best + ROOM * (1 - best), 1.0)
    found = corner_lmi.prove(form, gain, rate=rate, step=True, origin=origin)
    assert isinstance(found, StepCorners)
    return found


def _held(observer: Sampled, model: Polytope | None, rate: float | None, origin: str) -> SampledCertificate | SampledTube:
    inside: Any = observer.observer
    if observer.holds != "innovation":
        fix = "Take holds='innovation'; with a held measurement the error does not go to zero while the output moves."
        raise refuse("prove", "observer", "Sampled(..., holds='output')", "a held innovation", fix)
    if not isinstance(inside, HighGain | IntegralHighGain | Luenberger | InnerInjection):
        fix = "Export it without a certificate."
        raise refuse("prove", "observer", type(inside).__name__, "an observer with a constant gain inside Sampled", fix)
    given = _model(inside.model, model)
    gain = _gain(inside).reshape(-1, given.p)
    if isinstance(inside, IntegralHighGain) and inside.q:
        given, gain = held_behind(given, gain, inside.q)
    inner = np.asarray(inside.inner, float) if isinstance(inside, InnerInjection) else None
    return sampled_data(given, gain, delta=float(observer.dt), rate=rate or 0.0, inner=inner, origin=origin)


def _gain(observer: Any) -> np.ndarray:
    if isinstance(observer, DiscreteTracker):
        if observer.start is not None:
            fix = "Its gain opens over the first samples: take start=None, whose gain is the one in steady state."
            raise refuse("prove", "observer", "DiscreteTracker with a start", "a constant gain", fix)
        return np.asarray(observer.gain(jnp.zeros(())), float)
    return np.asarray(observer.gain if isinstance(observer, CurrentLuenberger) else error_gain(observer), float)


def _model(plant: Any, given: Polytope | None) -> Polytope:
    """The one that is given, or that of a linear plant."""
    if given is not None:
        return given
    if not isinstance(plant, LINEAR):
        fix = "designs.lpv_model(plant, bounds) or designs.lpv_from(plant, box) makes it from bounds on the slopes."
        raise refuse("prove", "model", "None", f"the error dynamics of {type(plant).__name__}, which is not linear", fix)
    x, u, zero = jnp.zeros(plant.n), jnp.zeros(plant.m), jnp.zeros(())
    move: Any = getattr(plant, "step", None) or getattr(plant, "flow")  # noqa: B009 (one of the two is there)
    a, c = (np.asarray(jax.jacfwd(f)(x), float) for f in (lambda x: move(zero, x, u), lambda x: plant.h(x, u)))
    return Polytope(a, np.zeros((plant.n, 0)), np.zeros((0, plant.n)), np.zeros(0), np.zeros(0), c)


def _form(observer: Any, model: Polytope) -> Polytope:
    if isinstance(observer, CurrentLuenberger):
        return current_form(model)
    if isinstance(observer, StepIntegral):
        flow, dt = model.behind(observer.q), float(observer.dt)
        return Polytope(np.eye(flow.n) + dt * flow.a, dt * flow.b, flow.c, flow.lower, flow.upper, flow.output, flow.tied)
    return model
