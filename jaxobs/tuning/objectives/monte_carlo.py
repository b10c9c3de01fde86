"""The RMSE of simulated runs: what the closed forms leave out (large errors, saturation, other plants) is in it."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._loop import Sample, results
from jaxobs._module import Module, Scalar, dtype_of, float_leaves, param, refuse, require_instance, require_shape
from jaxobs._motion import Motion, World
from jaxobs._simulate import check_scored
from jaxobs.integrators import AbstractIntegrator
from jaxobs.metrics import AbstractMetric
from jaxobs.noise import AbstractNoise
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant
from jaxobs.signals import AbstractSignal
from jaxobs.studies import Family
from jaxobs.tuning.objectives._forward import by_forward_mode
from jaxobs.tuning.objectives._points import check_weight, root, weight_matrix

FEW = 64  # numbers with a derivative: with more of them forward mode gives way to reverse mode over checkpoints
MEMBER, START = 2, 3  # folded into the key; 0 and 1 are the noise and the disturbance


class MonteCarlo(Module):
    """sqrt(mean of |E (xhat - x)|^2 over t >= after) of one run as `simulate` makes it: loss(observer, key).

    A key is a run: its noise and disturbance (those of simulate(..., key=key)), x(0) = x0 + spread * standard normals, and,
    where `plant` is a family (jaxobs.grid(plant, a=[...])), one of its members, each as likely. The same keys for every
    observer are common random numbers: what is left of the difference between two of them is theirs. Average over keys with
    jax.vmap.

    ts (T,) [s]; x0, xhat0, spread (n,); weight (n,) or (s, n); signal, noise, disturbance, integrator as for `simulate`. A
    run that diverges is not finite.

    Its gradient with respect to the observer is taken in forward mode, one derivative carried along the run for each number
    that has one, up to 64: no memory over time. Beyond that in reverse over sqrt(T) checkpoints. Everything in this object is a
    constant for derivatives.
    """

    plant: AbstractFlowPlant | AbstractStepPlant | Family
    ts: Float[Array, " T"] = param()
    x0: Float[Array, " n"] = param()
    xhat0: Float[Array, " n"] = param()
    noise: AbstractNoise | None = None
    disturbance: AbstractNoise | None = None
    signal: AbstractSignal | None = None
    spread: Float[Array, " n"] | None = param(default=None)
    after: Scalar = param(default=0.0)
    weight: Float[Array, "..."] | None = param(default=None)
    integrator: AbstractIntegrator | None = None

    def __check_init__(self):
        plant = self.plant.observer if isinstance(self.plant, Family) else self.plant
        fix = "Give a plant, or a family of them: jaxobs.grid(plant, a=[0.9, 1.0, 1.1])."
        require_instance(self, "plant", plant, AbstractFlowPlant | AbstractStepPlant, fix)
        for name in ("x0", "xhat0", "spread"):
            if getattr(self, name) is not None:
                require_shape(self, name, getattr(self, name), (plant.n,), "Give one number for each state.")
        check_weight(self, plant.n)

    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        """The weighted RMSE of this key's run; no key where nothing is random."""
        if key is None and (isinstance(self.plant, Family) or self.spread is not None):
            fix = "Which plant, and where it starts, is drawn: key=jax.random.key(0)."
            raise refuse(self, "key", "None", "a PRNG key", fix)
        many = sum(leaf.size for leaf in float_leaves(observer)) > FEW
        world = jax.lax.stop_gradient(eqx.filter(self, eqx.is_inexact_array))
        world = eqx.combine(world, self)
        if many:
            return world._run(observer, key)
        return by_forward_mode(_run, observer, (world, key))

    def _run(self, observer: Any, key: Any) -> Scalar:
        plant, x0 = self.plant, self.x0
        if isinstance(plant, Family):
            chosen = jax.random.randint(jax.random.fold_in(key, MEMBER), (len(plant.shape),), 0, np.asarray(plant.shape))
            plant = plant.member(*(value[i] for value, i in zip(plant.values, chosen, strict=True)))
        if self.spread is not None:
            x0 = x0 + self.spread * jax.random.normal(jax.random.fold_in(key, START), x0.shape, x0.dtype)
        world = World(plant, self.signal, self.noise, self.disturbance, self.integrator)
        metrics = {"rmse": WeightedRMSE(weight_matrix(self.weight, x0.shape[0], dtype_of(observer)), self.after)}
        checked = check_scored("MonteCarlo", world, observer, metrics, x0, self.xhat0, self.ts, key)
        return _scored(*checked, key, metrics)


def _run(observer: Any, rest: Any) -> Scalar:
    world, key = rest
    return world._run(observer, key)


@eqx.filter_jit
def _scored(world: World, observer: Any, x0: Any, xhat0: Any, grid: Any, key: Any, metrics: Any) -> Scalar:
    """The run, over blocks of sqrt(T) samples: in reverse only their first states are kept."""
    motion, ts = Motion(world, observer, False, metrics), grid.ts
    w, valid, d = motion.draw(motion.streams(key), ts)
    us = jax.vmap(world.signal)(ts)
    disturbed = jax.vmap(motion.disturb, in_axes=(0, None))(d, x0)
    drawn = Sample(jnp.arange(ts.shape[0]), ts, grid.dts, us, w, valid, disturbed)
    carry, cache = motion.start(x0, xhat0, jax.tree.map(lambda path: path[0], drawn), grid.spacing)

    def advance(carry, some):
        return jax.lax.scan(lambda carry, sample: (motion.step(cache, carry, sample)[0], None), carry, some)[0]

    length = max(1, int(np.sqrt(ts.shape[0])))
    whole = ts.shape[0] // length * length
    blocks = jax.tree.map(lambda path: path[:whole].reshape(whole // length, length, *path.shape[1:]), drawn)
    carry = jax.lax.scan(lambda carry, block: (jax.checkpoint(advance)(carry, block), None), carry, blocks)[0]
    carry = advance(carry, jax.tree.map(lambda path: path[whole:], drawn))
    return results(carry, metrics)["rmse"]


class WeightedRMSE(AbstractMetric):
    """sqrt(mean of |E (xhat - x)|^2 over t >= after), E (s, n) = weight. NaN if the run never reaches `after`."""

    weight: Float[Array, "s n"] = param()
    after: Scalar = param(default=0.0)
    dims = ()

    def init(self, n, p, dtype):
        return jnp.zeros((), dtype), jnp.zeros((), dtype)

    def update(self, state, moment):
        total, count = state
        counts = moment.t >= self.after
        size = jnp.sum((self.weight @ (moment.xhat - moment.x)) ** 2)
        return total + jnp.where(counts, size, 0), count + counts.astype(count.dtype)

    def result(self, state):
        total, count = state
        return jnp.where(count > 0, root(total / jnp.maximum(count, 1)), jnp.nan)
