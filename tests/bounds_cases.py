"""Certificates with travelling bounds, of five plants."""

import functools

import jax.numpy as jnp
import numpy as np
from lpv_cases import arrays

from jaxobs import plants
from jaxobs.certificates.bounds import with_bounds
from jaxobs.designs import Channels, corner_lmi, lpv_model, midpoint_channels, slope_entries
from jaxobs.designs.polytope import Polytope

INF = np.inf
PENDULUM, JOINT, DUFFING, LORENZ, SINES = (
    plants.Pendulum(), plants.FlexibleJoint(), plants.Duffing(), plants.Lorenz(), plants.SineChain(n=3)
)  # fmt: skip
LOW, HIGH = np.array([-30.0, -30.0, -2.0]), np.array([30.0, 30.0, 58.0])


def field(plant):
    """x' of a plant without inputs, or with them."""
    zero = np.zeros(())
    if plant.m:
        return lambda x, u: plant.flow(zero, x, u)
    return lambda x: plant.flow(zero, x, jnp.zeros((0,), x.dtype))


def one_channel(a, b, c, lower, upper, output):
    return arrays(Polytope, a, np.reshape(b, (-1, 1)), np.reshape(c, (1, -1)), [lower], [upper], output)


def models():
    """name: (plant, polytope, rate, box of x and u)."""
    chain, first = np.eye(2, k=1), [[1.0, 0.0]]
    angle = 0.4
    joint = arrays(Channels, np.eye(2), [[-1, 0, 1, 0], [0, 0, 1, 0]], [0, -1], [3 * (2 * angle) ** 2 * (1 + 1e-12), 1])
    wide = [INF, INF]
    return {
        "pendulum": (PENDULUM, one_channel(chain, [0, 1], [1, 0], -1.5, 1.5, first), 1.0, [*wide, 0.5]),
        "pendulum, tighter": (PENDULUM, one_channel(chain, [0, 1], [1, 0], -1.2, 1.2, first), 1.0, [4.0, INF, 0.5]),
        "flexible joint": (JOINT, lpv_model(JOINT, joint), 0.5, [angle, INF, angle, INF, INF]),
        "Duffing": (DUFFING, one_channel([[0, 1], [-1, 0]], [0, -3], [1, 0], 0, 4, [[1.0, 1.0]]), 0.1, [2.0, INF]),
        "Lorenz": (LORENZ, lpv_model(LORENZ, midpoint_channels(LORENZ, LOW, HIGH)), 0.05, (LOW, HIGH)),
        "sine chain": (SINES, lpv_model(SINES, slope_entries(np.full((1, 3), -1 / 3), np.full((1, 3), 1 / 3))), 0.1, [INF] * 3),
    }


@functools.cache
def travelling():
    """name: the certificate with its bounds."""
    found = {}
    for name, (plant, model, rate, box) in models().items():
        _, certificate = corner_lmi.synthesise(model, rate=rate)
        low, high = box if isinstance(box, tuple) else (-np.array(box), np.array(box))
        found[name] = with_bounds(certificate, field(plant), low, high)
    return found
