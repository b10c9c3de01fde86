"""Exact formulas of functions and of their Jacobians, from their jaxprs."""

import math
from fractions import Fraction

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from jaxobs import plants
from jaxobs.intervals import UnknownPrimitiveError, graph
from jaxobs.intervals.formulas import FUNCTIONS, ZERO, Expression, Graph, combine, constant

FLOATS = {
    "+": lambda c, parts: float(c) + sum(float(k) * v for k, v in parts),
    "*": lambda a, b: a * b,
    "^": lambda a, n: a**n,
    "min": min,
    "<=": lambda e, yes, no: yes if e <= 0 else no,
    **{name: getattr(math, name) for name in FUNCTIONS},
}
EXACT = {"+": lambda c, parts: c + sum(k * v for k, v in parts), "*": lambda a, b: a * b, "^": lambda a, n: a**n}


def values(formulas, point):
    entries = list(formulas.outputs.flat)
    return np.reshape(formulas.graph.evaluate(entries, point, FLOATS), formulas.outputs.shape)


PLANTS = [
    plants.Pendulum(), plants.FlexibleJoint(), plants.SineChain(n=4), plants.Lorenz(), plants.Duffing(), plants.VanDerPol(),
    plants.Rossler(), plants.FieldMotor(), plants.Hovercraft(), plants.SwingingLeg(a=1.0, b=0.2, c=0.3, rest=0.1),
    plants.Saturated(plants.Lorenz(), [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]),
]  # fmt: skip


def field(plant):
    zero = np.zeros(())
    return (lambda x, u: plant.flow(zero, x, u)) if plant.m else lambda x: plant.flow(zero, x, jnp.zeros((0,), x.dtype))


@pytest.mark.parametrize("plant", PLANTS, ids=lambda plant: type(plant).__name__)
def test_values_and_jacobian_of_a_plant_are_those_of_jax(plant):
    f, draw = field(plant), np.random.default_rng(1)
    of_values, of_slopes = graph.trace(f, plant.n, plant.m), graph.jacobian(f, plant.n, plant.m)
    exact = jax.jit(lambda *args: (f(*args), jax.jacfwd(f)(*args)))
    for _ in range(5):
        x, u = draw.normal(size=plant.n), draw.normal(size=plant.m)
        y, slopes = exact(*((x, u) if plant.m else (x,)))
        np.testing.assert_allclose(values(of_values, [*x, *u]), y, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(values(of_slopes, [*x, *u]), slopes, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("plant", PLANTS[:6], ids=lambda plant: type(plant).__name__)
def test_own_derivatives_are_the_formulas_of_jacfwd(plant):
    f = field(plant)
    own, of_jax = graph.jacobian(f, plant.n, plant.m), graph.trace(jax.jacfwd(f), plant.n, plant.m)
    texts = [[formulas.graph.text(e) for e in formulas.outputs.flat] for formulas in (own, of_jax)]
    assert texts[0] == texts[1]


def test_structure_is_seen():
    jacobian = graph.jacobian(field(PLANTS[1]), 4, 1).outputs
    zero = [[True, False, True, True], [False, False, False, True], [True, True, True, False], [False, True, False, True]]
    assert [[e.is_zero for e in row] for row in jacobian] == zero
    cores = [jacobian[i, j].split() for i, j in ((1, 0), (1, 2), (3, 0))]
    assert cores[0][2] == cores[1][2] == cores[2][2]
    assert cores[0][1] == -cores[1][1]
    joint = PLANTS[1]
    stiff = [Fraction(float(joint.hardening / inertia)) for inertia in (joint.motor_inertia, joint.link_inertia)]
    assert cores[0][1] == -3 * stiff[0]
    assert cores[2][1] == 3 * stiff[1]
    assert jacobian[0, 1] == constant(1)
    assert all(e.split()[2] == ZERO for e in jacobian[0])


def test_constants_are_exact_and_those_of_the_model_are_its_floats():
    (e,) = graph.trace(lambda x: 0.1 * x + 0.2 * x + 0.0 * x + 1.0 * x, 1).outputs
    assert e.terms == ((0, Fraction(0.1) + Fraction(0.2) + 1),)
    (e,) = graph.trace(lambda x: (jnp.asarray(0.1) + jnp.asarray(0.2)) * x, 1).outputs
    assert e.terms == ((0, Fraction(0.1 + 0.2)),)  # rounded, as JAX computes the coefficient
    (e,) = graph.trace(lambda x: x / 3.0, 1).outputs
    assert e.terms == ((0, Fraction(1, 3)),)
    x, y = (Expression(Fraction(0), ((k, Fraction(1)),)) for k in (0, 1))
    found = graph.trace(lambda x: jnp.stack([x[0] + x[1] - x[1], x[0] - x[0], x[0] * (x[1] + x[0]) - x[0] * (x[0] + x[1])]), 2)
    assert list(found.outputs) == [x, ZERO, ZERO]
    assert graph.trace(lambda x: x[1], 2).outputs[()] == y


def two(f):
    """f of two numbers as a function of x (2,)."""
    return lambda x: f(x[0], x[1])


def stepped(x):
    def turn(carry, a):
        return carry * a + x[0], carry

    last, seen = jax.lax.scan(turn, x[1], jnp.array([1.0, 2.0, 3.0], x.dtype))
    return jnp.append(seen, last)


PROGRAMS = {
    "arithmetic": two(lambda x, y: (x + 2) * (y - x) / (1 + y * y) - x**3 * y),
    "elementary": two(lambda x, y: jnp.sin(x) * jnp.cos(y) + jnp.tanh(x) - jnp.exp(y) + jnp.log(2 + x * x) + jnp.arctan(x * y)),
    "more elementary": two(lambda x, y: jnp.tan(x / 4) + jnp.sinh(y) * jnp.cosh(x) + jnp.log1p(x * x) + jnp.expm1(y)),
    "error functions": two(lambda x, y: jax.lax.erf(x) + jax.lax.erfc(y) + jax.nn.gelu(x, approximate=False)),
    "roots": two(lambda x, y: jnp.sqrt(1 + x * x) + jax.lax.rsqrt(2 + y * y) + (3 + x * y) ** 1.5 + (2 + x) ** (y / 8)),
    "activations": two(lambda x, y: jax.nn.sigmoid(x) + jax.nn.relu(y) + jax.nn.silu(x) + jax.nn.relu6(x * y)),
    "extremes": two(lambda x, y: jnp.maximum(x, y) * jnp.minimum(x, 0.3) + jnp.abs(y) + jnp.clip(x, -0.5, 0.5)),
    "switches": two(lambda x, y: jnp.where((x > 0) & (y <= 0.5), x * y, jnp.where(~(x < -1), y, -x)) + jnp.sign(x)),
    "more switches": two(
        lambda x, y: jnp.where((x >= y) | (x == y), x, y) + jnp.where(x != y, 1.0, 2.0) + (x > 0).astype(y.dtype) * y
    ),
    "sums": lambda x: jnp.stack([x.sum(), x.prod(), x.max(), x.min(), x.mean(), jnp.linalg.norm(x) ** 2, jnp.cumsum(x * x)[1]]),
    "products": lambda x: jnp.outer(x, x) @ x + jnp.array([[1.0, 2.0], [3.0, 4.0]]) @ x + jnp.einsum("i,ij->j", x, jnp.eye(2)),
    "batched products": lambda x: jnp.einsum("bi,bij->bj", jnp.stack([x, 2 * x]), jnp.ones((2, 2, 3)) * x[0]),
    "indexing": lambda x: jnp.concatenate([x[::-1], x[1:], jnp.roll(x, 1), x[jnp.array([1, 0, 1])], jnp.pad(x, 1)]),
    "updates": lambda x: jnp.zeros((3,), x.dtype).at[1].set(x[0]).at[jnp.array([0, 2])].set(x * 2),
    "slices": lambda x: jax.lax.dynamic_slice(x, (1,), (1,)) + jax.lax.dynamic_update_slice(x, x[:1] * 3, (1,)),
    "shapes": lambda x: jnp.tile(x, 2).reshape(2, 2).T[None].squeeze(0) + jnp.broadcast_to(x, (2, 2)),
    "scan": stepped,
    "loop": lambda x: jax.lax.fori_loop(0, 4, lambda i, z: z * x[0] + i, x[1]),
    "vmap": lambda x: jax.vmap(lambda a: jnp.sin(a) * x)(jnp.arange(3.0)),
    "checkpoint": jax.checkpoint(lambda x: jnp.sin(x) ** 2),
    "derivative": jax.grad(two(lambda x, y: jnp.tanh(x * y) * jnp.sin(x))),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_program_and_its_jacobian_are_those_of_jax(name):
    f = PROGRAMS[name]
    of_values, of_slopes = graph.trace(f, 2), graph.jacobian(f, 2)
    exact = jax.jit(lambda x: (f(x), jax.jacfwd(f)(x)))
    for x in np.random.default_rng(2).uniform(-1.4, 1.4, (8, 2)):
        y, slopes = exact(x)
        np.testing.assert_allclose(values(of_values, list(x)), y, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(values(of_slopes, list(x)), slopes, rtol=1e-11, atol=1e-11)
    assert bool(of_slopes.jumps) == ("switches" in name)


@pytest.mark.parametrize(
    ("f", "name"),
    [
        (jnp.floor, "floor"),
        (jnp.sort, "sort"),
        (lambda x: jnp.arange(2.0)[jnp.argmax(x)], "argmax"),
        (lambda x: jax.lax.while_loop(lambda z: jnp.all(z < 9), lambda z: 2 * z, x), "while"),
        (lambda x: jax.lax.cond(x[0] > 0, jnp.sin, jnp.cos, x), "cond"),
        (lambda x: jnp.arctan2(x[0], x[1]), "atan2"),
        (lambda x: x.astype(jnp.float32), "convert_element_type"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_primitive_without_a_formula_is_refused_by_name(f, name):
    with pytest.raises(UnknownPrimitiveError, match=name):
        graph.trace(f, 2)


def test_several_results_are_refused():
    with pytest.raises(ValueError, match=r"trace\.f.*2 arrays.*one array"):
        graph.trace(lambda x: (x, x), 2)


@st.composite
def polynomials(draw, depth=3):
    """(formula, function) of two variables."""
    kind = draw(st.sampled_from(["x", "constant"] if depth == 0 else ["x", "constant", "+", "-", "*", "^"]))
    if kind == "x":
        k = draw(st.integers(0, 1))
        return lambda g, k=k: g.atom("x", k), lambda p, k=k: p[k]
    if kind == "constant":
        c = draw(st.fractions(-3, 3, max_denominator=8))
        return lambda g, c=c: constant(c), lambda p, c=c: c
    (e, a), (f, b) = draw(polynomials(depth - 1)), draw(polynomials(depth - 1))
    n = draw(st.integers(0, 3))
    return {
        "+": (lambda g: combine((1, e(g)), (1, f(g))), lambda p: a(p) + b(p)),
        "-": (lambda g: combine((1, e(g)), (-1, f(g))), lambda p: a(p) - b(p)),
        "*": (lambda g: g.times(e(g), f(g)), lambda p: a(p) * b(p)),
        "^": (lambda g: g.power(e(g), n), lambda p: a(p) ** n),
    }[kind]


@settings(max_examples=60)
@given(polynomials(), st.fractions(-2, 2, max_denominator=7), st.fractions(-2, 2, max_denominator=5))
def test_formulas_of_polynomials_have_their_exact_values(polynomial, x, y):
    formula, function = polynomial
    g = Graph(["x", "y"])
    assert g.evaluate([formula(g)], [x, y], EXACT) == [function((x, y))]


def test_quotients_are_left_where_they_have_no_value():
    g = Graph(["x"])
    x = g.atom("x", 0)
    assert g.times(x, g.power(x, -1)) != constant(1)
    assert g.times(g.power(x, 2), x) == g.power(x, 3)
    assert g.power(combine((-2, x)), -2) == combine((Fraction(1, 4), g.power(x, -2)))


def test_text_and_support():
    found = graph.jacobian(field(plants.Pendulum()), 2, 1)
    g, e = found.graph, found.outputs[1, 0]
    assert g.text(e) == "cos(x1) - (u1)*(sin(x1))"
    assert g.support(e) == {0, 2}
    assert g.support(found.outputs[0, 1]) == set()


def test_long_formulas_are_abbreviated():
    g = Graph(["x"])
    e = g.atom("x", 0)
    for _ in range(60):
        e = g.times(combine((1, e), (1, constant(1))), combine((1, e), (2, constant(1))))
    assert len(g.text(e)) < 10_000
    assert "variables]" in g.text(e)
