"""A plant, and the same loop: truth, measurement and estimate together."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxobs._loop import JITTER, Grid, Sample, as_state, check_period, divergence_time, require_parts, results, time_grid
from jaxobs._module import Module, Numbers, Scalar, check, dtype_of, float_leaves, key_axes, refuse, require_instance
from jaxobs._motion import Motion, World
from jaxobs.integrators import RK4, AbstractIntegrator, ProgressMeter, check_step, metered_scan
from jaxobs.metrics import AbstractMetric
from jaxobs.noise import AbstractNoise
from jaxobs.observers import AbstractFlowObserver, AbstractStepObserver, Observer
from jaxobs.plants import AbstractFlowPlant, AbstractPlant
from jaxobs.signals import AbstractSignal, Zero


class Trajectory(Module):
    """Truth and estimate on the grid. y = h(x, u) + w where valid, the expected output elsewhere.

    diverged_at [s] is the first time at which x or xhat is not finite, infinity if they always are.
    """

    ts: Float[Array, " T"]
    x: Float[Array, "T n"]
    xhat: Float[Array, "T n"]
    y: Float[Array, "T p"]
    valid: Bool[Array, "T p"]
    u: Float[Array, "T m ..."]
    innovation: Float[Array, "T p"]
    diverged_at: Scalar


def simulate(
    plant: AbstractPlant,
    observer: Observer,
    *,
    x0: Numbers,
    xhat0: Numbers,
    ts: Numbers,
    signal: AbstractSignal | None = None,
    noise: AbstractNoise | None = None,
    disturbance: AbstractNoise | None = None,
    key: Any = None,
    integrator: AbstractIntegrator | None = None,
    hold_innovation: bool = False,
    progress_meter: ProgressMeter | None = None,
) -> Trajectory:
    """The plant from x0 and the observer from xhat0 over the grid ts, with noise and disturbance sampled on it and held.

    Flow plant and flow observer are integrated jointly by `integrator` (RK4() if none): the observer sees h(x(t)) + w_k, only
    the noise is held. With a step observer the integrator drives the plant alone and the observer sees samples. A step plant
    takes step observers only. The disturbance enters through plant.disturbance_matrix(). `key` feeds both streams
    independently. The observer's model and the plant are two objects and may differ. progress_meter: one of diffrax's, told
    after each sample. Works under jit, vmap and grad.
    ValueError names the argument that does not fit.
    """
    world = World(plant, signal, noise, disturbance, integrator)
    require_parts("simulate", progress_meter=progress_meter)
    return _simulate(*_checked(world, observer, x0, xhat0, ts, key), key, hold_innovation, None, progress_meter)


def score(
    plant: AbstractPlant,
    observer: Observer,
    *,
    metrics: Mapping[str, AbstractMetric],
    x0: Numbers,
    xhat0: Numbers,
    ts: Numbers,
    signal: AbstractSignal | None = None,
    noise: AbstractNoise | None = None,
    disturbance: AbstractNoise | None = None,
    key: Any = None,
    integrator: AbstractIntegrator | None = None,
    hold_innovation: bool = False,
    progress_meter: ProgressMeter | None = None,
) -> dict[str, Any]:
    """What `simulate` does, keeping the metrics only: they are updated inside the loop and no trajectory is stored.

    `score(..., metrics={"rmse": RMSE(after=10.0)})["rmse"]`; plant and observer must have the same number of states. The key
    "diverged_at" is always there: the first time [s] at which x or xhat is not finite, infinity if they always are.
    """
    world = World(plant, signal, noise, disturbance, integrator)
    checked = check_scored("score", world, observer, metrics, x0, xhat0, ts, key)
    require_parts("score", progress_meter=progress_meter)
    return _simulate(*checked, key, hold_innovation, dict(metrics), progress_meter)


FLOWS = AbstractFlowPlant | AbstractFlowObserver


def check_scored(
    owner: str, world: World, observer: Observer, metrics, x0, xhat0, ts, key
) -> tuple[World, Observer, Array, Array, Grid]:
    """The parts of a run whose metrics alone are kept."""
    fix = 'Name them: metrics={"rmse": jaxobs.metrics.RMSE()}.'
    require_instance(owner, "metrics", metrics, Mapping, fix)
    for name, metric in metrics.items():
        require_instance(owner, f"metrics[{name!r}]", metric, AbstractMetric, fix)
    if "diverged_at" in metrics:
        raise refuse(owner, "metrics", "the name 'diverged_at'", "any other name", "That key holds the time of divergence.")
    checked = _checked(world, observer, x0, xhat0, ts, key, owner)
    if world.plant.n != observer.n:
        fix = "Metrics compare x with xhat; use simulate and compare what corresponds."
        raise refuse(owner, "observer", f"n = {observer.n} states", f"the plant's n = {world.plant.n}", fix)
    return checked


def _checked(
    world: World, observer: Observer, x0, xhat0, ts, key, owner: str = "simulate"
) -> tuple[World, Observer, Array, Array, Grid]:
    """The parts of a run: they fit each other and have one precision."""
    require_parts(owner, observer=observer, **world._asdict())
    check(world.plant)
    check(observer)
    plant = world.plant
    if world.integrator is not None and not any(isinstance(part, FLOWS) for part in (plant, observer)):
        given = type(world.integrator).__name__
        raise refuse(owner, "integrator", given, "none for a step plant with a step observer", "Leave it out.")
    world = world._replace(
        signal=Zero(plant.m) if world.signal is None else world.signal,
        integrator=RK4() if world.integrator is None else world.integrator,
    )
    dtype = _agree(world, observer, key, owner)
    # An exponential integrator makes its matrices for one step; a step observer counts samples; the rest takes any grid.
    uneven = 1e-3 if world.integrator.needs_uniform_grid else JITTER if isinstance(observer, AbstractStepObserver) else None
    grid = time_grid(owner, ts, dtype, uneven)
    check_period(owner, observer, grid.spacing)
    check_period(owner, plant, grid.spacing)
    if isinstance(observer, AbstractFlowObserver):
        check_step(owner, observer, world.integrator, jnp.max(grid.dts))
    start = as_state(owner, "x0", x0, plant.n, dtype)
    return world, observer, start, as_state(owner, "xhat0", xhat0, observer.n, dtype), grid


@eqx.filter_jit
def _simulate(
    world: World, observer: Any, x0, xhat0, grid: Grid, key, hold_innovation: bool, metrics: Any, meter: ProgressMeter | None
) -> Any:
    motion, ts = Motion(world, observer, hold_innovation, metrics), grid.ts
    w, valid, d = motion.draw(motion.streams(key), ts)
    us = jax.vmap(world.signal)(ts)
    disturbed = jax.vmap(motion.disturb, in_axes=(0, None))(d, x0)
    samples = Sample(jnp.arange(ts.shape[0]), ts, grid.dts, us, w, valid, disturbed)
    carry, cache = motion.start(x0, xhat0, jax.tree.map(lambda path: path[0], samples), grid.spacing)
    if metrics is not None:
        last, _ = metered_scan(lambda carry, sample: (motion.step(cache, carry, sample)[0], None), carry, samples, meter)
        return results(last, metrics)
    _, path = metered_scan(lambda carry, sample: motion.step(cache, carry, sample), carry, samples, meter)
    x, xhat, y, innovation = path
    return Trajectory(ts, x, xhat, y, valid, us, innovation, divergence_time(ts, x, xhat))


def _agree(world: World, observer: Observer, key: Any, owner: str) -> Any:
    """The parts fit each other; returns their common precision."""
    plant, signal, noise, disturbance, _ = world
    if not isinstance(plant, AbstractFlowPlant) and isinstance(observer, AbstractFlowObserver):
        raise refuse(
            owner, "observer", f"the flow observer {type(observer).__name__} for a step plant", "a step observer",
            "Wrap it: jaxobs.observers.Sampled(observer, integrator, dt).",
        )  # fmt: skip
    if observer.p != plant.p:
        raise refuse(owner, "observer", f"p = {observer.p} outputs", f"the plant's p = {plant.p}", "Match the output maps.")
    if signal.m != plant.m:
        fix = "Give a signal with one component for each input."
        raise refuse(owner, "signal", f"m = {signal.m} inputs", f"the plant's m = {plant.m}", fix)
    if key is None and (noise is not None or disturbance is not None):
        raise refuse(owner, "key", "None", "a PRNG key", "Noise and disturbance draw from it: key=jax.random.key(0).")
    if key is not None and key_axes(key) != 0:
        given = f"{type(key).__name__} of shape {np.shape(key)}"
        raise refuse(owner, "key", given, "one PRNG key", "Make it from the seed: key=jax.random.key(0).")
    dtype = dtype_of(observer)
    for name, part in (("plant", plant), ("signal", signal)):
        if float_leaves(part) and dtype_of(part) != dtype:  # a part without numbers takes the precision of the run
            fix = "Convert one of them with jaxobs.astype(part, dtype)."
            raise refuse(owner, name, f"precision {dtype_of(part)}", f"the observer's {dtype}", fix)
    return dtype
