"""Sine, cosine and tangent as polynomials that a compiler vectorises: on CPUs XLA calls scalar functions instead.

float32 and float64 have their own constants; other dtypes go to jax.numpy.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float


class _Format(NamedTuple):
    """Constants of one precision. The polynomials have the least greatest absolute error for |r| <= pi/2 (Remez exchange,
    coefficients rounded one after another, the lowest first); the last one of the sine is lowered: no value then exceeds 1."""

    word: type
    rounding: float  # 1.5 2^(bits of the mantissa): added, it rounds to an integer and leaves that in the low bits
    pi: tuple[float, float, float]  # the first two short, so that their products with n are exact
    limit: float  # numbers beyond lie 1 or more apart
    sine: tuple[float, ...]  # (sin(r) - r) / r^3 in powers of r^2
    cosine: tuple[float, ...]  # (cos(r) - 1 + r^2 / 2) / r^4


FORMATS = {
    "float32": _Format(
        word=np.uint32,
        rounding=1.5 * 2.0**23,
        pi=(3.140625, 0.0009670257568359375, 6.278329465203569e-07),  # 9 bits, 9 bits, 24 bits
        limit=2.0**23,
        sine=(-0.16666656732559204, 0.00833300780504942, -0.00019805904594250023, 2.5982461e-06),
        cosine=(0.041666656732559204, -0.0013888583052903414, 2.4769920855760574e-05, -2.620211034809472e-07),
    ),
    "float64": _Format(
        word=np.uint64,
        rounding=1.5 * 2.0**52,
        pi=(3.1415927410125732, -8.742277657347586e-08, -3.4302489988857658e-15),  # 24 bits, 24 bits, 53 bits
        limit=2.0**52,
        sine=(-0.16666666666666666, 0.008333333333333196, -0.00019841269841207673, 2.7557319210711175e-06,
              -2.5052106827320888e-08, 1.6058937287201818e-10, -7.642927585889144e-13, 2.720495537518756e-15),
        cosine=(0.04166666666666583, -0.0013888888888829974, 2.480158728576692e-05, -2.7557317066646213e-07,
                2.0876592485326655e-09, -1.1463632338285345e-11, 4.616099477886414e-14),
    ),
}  # fmt: skip


def _reduced(x: Array, form: _Format) -> tuple[Array, Array]:
    """(r, sign): x = n pi + r with |r| <= pi/2, and (-1)^n as a sign bit."""
    number = x.dtype.type
    x = jnp.where(jnp.abs(x) < number(form.limit), x, x - x)  # 0, or NaN
    shifted = x * number(1 / np.pi) + number(form.rounding)
    minus_n = number(form.rounding) - shifted  # in this order: XLA cancels the constants of (a + c) - c
    r = x
    for part in form.pi:
        r = r + minus_n * number(part)
    last = 8 * x.dtype.itemsize - 1
    return r, lax.bitcast_convert_type(shifted, form.word) << form.word(last)


def _signed(x: Array, sign: Array) -> Array:
    return lax.bitcast_convert_type(lax.bitcast_convert_type(x, sign.dtype) ^ sign, x.dtype)


def polynomial(t: Array, coefficients: tuple[float, ...]) -> Array:
    """c[0] + c[1] t + c[2] t^2 + ... by Horner's rule."""
    total = t * t.dtype.type(coefficients[-1]) + t.dtype.type(coefficients[-2])
    for c in coefficients[-3::-1]:
        total = total * t + t.dtype.type(c)
    return total


@jax.custom_jvp
def sin(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """sin(n pi + r) = (-1)^n (r + r^3 S(r^2)).

    Within 2 ulp for |x| <= 1, and where |value| >= 1/2 for |x| <= 1e5 (float32), 1e9 (float64); smaller values there have an
    error of at most 1 ulp of 1. Beyond, the value at a number within 4 ulp of x: 0 from 2^23 and 2^52 on.
    """
    form = FORMATS.get(x.dtype.name)
    if form is None:
        return jnp.sin(x)
    r, sign = _reduced(x, form)
    t = r * r
    return _signed(r + r * t * polynomial(t, form.sine), sign)


@jax.custom_jvp
def cos(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """cos(n pi + r) = (-1)^n (1 - r^2 / 2 + r^4 C(r^2)), as exact as `sin`; 1 from 2^23 and 2^52 on."""
    form = FORMATS.get(x.dtype.name)
    if form is None:
        return jnp.cos(x)
    r, sign = _reduced(x, form)
    t = r * r
    number = x.dtype.type
    return _signed((number(1) - t * number(0.5)) + t * t * polynomial(t, form.cosine), sign)


@sin.defjvp
def _(primals, tangents):
    (x,), (dx,) = primals, tangents
    return sin(x), cos(x) * dx


@cos.defjvp
def _(primals, tangents):
    (x,), (dx,) = primals, tangents
    return cos(x), -sin(x) * dx


@jax.custom_jvp
def tan(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """sin(x) / cos(x): next to a pole, the tangent of a number near x."""
    return sin(x) / cos(x) if x.dtype.name in FORMATS else jnp.tan(x)


@tan.defjvp
def _(primals, tangents):
    (x,), (dx,) = primals, tangents
    value = tan(x)
    return value, (x.dtype.type(1) + value * value) * dx


VECTOR = {"sin": sin, "cos": cos, "tan": tan}  # by the name of the primitive that they stand for
