"""What moves in a run: plant and observer from one sample to the next. `simulate`, `score` and `study` share it."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxobs._loop import Sample, begin, tick
from jaxobs._module import Scalar
from jaxobs.integrators import Field
from jaxobs.metrics import AbstractMetric
from jaxobs.noise import AbstractNoise, Silent, drawn
from jaxobs.observers import AbstractFlowObserver
from jaxobs.plants import AbstractFlowPlant


class World(NamedTuple):
    """Everything that is not the observer."""

    plant: Any
    signal: Any
    noise: AbstractNoise | None
    disturbance: AbstractNoise | None
    integrator: Any


class Motion(NamedTuple):
    """A run as two functions: carry, cache = start(...), then carry, out = step(cache, carry, sample) at every sample.

    `cache` is what an integrator makes once, before the loop; `_loop.results` makes the metrics' values of the last carry.
    """

    world: World
    observer: Any
    hold_innovation: bool
    metrics: Mapping[str, AbstractMetric] | None

    def start(self, x0: Float[Array, " n"], xhat0: Float[Array, " n"], first: Sample, spacing: Scalar) -> tuple[Any, Any]:
        """`first` is the first sample: only its shapes and its time matter."""
        z0, cache = self.observer.init(xhat0), None
        if isinstance(self.observer, AbstractFlowObserver):
            cache = self.world.integrator.prepare(self._joint_field(first, jnp.zeros_like(first.y)), spacing, (x0, z0))
        elif isinstance(self.world.plant, AbstractFlowPlant):
            cache = self.world.integrator.prepare(self._plant_field(first), spacing, x0)
        return begin(self.observer, x0, z0, first.y.dtype, self.metrics), cache

    def step(self, cache: Any, carry: Any, sample: Sample) -> tuple[Any, Any]:
        """From one sample to the next; the output is (x, xhat, y, innovation), with metrics (x, xhat)."""
        plant, integrator = self.world.plant, self.world.integrator

        def measure(x, sample):
            return plant.h(x, sample.u) + sample.y

        def advance(x, z, sample, y, held):
            if isinstance(self.observer, AbstractFlowObserver):
                return integrator.step(self._joint_field(sample, held), cache, sample.t, sample.dt, (x, z))
            z = self.observer.step(sample.k, z, sample.u, y)
            if not isinstance(plant, AbstractFlowPlant):
                return plant.step(sample.k, x, sample.u) + sample.d, z
            return integrator.step(self._plant_field(sample), cache, sample.t, sample.dt, x), z

        return tick(self.observer, carry, sample, measure, advance, self.hold_innovation, self.metrics)

    def sample(self, x: Float[Array, " n"], time: tuple[Any, Scalar, Scalar], drawn: "Drawn") -> Sample:
        """What is given at one sample: time is (k, t_k, the step to the next sample), drawn that of this sample alone."""
        k, t, dt = time
        return Sample(k, t, dt, self.world.signal(t), drawn.w, drawn.valid, self.disturb(drawn.d, x))

    def streams(self, key: Any) -> tuple[Any, Any]:
        """The keys of noise and disturbance."""
        noise_key, disturbance_key = jax.random.split(jax.random.key(0) if key is None else key)
        return noise_key, disturbance_key

    def draw(self, keys: tuple[Any, Any], ts: Float[Array, " T"], block: Any = None) -> "Drawn":
        """Noise and disturbance on all of ts, or with `block` those of the samples ts of this block alone."""
        plant, dtype = self.world.plant, ts.dtype
        w, valid = drawn(self.world.noise or Silent(), keys[0], ts, plant.p, block)
        d = jnp.zeros((ts.shape[0], 0), dtype)
        if self.world.disturbance is not None:
            width = jax.eval_shape(plant.disturbance_matrix).shape[1]
            d = drawn(self.world.disturbance, keys[1], ts, width, block)[0].astype(dtype)
        return Drawn(w.astype(dtype), valid, d)

    def disturb(self, d: Float[Array, " w"], like: Float[Array, " n"]) -> Float[Array, " n"]:
        """E d, zero without a disturbance."""
        return self.world.plant.disturbance_matrix().astype(like.dtype) @ d if d.shape[-1] else jnp.zeros_like(like)

    def _plant_field(self, sample: Sample) -> Field:
        plant, signal = self.world.plant, self.world.signal

        def split(t, x):
            a, b = plant.split(t, x, signal(t))
            return a, b + sample.d

        return Field(lambda t, x: plant.flow(t, x, signal(t)) + sample.d, split if hasattr(plant, "split") else None)

    def _joint_field(self, sample: Sample, held: Float[Array, " p"]) -> Field:
        (plant, signal, *_), observer = self.world, self.observer

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


class Drawn(NamedTuple):
    """Random paths on the grid: measurement noise, which samples are there, the disturbance before E."""

    w: Float[Array, "T p"]
    valid: Bool[Array, "T p"]
    d: Float[Array, "T w"]
