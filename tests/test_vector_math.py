"""Sine, cosine and tangent against ball arithmetic of 200 bits."""

import flint
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import _vector_math as vm

EXACT_RANGE = {"float32": 1e5, "float64": 1e9}
DTYPES = [np.float32, np.float64]
NAMES = ["sin", "cos"]


def exact(name, x):
    """As double + double, from arb: the second number is the rest, so differences keep more bits than a double has."""
    flint.ctx.prec = 200
    balls = [getattr(flint.arb(float(v)), name)() for v in x]
    high = np.array([float(b.mid()) for b in balls])
    return high, np.array([float((b - flint.arb(h)).mid()) for b, h in zip(balls, high, strict=True)])


def points(dtype):
    """Random arguments of every size in range, both signs; multiples of pi/2 and their neighbours; small numbers."""
    rng, top = np.random.default_rng(0), EXACT_RANGE[np.dtype(dtype).name]
    turns = np.unique(np.round(np.geomspace(1, top / 1.6, 400))) * (np.pi / 2)
    near = np.array([turns, np.nextafter(turns.astype(dtype), dtype(0)), np.nextafter(turns.astype(dtype), dtype(np.inf))])
    spread = np.concatenate([rng.uniform(0, size, 1500) for size in (0.8, 1.6, 10, 1000, top)])
    small = np.geomspace(float(np.finfo(dtype).tiny), 1, 300)
    x = np.concatenate([near.ravel(), spread, small, np.exp(rng.uniform(np.log(1e-8), np.log(top), 1500))]).astype(dtype)
    return np.concatenate([x, -x])


def ways(name):
    """Compiled, products are fused with sums where the machine can; op by op, they are not."""
    function = getattr(vm, name)
    return {"compiled": jax.jit(function), "op by op": function}


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("way", ["compiled", "op by op"])
def test_accuracy(name, dtype, way):
    """2 ulp where |value| >= 1/2, below that 1 ulp of 1/2 and more; near its zero at 0 the sine keeps 2 ulp."""
    x = points(dtype)
    high, low = exact(name, x)
    value = ways(name)[way](jnp.asarray(x))
    assert value.dtype == dtype
    error = np.abs((np.asarray(value, np.float64) - high) - low)
    eps = np.finfo(dtype).eps
    assert np.all(error <= eps)
    assert np.all(np.abs(np.asarray(value)) <= 1)
    big = np.abs(high) >= 0.5
    if name == "sin":
        big |= np.abs(x) <= 1
    assert np.all(error[big] <= 2 * np.spacing(np.abs(high[big]).astype(dtype)))


@pytest.mark.parametrize("dtype", DTYPES)
def test_every_size_is_the_value_at_a_number_near_by(dtype):
    """Of |x| beyond the range of full accuracy: both functions at one angle, no further off than 4 spacings of x."""
    rng = np.random.default_rng(1)
    low, top = np.log(EXACT_RANGE[np.dtype(dtype).name]), np.log(float(np.finfo(dtype).max)) - 1
    edge = vm.FORMATS[np.dtype(dtype).name].limit
    x = np.exp(np.concatenate([rng.uniform(low, np.log(edge), 3000), rng.uniform(low, top, 500)]))
    x = np.concatenate([x, [edge, float(np.nextafter(dtype(edge), dtype(0)))]]).astype(dtype)
    x = np.concatenate([x, -x])
    s, c = (np.asarray(jax.jit(getattr(vm, name))(x), np.float64) for name in NAMES)
    assert np.all(np.abs(s) <= 1)
    assert np.all(np.abs(c) <= 1)
    exact_s, exact_c = exact("sin", x)[0], exact("cos", x)[0]
    off = np.abs(np.arctan2(s * exact_c - c * exact_s, c * exact_c + s * exact_s))
    assert np.all(off <= 4 * np.spacing(np.abs(x)))
    assert np.max(np.abs(s * s + c * c - 1)) < 1e-3


def test_sine_never_exceeds_one():
    """Every float32 next to pi/2 and next to zero, where rounding could."""
    for name, start, stop in (("sin", 1.5, 1.6), ("cos", 0.0, 2e-3)):
        first, last = (np.float32(v).view(np.int32) for v in (start, stop))
        x = np.arange(first, last, 1 if name == "sin" else 1001, dtype=np.int32).view(np.float32)
        assert float(jnp.max(jnp.abs(jax.jit(getattr(vm, name))(x)))) <= 1


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", NAMES)
def test_special_arguments(name, dtype):
    x = jnp.asarray([np.inf, -np.inf, np.nan, 0.0, -0.0, np.finfo(dtype).max, -np.finfo(dtype).max], dtype)
    value = np.asarray(getattr(vm, name)(x))
    assert np.all(np.isnan(value[:3]))
    assert np.all(value[3:] == (0 if name == "sin" else 1))
    small = jnp.asarray([np.finfo(dtype).tiny / 8, -np.finfo(dtype).tiny / 8], dtype)  # XLA may count them as zero
    value = np.asarray(jax.jit(getattr(vm, name))(small))
    assert np.all(np.abs(value - (np.asarray(small) if name == "sin" else 1)) <= np.finfo(dtype).tiny)


@pytest.mark.parametrize("dtype", DTYPES)
def test_tangent_at_a_number_near_by(dtype):
    """The angle of the value is that of x to 2 ulp of 1 and of x."""
    x = points(dtype)
    value = np.asarray(jax.jit(vm.tan)(x), np.float64)
    s, c = exact("sin", x)[0], exact("cos", x)[0]
    off = np.abs(value * c - s) / np.sqrt(1 + value * value)
    assert np.all(off <= 2 * np.finfo(dtype).eps)
    small = np.abs(x) <= 0.7
    assert np.all(np.abs(value - s / c)[small] <= 4 * np.spacing(np.abs(x[small])))
    assert np.all(np.isnan(vm.tan(jnp.asarray([np.inf, np.nan], dtype))))


@pytest.mark.parametrize("name", [*NAMES, "tan"])
def test_derivatives(name):
    function, known = getattr(vm, name), getattr(jnp, name)
    x = jnp.linspace(-7.0, 7.0, 29) if name != "tan" else jnp.linspace(-1.2, 1.2, 9)

    def derivatives(f):
        return jax.grad(f), jax.hessian(f), jax.jacfwd(f), jax.grad(jax.jacfwd(jax.grad(f)))

    def at(f):
        return [jax.vmap(one)(x) for one in derivatives(f)]

    for ours, theirs in zip(jax.jit(lambda: at(function))(), jax.jit(lambda: at(known))(), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("dtype", DTYPES)
def test_transformations_give_the_same_bits(dtype):
    x = jnp.asarray(np.random.default_rng(2).uniform(-50, 50, (16, 64)), dtype)
    for function in vm.VECTOR.values():
        whole = jax.jit(function)(x)
        np.testing.assert_array_equal(jax.jit(jax.vmap(function))(x), whole)
        np.testing.assert_array_equal(jax.jit(jax.vmap(jax.vmap(function)))(x), whole)


def test_other_dtypes_go_to_jax():
    x = jnp.asarray([0.5, -2.0], jnp.bfloat16)
    assert vm.sin(x).dtype == jnp.bfloat16
    np.testing.assert_array_equal(vm.cos(x), jnp.cos(x))


@pytest.mark.parametrize("dtype", DTYPES)
def test_compiled_to_no_call_and_one_reduction(dtype):
    """Sine and cosine of one argument share the reduction."""
    text = jax.jit(lambda x: vm.sin(x) * vm.cos(x)).lower(jnp.ones(64, dtype)).compile().as_text()
    bits = np.dtype(dtype).itemsize * 8
    assert text.count("shift-left(") == 1
    assert " sine(" not in text
    assert " cosine(" not in text
    assert f"u{bits}[64]" in text
