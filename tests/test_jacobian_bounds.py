"""Bounds on Jacobians: against closed forms, dense samples and exact rational arithmetic; what is assumed is said."""

import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxobs import intervals as iv
from jaxobs import plants
from jaxobs.intervals import Interval, expressions, graph, jacobian_bounds
from jaxobs.intervals.negative import is_negative, is_positive_definite
from jaxobs.intervals.ranges import ranges

INF = math.inf
RTOL = 1e-6


def box(lower, upper):
    return Interval(np.array(lower, float), np.array(upper, float))


def check(found, i, j, low, high):
    """The closed form lies between outer and inner bounds, which are RTOL apart."""
    size = max(abs(low), abs(high))
    slack = 4 * np.finfo(float).eps * size  # of the closed form in floats
    assert found.lower[i, j] <= low + slack
    assert low - slack <= found.inner_lower[i, j]
    assert found.inner_upper[i, j] <= high + slack
    assert high - slack <= found.upper[i, j]
    assert found.inner_lower[i, j] - found.lower[i, j] <= 1.001 * RTOL * size
    assert found.upper[i, j] - found.inner_upper[i, j] <= 1.001 * RTOL * size


def test_polynomial_and_products_have_their_closed_forms():
    found = jacobian_bounds(lambda x: jnp.stack([x[0] ** 3, jnp.sin(x[1]) * x[0], x[1] * 0 + 7]), ([-1, -2], [2, 2]))
    check(found, 0, 0, 0.0, 12.0)
    check(found, 1, 0, -1.0, 1.0)
    check(found, 1, 1, -1.0, 2.0)
    assert found.zeros.tolist() == [[False, True], [False, False], [True, True]]
    assert not found.lower[found.zeros].any()
    assert not found.upper[found.zeros].any()
    assert found.assumptions == ()
    assert found.boxes < 500
    assert float(found.gap.max()) <= RTOL


def haldane(x, capacity=1.0, inhibition=0.5):
    """Growth that a high concentration inhibits: mu(s) = s / (k + s + s^2 / k_i)."""
    return x / (capacity + x + x**2 / inhibition)


def test_haldane_kinetics():
    """mu' = (k - s^2 / k_i) / (...)^2 falls to its minimum at the root of a cubic, and is 1 / k at s = 0."""
    found = jacobian_bounds(haldane, ([0.0], [5.0]))
    # mu'' = 0: (-2 s / k_i) D = 2 D' (k - s^2 / k_i), D = k + s + s^2 / k_i
    s = np.polynomial.Polynomial([0, 1])
    d = 1 + s + s**2 / 0.5
    roots = ((-2 * s / 0.5) * d - 2 * d.deriv() * (1 - s**2 / 0.5)).roots()
    root = float(next(r.real for r in roots if abs(r.imag) < 1e-12 and 0 < r.real < 5))
    check(found, 0, 0, (1 - root**2 / 0.5) / (1 + root + root**2 / 0.5) ** 2, 1.0)


def contois(x, dilution=0.2, feed=0.1):
    """Biomass and substrate of a bioreactor with the growth s / (x + s): J. P. Gauthier, H. Hammouri, S. Othman, IEEE TAC 37
    (1992), 875-880."""
    growth = x[0] * x[1] / (x[0] + x[1])
    return jnp.stack([growth - dilution * x[0], -growth + dilution * (feed - x[1])])


def test_bisection_makes_a_bioreactor_bound_finite_in_practice():
    """d(growth)/dx = (s / (x + s))^2 depends on s / x alone; one interval evaluation of the quotient rule is off 600-fold."""
    low, high = np.array([0.02, 0.0175]), np.array([1.0, 0.83])
    once = iv.bound(jax.jacfwd(contois), Interval(low, high))
    assert once.lower[0, 0] < -590
    assert once.upper[0, 0] > 21
    found = jacobian_bounds(lambda x: contois(x)[:1], (low, high))
    least, most = low[1] / (high[0] + low[1]), high[1] / (low[0] + high[1])
    check(found, 0, 0, least**2 - 0.2, most**2 - 0.2)
    other = low[0] / (low[0] + high[1]), high[0] / (high[0] + low[1])
    check(found, 0, 1, other[0] ** 2, other[1] ** 2)
    assert found.boxes < 20_000


def test_several_arguments_and_unbounded_ones():
    """The slope cos x - u sin x of the pendulum for |u| <= 1/2: at most sqrt(1 + u^2)."""
    plant, t = plants.Pendulum(), jnp.asarray(0.0)
    found = jacobian_bounds(lambda x, u: plant.flow(t, x, u), (box([-4, -INF], [4, INF]), box([-0.5], [0.5])))
    check(found, 1, 0, -math.sqrt(1.25), math.sqrt(1.25))
    assert found.zeros.tolist() == [[True, False], [False, True]]
    assert found.lower[0, 1] == found.upper[0, 1] == found.inner_lower[0, 1] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("dilution", [([0.1], [0.4])])
def test_dense_samples_stay_inside_and_come_close(dilution):
    def f(x, u):
        r = haldane(x[1]) * x[0]
        return jnp.stack([r - u[0] * x[0], -2 * r + u[0] * (3.0 - x[1]), jnp.tanh(x[0] * x[1]), jnp.abs(x[1] - 1)])

    low, high = np.array([0.05, 0.0, *dilution[0]]), np.array([2.0, 5.0, *dilution[1]])
    found = jacobian_bounds(f, (box(low[:2], high[:2]), box(*dilution)))
    grid = np.stack(np.meshgrid(*(np.linspace(a, b, 41) for a, b in zip(low, high, strict=True))), -1).reshape(-1, 3)
    slopes = np.asarray(jax.jit(jax.vmap(jax.jacfwd(f)))(grid[:, :2], grid[:, 2:]))
    assert (slopes >= found.lower - 1e-13).all()
    assert (slopes <= found.upper + 1e-13).all()
    assert (found.inner_lower <= slopes.min(0) + 1e-13).all() or float(found.gap.max()) <= RTOL
    width = found.upper - found.lower
    assert (slopes.min(0) - found.lower <= 0.05 * width).all()
    assert (found.upper - slopes.max(0) <= 0.05 * width).all()


@pytest.mark.parametrize(
    ("f", "low", "high"),
    [
        (jax.nn.relu, 0.0, 1.0),
        (lambda x: jnp.abs(x - 0.3), -1.0, 1.0),
        (lambda x: jnp.abs(x) * x, 0.0, 4.0),
        (lambda x: jnp.clip(x, -0.5, 1.5), 0.0, 1.0),
        (lambda x: jnp.maximum(x, x**2), -2.0, 4.0),
    ],
)
def test_kinks_keep_both_slopes(f, low, high):
    """A slope that jumps is not monotone, whatever its own derivative says."""
    found = jacobian_bounds(f, ([-1.0], [2.0]))
    check(found, 0, 0, low, high)
    assert found.assumptions == ()


def test_jumps_and_poles_are_assumptions():
    found = jacobian_bounds(lambda x: jnp.where(x > 0.3, x, 2 * x), ([-1.0], [1.0]))
    assert (found.lower[0, 0], found.upper[0, 0]) == (1.0, 2.0)
    assert "continuous where a switch is undecided" in found.assumptions[0]
    pole = jacobian_bounds(lambda x: 1 / x, ([-1.0], [2.0]))
    assert pole.lower[0, 0] == -INF
    assert pole.upper[0, 0] == -0.25
    assert pole.inner_lower[0, 0] < -1e15
    assert pole.boxes < 2000
    assert any("a denominator is not 0" in one for one in pole.assumptions)
    removable = jacobian_bounds(lambda x: 1 / (1 + x * x - x), ([-2.0], [2.0]))  # at least 3/4, seen after halving
    assert removable.assumptions == ()
    assert np.isfinite(removable.upper).all()


def test_where_no_halving_gives_a_bound_is_soon_given_up():
    """At a knot of a table its slope has two places, which intervals take apart, however small the box."""
    knots = jnp.linspace(-2.0, 2.0, 5)

    def table(x):
        return x[1] - jnp.interp(x[0], knots, jnp.sin(knots))

    found = ranges(lambda x: jax.jacfwd(table)(x)[:1], box([-1.5, -1.0], [1.5, 1.0]))
    assert (found.lower, found.upper) == (-INF, INF)
    assert found.boxes < 1000


def test_an_entry_that_nothing_bounds_is_infinite_and_known_to_be():
    found = jacobian_bounds(lambda x: jnp.stack([x[0] ** 3, jnp.tanh(x[0])]), ([-INF], [INF]))
    assert (found.lower[0, 0], found.upper[0, 0], found.inner_upper[0, 0]) == (0.0, INF, INF)
    check(found, 1, 0, 0.0, 1.0)


@pytest.mark.slow
def test_a_small_budget_loosens_the_bounds_and_says_so():
    low, high = [0.02, 0.0175], [1.0, 0.83]
    coarse, fine = (jacobian_bounds(contois, (low, high), max_boxes=count) for count in (64, 20_000))
    assert (coarse.lower <= fine.lower).all()
    assert (coarse.upper >= fine.upper).all()
    assert coarse.boxes < 64 + 8 * 64
    assert coarse.gap.max() > RTOL >= fine.gap.max()


def test_the_precision_flag_does_not_matter():
    def f(x):
        return jnp.sin(x) * 0.1

    wide = jacobian_bounds(f, ([0.0], [4.0]))
    with jax.enable_x64(False):
        narrow = jacobian_bounds(f, ([0.0], [4.0]))
    assert np.array_equal(wide.lower, narrow.lower)
    assert np.array_equal(wide.upper, narrow.upper)


def test_bad_boxes_and_unknown_primitives_are_named():
    with pytest.raises(ValueError, match=r"jacobian_bounds\.box: .*expected \(lower, upper\)"):
        jacobian_bounds(jnp.sin, [1.0])
    with pytest.raises(ValueError, match=r"jacobian_bounds\.box: given shape \(\) for x"):
        jacobian_bounds(jnp.sin, (0.0, 1.0))
    with pytest.raises(ValueError, match="lower <= upper"):
        jacobian_bounds(jnp.sin, ([1.0], [0.0]))
    with pytest.raises(iv.UnknownPrimitiveError, match="digamma"):
        jacobian_bounds(jax.lax.lgamma, ([1.0], [2.0]))


@pytest.mark.slow
def test_the_sign_on_a_curve_is_proved_or_not():
    """x1' = x2, x2' = -x1 - x2 + u: V = x1^2 + x1 x2 + x2^2 falls on its level sets V = 4 for small |u| only."""

    def v(x):
        return x[0] ** 2 + x[0] * x[1] + x[1] ** 2

    def change(z):
        return jax.jvp(v, (z[:2],), (jnp.stack([z[1], -z[0] - z[1] + z[2]]),))[1]

    def at(size, most):
        return is_negative(change, box([-3, -3, -size], [3, 3, size]), on=lambda z: v(z[:2]) - 4, max_boxes=most)

    # V' = -V + u (x1 + 2 x2), and |x1 + 2 x2| <= 4 on V = 4
    assert at(0.8, 20_000)
    refused = at(1.1, 500)
    assert not refused
    assert refused.where is not None
    assert 0 < refused.boxes < 1000


def test_unbounded_coordinates_need_a_concave_quadratic():
    whole = box([-INF, -INF, -1], [INF, INF, 1])
    assert is_negative(lambda z: -2 * z[0] ** 2 - z[1] ** 2 + z[0] * z[2] - 1, whole)
    assert not is_negative(lambda z: -2 * z[0] ** 2 + z[1] * z[2] - 1, whole)
    assert not is_negative(lambda z: -(z[0] ** 2) - z[1] ** 2 + 1, whole)


def test_interval_elimination_agrees_with_eigenvalues():
    rng = np.random.default_rng(0)
    for _ in range(40):
        m = rng.normal(size=(4, 4))
        m = m + m.T + rng.uniform(0, 8) * np.eye(4)
        radius = rng.uniform(0, 0.1)
        worst = min(np.linalg.eigvalsh(m + radius * np.outer(s, s))[0] for s in rng.choice([-1, 1], size=(8, 4)))
        proved = is_positive_definite(Interval(m - radius, m + radius))
        assert not proved or worst > 0
        assert proved or np.linalg.eigvalsh(m)[0] < 8 * radius  # never far from the truth


def test_formulas_as_functions_enclose_their_fractions():
    third = graph.Expression(Fraction(1, 3), ((0, Fraction(1, 7)),))
    formulas = graph.trace(lambda x: x * 1.0, 1)
    found = iv.bound(expressions.as_function(formulas.graph, [third]), iv.point(np.array([1.0])))
    exact = Fraction(1, 3) + Fraction(1, 7)
    assert Fraction(float(found.lower[0])) <= exact <= Fraction(float(found.upper[0]))
    assert 0 < found.upper[0] - found.lower[0] < 1e-15


def test_multiplied_out_formulas_cancel():
    def f(x):
        return (x[0] * (x[1] * x[2]) - x[2] * (x[0] * x[1]) + (x[0] - 0.1) ** 2 * 3)[None]

    formulas = graph.trace(f, 3)
    terms = expressions.polynomial(formulas.graph, formulas.outputs[0])
    tenth = Fraction(0.1)
    assert terms == {((0, 2),): 3, ((0, 1),): -6 * tenth, (): 3 * tenth**2}
    at = np.array([0.7, 2.0, 3.0])
    value = iv.bound(expressions.of_polynomial(terms), iv.point(at))
    assert value.lower <= float(f(at)[0]) + 1e-15
    assert value.upper >= float(f(at)[0]) - 1e-15
    sine = graph.trace(lambda x: jnp.sin(x), 1)
    with pytest.raises(ValueError, match="'sin'"):
        expressions.polynomial(sine.graph, sine.outputs[0])


def test_one_period_is_enough_for_sines():
    formulas = graph.trace(lambda x: jnp.stack([jnp.cos(2 * x[0]) + x[1] * jnp.sin(3 * x[0]), x[0] + jnp.sin(x[0])]), 2)
    line = box([-INF, -1.0], [INF, 1.0])
    first, second = (expressions.one_period(formulas.graph, e, line) for e in formulas.outputs)
    assert math.pi < first.upper[0] == -first.lower[0] < math.pi + 1e-6  # 2 and 3 together repeat after 2 pi
    assert second.upper[0] == INF
    found = ranges(expressions.as_function(formulas.graph, list(formulas.outputs[:1])), first)
    samples = np.linspace(-math.pi, math.pi, 20_001)
    assert found.upper[0] == pytest.approx(
        max(np.max(np.cos(2 * samples) + u * np.sin(3 * samples)) for u in (-1, 1)), rel=1e-5
    )
