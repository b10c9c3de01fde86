"""Paper 001 and what its rows share."""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs.certificates import exact
from jaxobs.integrators import RK4, Field
from jaxobs.linalg import tracker_structure
from jaxobs.observers import DiscreteTracker, Tracker
from jaxobs.papers.claims import Paper

PAPER = Paper("001", "Ibrir, Robust nonpeaking algebraic observers")

SIZES = (
    (1, 0),
    (2, 0),
    (3, 0),
    (5, 0),
    (1, 1),
    (2, 1),
    (3, 1),
    (3, 2),
    (4, 3),
)  # the (n, q) at which identities are recomputed


def structure(n: int, q: int) -> tuple[exact.Matrix, exact.Matrix, exact.Matrix]:
    """(A~, B~_xi, C~) as the paper writes them below (4), exact; B~_xi is zero for q = 0."""
    size = n + q
    a = [[Fraction(int(j == i + 1)) for j in range(size)] for i in range(size)]
    if q:
        a[q - 1][q] = Fraction(-1)
    b = [[Fraction(int(q > 0 and i == q - 1))] for i in range(size)]
    return a, b, [[Fraction(int(j == 0)) for j in range(size)]]


def nilpotent_exponential(a: exact.Matrix, dt: Fraction) -> exact.Matrix:
    """e^{A dt} of a nilpotent A, exact."""
    total, term = exact.identity(len(a)), exact.identity(len(a))
    for k in range(1, len(a)):
        term = exact.scale(dt / k, exact.product(term, a))
        total = exact.add(total, term)
    return total


def steady(n: int, q: int, mu: Fraction) -> exact.Matrix:
    """H_inf exactly: (-1)^{i+j} s_i s_j C(i+j-2, i-1) / mu^{i+j-1}, s = +1 on xi and -1 on xhat if q > 0."""

    sign = [1 if i < q or q == 0 else -1 for i in range(n + q)]
    return [
        [Fraction((-1) ** (i + j) * sign[i] * sign[j] * math.comb(i + j, i)) / mu ** (i + j + 1) for j in range(n + q)]
        for i in range(n + q)
    ]


def largest(x: exact.Matrix) -> float:
    """The largest absolute entry."""
    return float(max(abs(entry) for row in x for entry in row))


def tracker(n: int, q: int, mu: float, start: Any = 1.0) -> Tracker:
    return Tracker(n, q, jnp.asarray(mu), jnp.asarray(start))


def discrete_tracker(n: int, q: int, mu: float, dt: float, start: float) -> DiscreteTracker:
    return DiscreteTracker(n, q, jnp.asarray(mu), jnp.asarray(dt), jnp.asarray(start))


@eqx.filter_jit
def right_side(tracker: Tracker, eta: Any, elapsed: float, y: Any) -> Array:
    """eta' of a tracker that sees y, `elapsed` seconds after its start."""
    return tracker.flow(jnp.zeros(()), (jnp.asarray(eta), jnp.asarray(elapsed)), jnp.zeros((0,)), jnp.asarray([y]))[0]


def gain(tracker: Tracker | DiscreteTracker, elapsed: float) -> Float[np.ndarray, " N"]:
    """K = H^-1 C' after `elapsed` seconds, or delta H_k^-1 C' at sample `elapsed`, in the coordinates of eta."""
    return tracker_structure(tracker.n, tracker.q)[1] * np.asarray(_plain_gain(tracker, jnp.asarray(elapsed)))


_plain_gain = eqx.filter_jit(lambda tracker, elapsed: tracker.gain(elapsed))


def path(tracker: Tracker, y: Callable[[Any], Any], ts: Float[np.ndarray, " T"], eta0: Any) -> Float[Array, "T N"]:
    """eta = (xi, xhat) of a tracker that sees y(t) on an even grid, RK4 with one step a sample."""
    dt = jnp.asarray(ts[1] - ts[0])
    rk4 = RK4()

    def step(z, t):
        field = Field(lambda t, z: tracker.flow(t, z, jnp.zeros((0,)), y(t)[None]))
        return rk4.step(field, rk4.prepare(field, dt, z), t, dt, z), z[0]

    start = (jnp.asarray(eta0, float), jnp.zeros(()))
    return jax.jit(lambda: jax.lax.scan(step, start, jnp.asarray(ts))[1])()
