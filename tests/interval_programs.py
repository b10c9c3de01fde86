"""Programs whose enclosures are checked: the plants, and functions that use what plants and activations use.

A program is a function of one vector and a box of lower and upper ends in which its arguments are drawn.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name

from jaxobs.plants.base import AbstractFlowPlant, AbstractPlant
from tests.cases import CASES

W1 = np.linspace(-1.2, 0.9, 12).reshape(4, 3)
W2 = np.cos(np.arange(8.0)).reshape(2, 4)
B1 = np.sin(np.arange(4.0))
TABLE = np.linspace(-2.0, 3.0, 7) ** 2


class Program(NamedTuple):
    f: Callable[[Any], Any]
    n: int
    low: float = -3.0
    high: float = 3.0


def of_plant(name: str) -> Program:
    """The flow or the step, as a function of (x, u) in one vector."""
    plant: Any = CASES[name](lambda values: jnp.asarray(values, jnp.float64))
    if isinstance(plant, AbstractFlowPlant):
        return Program(lambda z: plant.flow(jnp.asarray(0.3), z[: plant.n], z[plant.n :]), plant.n + plant.m)
    return Program(lambda z: plant.step(jnp.asarray(3), z[: plant.n], z[plant.n :]), plant.n + plant.m)


NEWTON = ("NormalChain", "NormalTriangular")  # solve for the state: no interval rule follows them
SAME = ("BlockTriangularOf", "ChainOf", "LipschitzOf", "StateAffineOf", "TriangularOf")  # the formulas of the plant inside


def plant_names() -> list[str]:
    left_out = (*NEWTON, *SAME)
    return [name for name, make in CASES.items() if name not in left_out and isinstance(make(jnp.asarray), AbstractPlant)]


def net(activation: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda z: W2 @ activation(W1 @ z + B1)


@jax.custom_vjp
def halved(x):
    return jax.lax.reduce_precision(x / 2, 8, 23)


halved.defvjp(lambda x: (halved(x), None), lambda _, g: (g / 2,))


@jax.custom_jvp
def cubed(x):
    return x * x * x


cubed.defjvp(lambda x, dx: (cubed(x[0]), 3 * x[0] ** 2 * dx[0]))


def recurrent(z):
    def step(carry, w):
        carry = jnp.tanh(w * carry + z[0])
        return carry, carry**2

    last, squares = jax.lax.scan(step, z[1:], jnp.asarray([0.3, -0.7, 1.1]), reverse=True)
    return jnp.concatenate([last, squares.ravel()])


def branches(z):
    return jax.lax.switch(jnp.where(z[0] > 0, 1, 0), [jnp.sin, lambda x: x * z[1], jnp.tanh], z)


def newton(z):
    return jax.lax.fori_loop(0, 4, lambda _, y: 0.5 * (y + z / y), jnp.ones_like(z))


def pooled(z):
    return jnp.max(jnp.reshape(W1 @ z, (2, 2)), axis=1)


def interpolated(z):
    """A table read at a place that the argument chooses."""
    place = jnp.clip(z * 2.0 + 3.0, 0.0, 5.99)
    low = jnp.floor(place).astype(int)
    table = jnp.asarray(TABLE)
    knots = jnp.asarray([-1.0, 0.0, 2.0])
    ramp = jnp.interp(z, knots, jnp.asarray([3.0, 1.0, 5.0])) + jnp.searchsorted(knots, z).astype(z.dtype)
    return ramp + table[low] * (1.0 - (place - low.astype(z.dtype))) + table[low + 1] * (place - low.astype(z.dtype))


def indexed(z):
    y = z.at[1].add(z[0] * z[2]).at[0].set(jnp.sin(z[1])).at[jnp.array([2, 2])].add(z[:2])
    y = y.at[jnp.array([2, 0])].multiply(z[:2], unique_indices=True)
    return y.at[jnp.array([0, 5])].add(z[1:], mode="drop")[jnp.array([2, 0, 0])]


def sliced(z):
    y = jax.lax.dynamic_slice(z, (jnp.asarray(1),), (2,))
    return jax.lax.dynamic_update_slice(z * z, y, (jnp.asarray(0),))[::-1]


def mixed(z):
    steps = jnp.cumsum(z) * jnp.cumprod(z)
    return jnp.pad(jnp.outer(steps, z)[:, :2], ((1, 0), (0, 1)), constant_values=0.5).T


def polynomial(z):
    return jnp.polyval(jnp.asarray([0.5, -1.25, 0.1, 3.0]), z) + z**5 - 0.3 * z[0] * z[1] ** 4


def matrices(z):
    m = jnp.stack([z, jnp.roll(z, 1), z**2])
    return jnp.einsum("ij,kj->ik", m, m).ravel() @ jnp.ones((9, 2))


def angles(z):
    r = jnp.sqrt(z[0] ** 2 + z[1] ** 2 + 1.0)
    return jnp.stack(
        [jnp.arctan2(z[0], 2.0 + z[1] ** 2), jnp.arcsin(z[2] / (jnp.abs(z[2]) + 1.5)), jnp.arccos(z[1] / (r + 1.0)), r]
    )


def trigonometric(z):
    return jnp.stack([jnp.tan(z[0] / 4), jnp.arctan(z[1]), jnp.sinc(z[2] + 9.0), jnp.cos(z[0] * 5.0) * jnp.sin(z[1]) ** 3])


def gaussian(z):
    return jnp.stack(
        [jax.scipy.special.erf(z[0]), jax.scipy.special.erfc(z[1]), jax.scipy.stats.norm.pdf(z[2]), jnp.exp2(z[0])]
    )


def hyperbolic(z):
    return jnp.stack(
        [jnp.sinh(z[0]), jnp.cosh(z[1]), jnp.arcsinh(z[2]), jnp.arccosh(1.5 + z[0] ** 2), jnp.arctanh(jnp.tanh(z[1]) / 2)]
    )


def positive(z):
    return jnp.stack(
        [jnp.log(z[0]), jnp.log1p(z[1]), z[2] ** 1.5, z[0] ** z[1], jnp.cbrt(z[2]), jax.lax.rsqrt(z[0]), z[1] ** -0.4]
    )


def dead_zone(z):
    return jnp.where(jnp.abs(z) > 1.0, z - jnp.sign(z), 0.0) + jnp.minimum(z, z[0])


def logic(z):
    far = ((z > 1.0) | (z < -1.0)) & ~(z <= -2.0)
    odd = jnp.where(jnp.any(far) ^ jnp.all(z < 2.0), 1.0, -1.0)
    return jnp.where(far, z, z * odd) + far.astype(z.dtype)


def bits(z):
    n = jnp.arange(3)
    m = ((n << 2) | (n >> 1)) ^ (~n & 5) | jax.lax.shift_right_logical(-n, jnp.full_like(n, 60))
    return z * m.astype(z.dtype) + (n * 7 // 2 + n % 2 - (-n) ** 3).astype(z.dtype) * z[0]


def extremes(z):
    y = jnp.outer(jnp.asarray([1.0, -0.5]), z)
    runs = jax.lax.cummax(y, axis=1) * jax.lax.cummin(y, axis=1, reverse=True)
    return jnp.concatenate([jnp.min(y, axis=0), jnp.prod(runs, axis=1), jnp.tile(z, 2)])


def chosen(z):
    return jnp.stack([z[jnp.argmax(z)], jnp.sin(z)[jnp.argmin(z**2)]])


def written(z):
    at = jnp.asarray([0, 2])
    return z.at[at].min(z[1:]).at[1].subtract(z[0] * z[1]).at[at].max(-z[:2])


def looped(z):
    """As many turns as an argument that is known says."""
    turns = jnp.sum(jnp.asarray([1, 2]))
    return jax.lax.while_loop(lambda c: c[0] < turns, lambda c: (c[0] + 1, jnp.sin(c[1]) + z), (jnp.zeros_like(turns), z))[1]


def quantile(z):
    return jax.scipy.special.erfinv(jnp.tanh(z) / 2) + jax.lax.optimization_barrier(jnp.stack(jnp.unstack(z)[::-1]))


# Without a batch axis a branch stays a branch, and a slice a slice.
ALONE: dict[str, Program] = {
    "branches": Program(branches, 3),
    "sliced": Program(sliced, 3),
    "looped": Program(looped, 3),
    "halved": Program(halved, 3),
    "reached": Program(lambda z: jax.lax.dynamic_slice(z**2, (jnp.floor(z[0]).astype(int),), (2,)), 3),
}

FURTHER: dict[str, Program] = {
    "relu net": Program(net(jax.nn.relu), 3),
    "leaky relu net": Program(net(jax.nn.leaky_relu), 3),
    "gelu net": Program(net(jax.nn.gelu), 3),
    "exact gelu net": Program(net(functools.partial(jax.nn.gelu, approximate=False)), 3),
    "elu net": Program(net(jax.nn.elu), 3),
    "selu net": Program(net(jax.nn.selu), 3),
    "silu net": Program(net(jax.nn.silu), 3),
    "softplus net": Program(net(jax.nn.softplus), 3),
    "tanh net": Program(net(jnp.tanh), 3),
    "sigmoid net": Program(net(jax.nn.sigmoid), 3),
    "hard tanh net": Program(net(jax.nn.hard_tanh), 3),
    "softsign net": Program(net(jax.nn.soft_sign), 3),
    "softmax net": Program(net(jax.nn.softmax), 3),
    "mish net": Program(net(jax.nn.mish), 3),
    "logsumexp": Program(lambda z: jax.nn.logsumexp(W1 @ z), 3),
    "recurrent": Program(recurrent, 3),
    "branches": Program(branches, 3),
    "newton": Program(newton, 2, 0.5, 4.0),
    "max pool": Program(pooled, 3),
    "table": Program(interpolated, 2, -1.4, 1.4),
    "indexed": Program(indexed, 3),
    "sliced": Program(sliced, 3),
    "mixed": Program(mixed, 3),
    "polynomial": Program(polynomial, 3),
    "rational": Program(lambda z: (z[0] ** 3 - z[1]) / (1.0 + z[0] ** 2 + z[1] ** 2) + 1.0 / (4.0 + z), 3),
    "matrices": Program(matrices, 3),
    "angles": Program(angles, 3),
    "trigonometric": Program(trigonometric, 3),
    "gaussian": Program(gaussian, 3),
    "hyperbolic": Program(hyperbolic, 3),
    "positive": Program(positive, 3, 0.05, 4.0),
    "dead zone": Program(dead_zone, 3),
    "sorted": Program(lambda z: jnp.sort(W1 @ z)[1:] * jnp.clip(z, -0.5, z[0] ** 2), 3),
    "checkpoint": Program(jax.checkpoint(lambda z: checkpoint_name(jnp.sin(cubed(z)), "gain") * z), 3),
    "logic": Program(logic, 3),
    "bits": Program(bits, 3),
    "extremes": Program(extremes, 3),
    "chosen": Program(chosen, 3),
    "written": Program(written, 3),
    "looped": Program(looped, 3),
    "quantile": Program(quantile, 3),
    "remainder": Program(lambda z: jnp.mod(z, 1.75) + jnp.fmod(z[0], z[1] ** 2 + 0.5) + jnp.round(z[2]) + jnp.ceil(z), 3),
}
