"""Random numbers in arithmetic that fuses with what uses them: number i depends on the key and on i only.

A lane's path is the same however many lanes are drawn together, and no state is kept. A number takes 64 random bits.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Key, UInt

from jaxobs._vector_math import FORMATS, polynomial

ROTATIONS = (13, 15, 26, 6, 17, 29, 16, 24)
ROUNDS = 20
PARITY = 0x1BD11BDA


def threefry(key: tuple[Array, Array], counter: tuple[Array, Array]) -> tuple[Array, Array]:
    """Threefry-2x32 with 20 rounds: (key, counter) -> two random words, all uint32; jax.random's generator, written out.

    Salmon, Moraes, Dror and Shaw, Parallel random numbers: as easy as 1, 2, 3, SC 2011.
    """
    schedule = (*key, key[0] ^ key[1] ^ np.uint32(PARITY))
    a, b = counter[0] + key[0], counter[1] + key[1]
    for i in range(ROUNDS):
        turn = ROTATIONS[i % len(ROTATIONS)]
        a = a + b
        b = (b << np.uint32(turn) | b >> np.uint32(32 - turn)) ^ a
        if i % 4 == 3:
            group = i // 4 + 1
            a, b = a + schedule[group % 3], b + schedule[(group + 1) % 3] + np.uint32(group)
    return a, b


@partial(jax.jit, static_argnames="count")
def bits(key: Key[Array, ""] | UInt[Array, "2"], count: int) -> tuple[UInt[Array, " count"], UInt[Array, " count"]]:
    """(high, low) words of jax.random.bits(key, (count,), "uint64"); of another generator than Threefry, two words."""
    if str(jax.random.key_impl(key)) != "threefry2x32":
        words = jax.random.bits(key, (count, 2), jnp.uint32)
        return words[:, 0], words[:, 1]
    data, i = jax.random.key_data(key), lax.iota(jnp.uint32, count)
    return threefry((data[0], data[1]), (jnp.zeros_like(i), i))


@partial(jax.jit, static_argnames=("count", "dtype"))
def uniform(key: Key[Array, ""] | UInt[Array, "2"], count: int, dtype: Any) -> Float[Array, " count"]:
    """Uniform on [0, 1): the multiples of 2^-24 (float32), 2^-53 (float64)."""
    number = np.dtype(dtype).type
    high, low = bits(key, count)
    if np.dtype(dtype) == np.float32:
        return (high >> np.uint32(8)).astype(dtype) * number(2.0**-24)
    return high.astype(dtype) * number(2.0**-32) + (low >> np.uint32(11)).astype(dtype) * number(2.0**-53)


@partial(jax.jit, static_argnames=("count", "dtype"))
def normal(key: Key[Array, ""] | UInt[Array, "2"], count: int, dtype: Any) -> Float[Array, " count"]:
    """sqrt(-2 log u) sin(angle), u = (high + 1/2) / 2^32, angle = (low + 1/2) pi / 2^32, low signed: at most 6.77 in size.

    Box and Muller's transform; a sine over a half turn has the law of one over the whole turn, so nothing is reduced.
    """
    form, number = FORMATS[np.dtype(dtype).name], np.dtype(dtype).type
    high, low = bits(key, count)
    u = high.astype(dtype) * number(2.0**-32) + number(2.0**-33)
    angle = lax.bitcast_convert_type(low, np.int32).astype(dtype) * number(np.pi / 2**32) + number(np.pi / 2**33)
    t = angle * angle
    return jnp.sqrt(number(-2) * _log(u)) * (angle + angle * t * polynomial(t, form.sine))


class _Logarithm(NamedTuple):
    """Of one precision: the integer of its size, bits of the mantissa, bits of sqrt(1/2); the polynomial has the least greatest
    absolute error on [0, (3 - 2 sqrt(2))^2] (as in `_vector_math`)."""

    integer: type
    mantissa: int
    root: int
    series: tuple[float, ...]  # (log((1 + s) / (1 - s)) - 2 s) / s^3 in powers of s^2


LOGARITHMS = {
    "float32": _Logarithm(np.int32, 23, 0x3F3504F3, (0.666668176651001, 0.3997349143028259, 0.2996419668197632)),
    "float64": _Logarithm(
        np.int64, 52, 0x3FE6A09E667F3BCD,
        (0.666666666666681, 0.3999999999901605, 0.2857142881820985, 0.2222219166798051, 0.18183890372073847,
         0.15306348788936913, 0.14867935432989637),
    ),
}  # fmt: skip


def _log(x: Array) -> Array:
    """log(2^k m) = k log(2) + log(m) of normal x > 0, m in [sqrt(1/2), sqrt(2)), s = (m - 1) / (m + 1), as in fdlibm."""
    integer, mantissa, root, series = LOGARITHMS[x.dtype.name]
    number = x.dtype.type
    word = lax.bitcast_convert_type(x, integer)
    k = (word - integer(root)) >> integer(mantissa)
    f = lax.bitcast_convert_type(word - (k << integer(mantissa)), x.dtype) - number(1)
    s, half = f / (number(2) + f), f * f * number(0.5)
    t = s * s
    return k.astype(x.dtype) * number(np.log(2)) - ((half - s * (half + t * polynomial(t, series))) - f)
