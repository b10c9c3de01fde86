"""Interval arithmetic: its roundings against exact fractions, its functions against balls, its rules one by one."""

import functools
import math
from fractions import Fraction

import flint
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flint import arb
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from jaxobs import intervals, plants
from jaxobs.intervals import Interval, bound, bounded, elementary, interval
from tests.interval_programs import NEWTON, of_plant, plant_names

FLOATS = st.floats(allow_nan=False, allow_infinity=False)
MODERATE = st.floats(2.0**-100, 2.0**100) | st.floats(-(2.0**100), -(2.0**-100)) | st.just(0.0)


def ends(x: Interval) -> list[list[float]]:
    return [np.ravel(x.lower).tolist(), np.ravel(x.upper).tolist()]


def check_single(found: Interval, exact: Fraction) -> None:
    """The float itself where the value is one, the two floats around the value elsewhere."""
    lower, upper = float(found.lower), float(found.upper)
    assert math.isinf(lower) or Fraction(lower) <= exact
    assert math.isinf(upper) or exact <= Fraction(upper)
    if math.isfinite(lower) and math.isfinite(upper) and lower != upper:
        assert math.nextafter(lower, math.inf) == upper


@settings(max_examples=50)
@given(FLOATS, FLOATS)
@example(1e308, 1e308)
@example(0.1, 0.2)
@example(5e-324, -1e308)
def test_sums_are_the_floats_around_the_exact_sum(a: float, b: float):
    found, exact = intervals.point(a) + b, Fraction(a) + Fraction(b)
    check_single(found, exact)
    if abs(exact) < 2**1000 and Fraction(float(exact)) == exact:
        assert found.is_point


@settings(max_examples=50)
@given(MODERATE, MODERATE)
@example(0.1, 10.0)
def test_products_and_quotients_are_the_floats_around_the_exact_ones(a: float, b: float):
    for found, exact in [(intervals.point(a) * b, Fraction(a) * Fraction(b)), (intervals.point(a) ** 2, Fraction(a) ** 2)]:
        check_single(found, exact)
        assert found.is_point == (Fraction(float(exact)) == exact)
    assume(b != 0)
    found, exact = intervals.point(a) / b, Fraction(a) / Fraction(b)
    check_single(found, exact)
    assert found.is_point == (Fraction(float(exact)) == exact)


@settings(max_examples=50)
@given(FLOATS, FLOATS)
@example(5e-324, 0.5)
@example(1e-200, 1e-200)
@example(1e200, -1e200)
def test_products_and_quotients_hold_at_the_ends_of_the_range(a: float, b: float):
    found, exact = intervals.point(a) * b, Fraction(a) * Fraction(b)
    assert Fraction(float(found.lower)) <= exact if math.isfinite(found.lower) else found.lower < 0
    assert Fraction(float(found.upper)) >= exact if math.isfinite(found.upper) else found.upper > 0
    assume(b != 0)
    found, exact = intervals.point(a) / b, Fraction(a) / Fraction(b)
    assert Fraction(float(found.lower)) <= exact if math.isfinite(found.lower) else found.lower < 0
    assert Fraction(float(found.upper)) >= exact if math.isfinite(found.upper) else found.upper > 0


@settings(max_examples=50)
@given(st.floats(0, allow_infinity=False))
@example(4.0)
@example(5e-324)
def test_a_square_root_is_enclosed(a: float):
    found = interval.sqrt(intervals.point(a))
    assert Fraction(float(found.lower)) ** 2 <= Fraction(a) <= Fraction(float(found.upper)) ** 2
    assert found.upper <= math.nextafter(math.nextafter(float(found.lower), math.inf), math.inf)
    if math.isqrt(int(a)) ** 2 == a and a < 2**100:
        assert found.is_point


@settings(max_examples=50)
@given(st.lists(FLOATS, min_size=4, max_size=4), st.lists(FLOATS, min_size=4, max_size=4), st.data())
def test_operations_enclose_those_of_every_number(first, second, data):
    x, y = (Interval(min(p[:2]), max(p[:2])) for p in (first, second))
    a, b = (data.draw(st.floats(float(z.lower), float(z.upper))) for z in (x, y))
    a, b = Fraction(a), Fraction(b)
    results = [
        (x + y, a + b),
        (x - y, a - b),
        (x * y, a * b),
        (-x, -a),
        (abs(x), abs(a)),
        (x**3, a**3),
        (x**2, a**2),
        (x**0, 1),
    ]
    if b:
        results.append((x / y, a / b))
    if a:
        results.append((x**-3, a**-3))
    for found, exact in results:
        assert math.isinf(found.lower) or Fraction(float(found.lower)) <= exact
        assert math.isinf(found.upper) or Fraction(float(found.upper)) >= exact


def test_infinite_ends_are_limits_and_zero_times_anything_is_zero():
    line, zero, right = Interval(-np.inf, np.inf), intervals.point(0.0), Interval(1.0, np.inf)
    assert ends(zero * line) == ends(zero / right) == ends(zero / Interval(-1.0, 1.0)) == [[0.0], [0.0]]
    assert ends(line + line) == ends(line - right) == ends(right - right) == ends(right / zero) == [[-np.inf], [np.inf]]
    assert ends(1 / right) == [[0.0], [1.0]]
    assert ends(right / right) == [[0.0], [np.inf]]
    assert ends(2 / Interval(0.0, 4.0)) == [[0.5], [np.inf]]
    assert ends(2 / Interval(-4.0, 0.0)) == [[-np.inf], [-0.5]]
    assert ends(1 / Interval(-1.0, 4.0)) == [[-np.inf], [np.inf]]
    assert ends(Interval(-1.0, 2.0) ** -2) == [[0.25], [np.inf]]
    assert ends(line**2) == [[0.0], [np.inf]]
    assert ends(line**3) == [[-np.inf], [np.inf]]


def test_an_interval_refuses_what_is_none():
    with pytest.raises(ValueError, match=r"Interval.lower, upper: .*expected lower <= upper"):
        Interval(1.0, 0.0)
    with pytest.raises(ValueError, match="not NaN"):
        Interval([0.0, np.nan], [1.0, 1.0])
    with pytest.raises(ValueError, match=r"shapes \(2,\) and \(\)"):
        Interval([0.0, 1.0], 2.0)
    with pytest.raises(ValueError, match="an array of real numbers"):
        Interval("zero", 1.0)


def test_an_interval_has_the_shape_and_the_sizes_of_its_entries():
    x = Interval([[-3.0, 1.0], [0.0, -2.0]], [[1.0, 2.0], [0.0, -1.0]])
    assert x.shape == (2, 2)
    assert x.ndim == 2
    assert not x.is_point
    assert x[1, 0].is_point
    np.testing.assert_array_equal(x.width, [[4.0, 1.0], [0.0, 1.0]])
    np.testing.assert_array_equal(x.magnitude, [[3.0, 2.0], [0.0, 2.0]])
    np.testing.assert_array_equal(x.mignitude, [[0.0, 1.0], [0.0, 1.0]])
    np.testing.assert_array_equal(x.contains(1.0), [[True, True], [False, False]])
    np.testing.assert_array_equal(intervals.hull(x, intervals.point(np.zeros((2, 2)))).upper, [[1.0, 2.0], [0.0, 0.0]])


PLACES = np.array(
    [0.0, -0.0, 0.5, -0.75, 1.0, -1.0, 3.7, -20.0, 700.0, 1e-9, -1e-300, 5e-324, 1e5, -1e17, 1e300, math.pi, 11 * math.pi / 2]
)
WAVES = ("sin", "cos", "tan")  # whose argument says nothing of the phase beyond 1e14
FUNCTIONS = {
    **{name: getattr(arb, name) for name in ("sin", "cos", "tan", "exp", "expm1", "log", "log1p", "tanh", "sinh", "cosh")},
    **{name: getattr(arb, name) for name in ("asinh", "acosh", "atanh", "asin", "acos", "atan", "erf", "erfc")},
    "erf_inv": arb.erfinv,
    "logistic": lambda x: 1 / (1 + (-x).exp()),
    "cbrt": lambda x: x.root(3) if x >= 0 else -((-x).root(3)),
    "exp2": lambda x: arb(2) ** x,
}


@pytest.mark.parametrize("name", list(FUNCTIONS))
def test_single_numbers_have_values_within_a_few_ulps(name: str):
    """The enclosure of f at one float meets the ball of f there, and is at most three floats wide."""
    primitive = {"exp2": jnp.exp2, "cbrt": jnp.cbrt, "erf": jax.lax.erf, "erfc": jax.lax.erfc, "erf_inv": jax.lax.erf_inv}
    f = primitive.get(name) or getattr(jax.lax, name)
    found, checked = bound(f, PLACES), 0
    with flint.ctx.workprec(4000):
        for x, lower, upper in zip(PLACES.tolist(), found.lower.tolist(), found.upper.tolist(), strict=True):
            exact = FUNCTIONS[name](arb(x))
            if exact.is_finite():
                assert not exact < arb(lower)
                assert not exact > arb(upper)
                if math.isfinite(lower) and math.isfinite(upper):
                    assert functools.reduce(math.nextafter, [math.inf] * 3, lower) >= upper or (name in WAVES and abs(x) > 1e14)
                checked += 1
            else:
                assert [lower, upper] == [-math.inf, math.inf] or math.isinf(lower) or math.isinf(upper)
    assert checked >= 6


@pytest.mark.parametrize(
    ("f", "lower", "upper"),
    [
        (jnp.exp, 0.0, math.inf), (jnp.tanh, -1.0, 1.0), (jax.nn.sigmoid, 0.0, 1.0), (jax.lax.erf, -1.0, 1.0),
        (jax.lax.erfc, 0.0, 2.0), (jnp.sin, -1.0, 1.0), (jnp.cos, -1.0, 1.0), (jnp.cosh, 1.0, math.inf),
        (jnp.arctan, math.nextafter(-math.pi / 2, -9), math.nextafter(math.pi / 2, 9)), (jnp.log, -math.inf, math.inf),
        (jnp.tan, -math.inf, math.inf), (jnp.sqrt, 0.0, math.inf), (jnp.arcsinh, -math.inf, math.inf),
        (jnp.expm1, -1.0, math.inf),
        (jax.nn.relu, 0.0, math.inf), (jnp.abs, 0.0, math.inf), (jnp.sign, -1.0, 1.0), (jnp.cbrt, -math.inf, math.inf),
    ],
)  # fmt: skip
def test_the_whole_line_has_the_range_of_the_function(f, lower: float, upper: float):
    assert ends(bound(f, intervals.whole(()))) == [[lower], [upper]]


@pytest.mark.parametrize(
    ("f", "box", "expected"),
    [
        (jnp.sin, (0.0, 2.0), (0.0, 1.0)), (jnp.sin, (-2.0, 0.0), (-1.0, 0.0)), (jnp.sin, (3.0, 6.0), (-1.0, None)),
        (jnp.cos, (-1.0, 0.5), (None, 1.0)), (jnp.cos, (3.0, 3.5), (-1.0, None)), (jnp.cosh, (-1.0, 2.0), (1.0, None)),
        (jnp.exp, (0.0, 0.0), (1.0, 1.0)), (jnp.log, (0.0, 1.0), (-math.inf, 0.0)), (jnp.log, (1.0, 1.0), (0.0, 0.0)),
        (jnp.sqrt, (4.0, 9.0), (2.0, 3.0)), (jnp.sqrt, (-1.0, 9.0), (0.0, 3.0)), (jax.lax.rsqrt, (0.0, 4.0), (0.5, math.inf)),
        (jnp.log, (-2.0, -1.0), (-math.inf, math.inf)), (jnp.tan, (1.0, 2.0), (-math.inf, math.inf)),
        (jnp.tan, (0.0, 1.0), (0.0, None)),
    ],
)  # fmt: skip
def test_crests_zeros_and_poles_are_exact(f, box, expected):
    found = bound(f, Interval(*box))
    for end, value in zip((found.lower, found.upper), expected, strict=True):
        assert value is None or end == value


def test_the_angle_is_bounded_by_corners_and_jumps_behind_the_origin():
    angle = bounded(
        jnp.arctan2,
        Interval([1.0, -1.0, 1.0, -1.0, -2.0], [2.0, 1.0, 2.0, 1.0, -1.0]),
        Interval([1.0, 1.0, -2.0, -2.0, -np.inf], [2.0, 2.0, -1.0, -1.0, -1.0]),
    )
    least, greatest = angle.value.lower, angle.value.upper
    pi = math.pi
    np.testing.assert_allclose(least, [math.atan2(1, 2), -pi / 4, math.atan2(2, -1), -pi, -pi], rtol=1e-15)
    np.testing.assert_allclose(greatest, [math.atan2(2, 1), pi / 4, math.atan2(1, -2), pi, math.atan2(-2, -1)], rtol=1e-15)
    assert least[3] < -pi < pi < greatest[3]
    assert least[4] < -pi
    assert any("atan2 wraps" in text for text in angle.jumps)
    assert bounded(jnp.arctan2, Interval(0.0, 1.0), Interval(-2.0, -1.0)).jumps == ()  # the axis itself belongs above


def test_powers_of_real_and_integer_exponents():
    assert ends(bound(lambda x: x**1.5, Interval(0.0, 4.0))) == [[0.0], [8.0]]
    assert ends(bound(lambda x: x**-0.5, Interval(0.0, 4.0))) == [[0.5], [math.inf]]
    found = bound(lambda x, y: x**y, Interval(0.5, 2.0), Interval(-1.0, 3.0))
    assert ends(found) == [[0.125], [8.0]]
    found = bound(lambda x: x ** jnp.asarray([3.0, 2.0, -1.0, 0.5, 0.0]), Interval(np.full(5, -2.0), np.full(5, 1.0)))
    assert ends(found) == [[-8.0, 0.0, -math.inf, 0.0, 1.0], [1.0, 4.0, math.inf, 1.0, 1.0]]
    assert ends(bound(lambda x, y: x**y, Interval(-1.0, 1.0), Interval(1.0, 2.0))) == [[-math.inf], [math.inf]]


@pytest.mark.parametrize("name", plant_names())
def test_structural_zeros_survive_infinite_boxes(name: str):
    """The entries that are [0, 0] over all states and inputs are those that vanish at a few random ones."""
    program = of_plant(name)
    jacobian = intervals.trace(jax.vmap(jax.jacfwd(program.f)), np.ones((3, program.n)))
    found = jacobian(intervals.whole((3, program.n))).value
    zero = (found.lower[0] == 0) & (found.upper[0] == 0)
    single = jacobian(np.random.default_rng(0).normal(size=(3, program.n))).value
    np.testing.assert_array_equal(zero, np.all((single.lower <= 0) & (single.upper >= 0), axis=0))
    if name in ("Pendulum", "IntegratorChain"):
        assert np.any(zero)
        assert ends(found[0, 0, 1]) == [[1.0], [1.0]]


@pytest.mark.parametrize("name", NEWTON)
def test_plants_that_solve_for_their_state_are_refused_by_primitive(name: str):
    program = of_plant(name)
    with pytest.raises(intervals.UnknownPrimitiveError, match="no interval rule for the primitive"):
        intervals.trace(program.f, np.ones(program.n))(intervals.whole((program.n,)))


def test_the_pendulum_on_the_box_of_its_papers_bound():
    """|phi_x| on |u| <= 1/2: a cos x1 - u sin x1 within sqrt(1.25), here its interval [-1.5, 1.5]."""
    pendulum = plants.Pendulum()
    found = bound(jax.jacfwd(pendulum.phi), Interval([-np.inf, -np.inf], [np.inf, np.inf]), Interval([-0.5], [0.5]))
    assert ends(found) == [[-1.5, 0.0], [1.5, 0.0]]


def test_endpoint_values_come_from_balls_of_more_than_double_precision():
    assert elementary.PRECISION >= 80
    before = flint.ctx.prec
    lower, upper = elementary.values("sin", np.array([1.0, 2.0]))
    with flint.ctx.workprec(200):
        assert all(arb(lo) < arb(x).sin() < arb(up) for x, lo, up in zip((1, 2), lower.tolist(), upper.tolist(), strict=True))
    assert flint.ctx.prec == before
