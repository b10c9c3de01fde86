"""A plant, and the same loop: truth, measurement and estimate together."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxobs._loop import JITTER, Grid, Sample, as_state, check_period, divergence_time, require_parts, run, time_grid
from jaxobs._module import Module, Numbers, Scalar, check, dtype_of, float_leaves, key_axes, refuse, require_instance
from jaxobs.integrators import RK4, AbstractIntegrator, Field, check_step
from jaxobs.metrics import AbstractMetric
from jaxobs.noise import AbstractNoise, Silent
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
) -> Trajectory:
    """The plant from x0 and the observer from xhat0 over the grid ts, with noise and disturbance sampled on it and held.

    Flow plant and flow observer are integrated jointly by `integrator` (RK4() if none): the observer sees h(x(t)) + w_k, only
    the noise is held. With a step observer the integrator drives the plant alone and the observer sees samples. A step plant
    takes step observers only. The disturbance enters through plant.disturbance_matrix(). `key` feeds both streams
    independently. The observer's model and the plant are two objects and may differ. Works under jit, vmap and grad.
    ValueError names the argument that does not fit.
    """
    world = _World(plant, signal, noise, disturbance, integrator)
    return _simulate(*_checked(world, observer, x0, xhat0, ts, key), key, hold_innovation, None)


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
) -> dict[str, Any]:
    """What `simulate` does, keeping the metrics only: they are updated inside the loop and no trajectory is stored.

    `score(..., metrics={"rmse": RMSE(after=10.0)})["rmse"]`; plant and observer must have the same number of states. The key
    "diverged_at" is always there: the first time [s] at which x or xhat is not finite, infinity if they always are.
    """
    fix = 'Name them: metrics={"rmse": jaxobs.metrics.RMSE()}.'
    require_instance("score", "metrics", metrics, Mapping, fix)
    for name, metric in metrics.items():
        require_instance("score", f"metrics[{name!r}]", metric, AbstractMetric, fix)
    if "diverged_at" in metrics:
        raise refuse("score", "metrics", "the name 'diverged_at'", "any other name", "That key holds the time of divergence.")
    checked = _checked(_World(plant, signal, noise, disturbance, integrator), observer, x0, xhat0, ts, key)
    if plant.n != observer.n:
        fix = "Metrics compare x with xhat; use simulate and compare what corresponds."
        raise refuse("score", "observer", f"n = {observer.n} states", f"the plant's n = {plant.n}", fix)
    return _simulate(*checked, key, hold_innovation, dict(metrics))


FLOWS = AbstractFlowPlant | AbstractFlowObserver


class _World(NamedTuple):
    """Everything that is not the observer."""

    plant: Any
    signal: Any
    noise: AbstractNoise | None
    disturbance: AbstractNoise | None
    integrator: Any


def _checked(world: _World, observer: Observer, x0, xhat0, ts, key) -> tuple[_World, Observer, Array, Array, Grid]:
    """The parts of a run: they fit each other and have one precision."""
    require_parts("simulate", observer=observer, **world._asdict())
    check(world.plant)
    check(observer)
    plant = world.plant
    if world.integrator is not None and not any(isinstance(part, FLOWS) for part in (plant, observer)):
        given = type(world.integrator).__name__
        raise refuse("simulate", "integrator", given, "none for a step plant with a step observer", "Leave it out.")
    world = world._replace(
        signal=Zero(plant.m) if world.signal is None else world.signal,
        integrator=RK4() if world.integrator is None else world.integrator,
    )
    dtype = _agree(world, observer, key)
    # An exponential integrator makes its matrices for one step; a step observer counts samples; the rest takes any grid.
    uneven = 1e-3 if world.integrator.needs_uniform_grid else JITTER if isinstance(observer, AbstractStepObserver) else None
    grid = time_grid("simulate", ts, dtype, uneven)
    check_period("simulate", observer, grid.spacing)
    check_period("simulate", plant, grid.spacing)
    if isinstance(observer, AbstractFlowObserver):
        check_step("simulate", observer, world.integrator, jnp.max(grid.dts))
    start = as_state("simulate", "x0", x0, plant.n, dtype)
    return world, observer, start, as_state("simulate", "xhat0", xhat0, observer.n, dtype), grid


@eqx.filter_jit
def _simulate(world: _World, observer: Any, x0, xhat0, grid: Grid, key, hold_innovation: bool, metrics: Any) -> Any:
    plant, signal, noise, disturbance, integrator = world
    ts, dtype = grid.ts, x0.dtype
    count = ts.shape[0]
    noise_key, disturbance_key = jax.random.split(jax.random.key(0) if key is None else key)
    w, valid = (noise or Silent()).sample(noise_key, ts, plant.p)
    d = jnp.zeros((count, plant.n), dtype)
    if disturbance is not None:
        e = plant.disturbance_matrix().astype(dtype)
        d = disturbance.sample(disturbance_key, ts, e.shape[1])[0].astype(dtype) @ e.T
    us = jax.vmap(signal)(ts)
    samples = Sample(jnp.arange(count), ts, grid.dts, us, w.astype(dtype), valid, d)
    step_plant = not isinstance(plant, AbstractFlowPlant)
    joint = isinstance(observer, AbstractFlowObserver)

    def measure(x, sample):
        return plant.h(x, sample.u) + sample.y

    def plant_field(sample):
        def split(t, x):
            a, b = plant.split(t, x, signal(t))
            return a, b + sample.d

        return Field(lambda t, x: plant.flow(t, x, signal(t)) + sample.d, split if hasattr(plant, "split") else None)

    def joint_field(sample, held):
        def seen(t, x, z, u):
            return jnp.where(sample.valid, plant.h(x, u) + sample.y, observer.predict(t, z, u) + held)

        def flow(t, xz):
            (x, z), u = xz, signal(t)
            return plant.flow(t, x, u) + sample.d, observer.flow(t, z, u, seen(t, x, z, u))

        def split(t, xz):
            (x, z), u = xz, signal(t)
            a, b = observer.split(t, z, u, seen(t, x, z, u))
            return (None, a), (plant.flow(t, x, u) + sample.d, b)

        return Field(flow, split if hasattr(observer, "split") else None)

    z0 = observer.init(xhat0)
    first = jax.tree.map(lambda path: path[0], samples)
    cache = None
    if joint:
        cache = integrator.prepare(joint_field(first, jnp.zeros_like(first.y)), grid.spacing, (x0, z0))
    elif not step_plant:
        cache = integrator.prepare(plant_field(first), grid.spacing, x0)

    def advance(x, z, sample, y, held):
        if joint:
            return integrator.step(joint_field(sample, held), cache, sample.t, sample.dt, (x, z))
        z = observer.step(sample.k, z, sample.u, y)
        if step_plant:
            return plant.step(sample.k, x, sample.u) + sample.d, z
        return integrator.step(plant_field(sample), cache, sample.t, sample.dt, x), z

    out = run(observer, x0, z0, samples, measure, advance, hold_innovation, metrics)
    if metrics is not None:
        return out
    x, xhat, y, innovation = out
    return Trajectory(ts, x, xhat, y, valid, us, innovation, divergence_time(ts, x, xhat))


def _agree(world: _World, observer: Observer, key: Any) -> Any:
    """The parts fit each other; returns their common precision."""
    plant, signal, noise, disturbance, _ = world
    if not isinstance(plant, AbstractFlowPlant) and isinstance(observer, AbstractFlowObserver):
        raise refuse(
            "simulate", "observer", f"the flow observer {type(observer).__name__} for a step plant", "a step observer",
            "Wrap it: jaxobs.observers.Sampled(observer, integrator, dt).",
        )  # fmt: skip
    if observer.p != plant.p:
        raise refuse(
            "simulate", "observer", f"p = {observer.p} outputs", f"the plant's p = {plant.p}", "Match the output maps."
        )
    if signal.m != plant.m:
        fix = "Give a signal with one component for each input."
        raise refuse("simulate", "signal", f"m = {signal.m} inputs", f"the plant's m = {plant.m}", fix)
    if key is None and (noise is not None or disturbance is not None):
        raise refuse("simulate", "key", "None", "a PRNG key", "Noise and disturbance draw from it: key=jax.random.key(0).")
    if key is not None and key_axes(key) != 0:
        given = f"{type(key).__name__} of shape {np.shape(key)}"
        raise refuse("simulate", "key", given, "one PRNG key", "Make it from the seed: key=jax.random.key(0).")
    dtype = dtype_of(observer)
    for name, part in (("plant", plant), ("signal", signal)):
        if float_leaves(part) and dtype_of(part) != dtype:  # a part without numbers takes the precision of the run
            fix = "Convert one of them with jaxobs.astype(part, dtype)."
            raise refuse("simulate", name, f"precision {dtype_of(part)}", f"the observer's {dtype}", fix)
    return dtype
