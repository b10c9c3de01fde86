"""How a linear error answers an impulse: exponentials on a grid that is fine where time is short."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxobs import linalg
from jaxobs._module import Scalar
from jaxobs.tuning.linear_error import LinearError, balanced

HORIZON = 16.0  # time constants of the slowest pole: what remains is e^-16 of a mode
OCTAVES, LEVEL = 10, 8  # 2^LEVEL samples in each octave of time, OCTAVES of them, and as many before the first
STEPS = 12  # 2^STEPS samples of a step observer


class Settled(NamedTuple):
    """A linear error in balanced coordinates, E = the weights times its output, whether it is stable, and a horizon [s]."""

    f: Float[Array, "N N"]
    driven: Float[Array, "N k"]
    output: Float[Array, "s N"]
    direct: Float[Array, "s p"]
    start: Float[Array, "N n"]
    stable: Bool[Array, ""]
    horizon: Scalar

    def size(self, value: Scalar) -> Scalar:
        """value, infinite if the error is not stable."""
        return jnp.where(self.stable, value, jnp.inf)


def settled(error: LinearError, e: Float[Array, "s n"]) -> Settled:
    """The weighted error E (xhat - x). The horizon is a constant for derivatives: poles that meet have none."""
    one, stable = balanced(error)
    slowest = (
        -jnp.max(jnp.real(jnp.linalg.eigvals(jax.lax.stop_gradient(one.f)))) if not error.step else jnp.ones_like(one.f[0, 0])
    )
    driven = jnp.concatenate([one.noise, one.process], axis=1)
    return Settled(one.f, driven, e @ one.output, e @ one.direct, one.start, stable, HORIZON / slowest)


def response(f: Float[Array, "N N"], b: Float[Array, "N r"], horizon: Scalar) -> tuple[Array, Array]:
    """(t (K,), e^{f t} b (K, N, r)) on 0 .. horizon: uniform up to horizon / 2^OCTAVES, then octave by octave, t doubling."""
    first = horizon / 2 ** (OCTAVES + LEVEL)

    def square(power, _):
        return power @ power, power

    # powers[k] = e^{f first 2^k}
    powers = jax.lax.scan(square, linalg.expm(f * first), None, length=OCTAVES + LEVEL)[1]
    spacing = jnp.concatenate([powers[:1], powers[:OCTAVES]])
    begin = jnp.concatenate([jnp.eye(f.shape[0], dtype=f.dtype)[None], powers[LEVEL:]]) @ b
    path = jax.vmap(doubled, in_axes=(0, 0, None))(spacing, begin, LEVEL)
    step = first * jnp.concatenate([jnp.ones((1,), f.dtype), 2.0 ** jnp.arange(OCTAVES, dtype=f.dtype)])
    origin = jnp.concatenate([jnp.zeros((1,), f.dtype), 2.0 ** jnp.arange(LEVEL, LEVEL + OCTAVES, dtype=f.dtype)]) * first
    ts = origin[:, None] + step[:, None] * jnp.arange(2**LEVEL, dtype=f.dtype)
    return ts.reshape(-1), path.reshape(-1, *b.shape)


def doubled(step: Float[Array, "N N"], b: Float[Array, "N r"], doublings: int) -> Float[Array, "K N r"]:
    """(b, step b, step^2 b, ...), 2^doublings of them."""
    path = b[None]
    for _ in range(doublings):
        path = jnp.concatenate([path, step @ path])
        step = step @ step
    return path


def samples(f: Float[Array, "N N"], b: Float[Array, "N r"]) -> Float[Array, "K N r"]:
    """f^k b of a step observer, k = 0 .. 2^STEPS - 1."""
    return doubled(f, b, STEPS)
