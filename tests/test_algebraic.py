"""The algebraic observer of paper 001, section 4, and the elimination that derives its maps."""

import math
import re
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sympy
from oracles import algebraic as oracle

from jaxobs import integrators, noise, observe, observers, plants, signals, simulate
from jaxobs.designs import elimination
from jaxobs.observers import Algebraic, DiscreteAlgebraic, DuffingRational, DuffingRoot, RationalMap, Tracker

NONE = jnp.zeros((0, 1))
GATED = RationalMap(plants.GatedChain(), 1, 0, (((1, 0, 0),), ((0, 0, 0),), ((0, 1, 0),), ((0, 0, 1),)), np.ones(4))


class Driven(plants.AbstractFlowPlant):
    """x1' = x2 + u^2, x2' = -x1^3 + u, y = x1: y'' contains u'."""

    n = 2
    m = 1
    p = 1

    def flow(self, t, x, u):
        now = u[0] if u.ndim == 1 else u[0, 0]
        return jnp.stack([x[1] + now**2, -(x[0] ** 3) + now])

    def h(self, x, u):
        return x[:1]

    def disturbance_matrix(self):
        return jnp.eye(2)


class DrivenMap(observers.AbstractAlgebraicMap):
    """x = (y, y' - u^2), and y'' with u' from the plant, for a check of the input's derivatives."""

    model: Driven
    order = 1
    input_order = 1

    def state(self, y, u):
        return jnp.stack([y[0], y[1] - u[0, 0] ** 2])

    def denominators(self, y, u):
        return jnp.ones_like(y[:2])


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (0.4, 2.5)])
def test_both_maps_invert_the_derivatives_of_sympy(a, b):
    plant = plants.Duffing(a, b)
    for x in [(0.3, -1.2), (2.0, 1.0), (-1.5, 0.7), (0.0, 0.0), (0.0, 3.0)]:
        y = jnp.asarray(
            [float(v) for v in oracle.duffing_jet(*map(sympy.Rational, x), 2, sympy.Rational(a), sympy.Rational(b))]
        )
        assert np.allclose(observers.output_derivatives(plant, jnp.asarray(x), 2), y, rtol=1e-13)
        assert np.allclose(DuffingRoot(plant).state(y, NONE), x, rtol=1e-12, atol=1e-12)
        assert np.allclose(DuffingRational(plant).state(y, NONE), x, rtol=1e-12, atol=1e-12)
        assert np.isclose(DuffingRoot(plant).state(y, NONE)[0], oracle.duffing_root(y[0], y[1], a, b), rtol=1e-9)
        expected = 4 * (1 + a) ** 2 + 9 * b * (1 + a) * y[0] ** 2 + 6 * b * (1 + a) * y[0] * x[0] + 9 * (b * y[0] * x[0]) ** 2
        assert np.isclose(DuffingRational(plant).denominators(y, NONE)[0], expected)


def test_the_cubic_map_is_defined_for_any_derivatives():
    phi = jax.jit(jax.vmap(lambda y: DuffingRoot(plants.Duffing()).state(y, NONE)))
    y = np.random.default_rng(0).normal(size=(50, 2)) * np.logspace(-3, 3, 50)[:, None]
    x = phi(jnp.asarray(y))
    assert np.allclose(x[:, 0] ** 3 + 2 * x[:, 0], y[:, 0] - y[:, 1], rtol=1e-10)
    assert np.allclose(np.sum(x, axis=1), y[:, 0])


def test_output_derivatives_follow_the_input():
    plant, u = Driven(), jnp.asarray([[0.5, -2.0, 3.0]])
    x = jnp.asarray([0.7, -0.4])
    expected = [0.7, -0.4 + 0.25, -(0.7**3) + 0.5 + 2 * 0.5 * -2.0]  # y'' = x2' + 2 u u'
    assert np.allclose(observers.output_derivatives(plant, x, 2, u), expected)
    third = -3 * 0.7**2 * (-0.4 + 0.25) - 2.0 + 2 * (4.0 + 0.5 * 3.0)  # -3 x1^2 x1' + u' + 2 (u'^2 + u u'')
    assert np.isclose(observers.output_derivatives(plant, x, 3, u)[3], third)


def test_the_observer_is_the_map_of_the_tracker():
    plant, tracker = plants.Duffing(), Tracker(3, 1, 15.0)
    run = simulate(plant, Algebraic(DuffingRoot(plant), tracker), x0=(1.0, 0.0), xhat0=(0.0, 0.5), ts=0.005 * np.arange(1200))
    late = np.abs(run.xhat - run.x)[600:]
    # biases C(4, 3) / mu^3 of y and C(4, 2) / mu^2 of y' under |y'''| <= 8.4; d x1 / d(y - y') = 1 / (2 + 3 x1^2) <= 1/2
    assert np.max(late[:, 0]) < (4 * 8.4 / 15**3 + 6 * 8.4 / 15**2) / 2
    assert np.max(late) > 1e-4
    etahat = observers.output_derivatives(plant, jnp.asarray([0.0, 0.5]), 2)
    assert np.allclose(run.xhat[0], [0.0, 0.5], atol=1e-15)
    assert np.allclose(Algebraic(DuffingRoot(plant), tracker).init(jnp.asarray([0.0, 0.5]))[0][1:], etahat)


def test_the_discrete_observer_is_the_map_of_the_discrete_tracker():
    plant, dt = plants.Duffing(), 0.01
    tracker = observers.DiscreteTracker(3, 1, 15.0, dt, 1.0)
    ts = dt * np.arange(500)
    y = np.sin(2 * ts) + 0.3 * np.cos(5 * ts)
    xhat0 = jnp.asarray([0.2, -0.1])
    whole = observe(DiscreteAlgebraic(DuffingRational(plant), tracker), ts, y, xhat0=xhat0)
    etahat = observe(tracker, ts, y, xhat0=observers.output_derivatives(plant, xhat0, 2)).xhat
    expected = jax.vmap(lambda e: DuffingRational(plant).state(e, NONE))(etahat)
    assert np.allclose(whole.xhat, expected, rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match=re.escape("DiscreteTracker.dt = 0.01 s")):
        observe(tracker, 2 * ts, y, xhat0=np.zeros(3))
    with pytest.raises(ValueError, match=re.escape("DiscreteAlgebraic.dt = 0.01 s")):
        observe(DiscreteAlgebraic(DuffingRational(plant), tracker), 2 * ts, y, xhat0=xhat0)


def test_a_larger_mu_means_less_bias_by_its_square():
    plant, worst = plants.Duffing(), []
    for mu in (20.0, 40.0):
        observer = Algebraic(DuffingRoot(plant), Tracker(3, 1, mu))
        run = simulate(plant, observer, x0=(1.0, 0.0), xhat0=(1.0, 0.0), ts=0.004 * np.arange(1500))
        worst.append(np.max(np.abs(run.xhat - run.x)[750:]))
    assert abs(math.log2(worst[0] / worst[1]) - 2) < 0.2


def test_the_input_and_its_derivatives_reach_the_map():
    signal = signals.Sine(0.8, 3.0, order=1)
    run = simulate(
        Driven(), Algebraic(DrivenMap(Driven()), Tracker(2, 0, 60.0)), x0=(0.5, 0.2), xhat0=(0.5, 0.2),
        ts=0.002 * np.arange(1500), signal=signal,
    )  # fmt: skip
    assert run.u.shape == (1500, 1, 2)
    assert np.max(np.abs(run.xhat - run.x)[500:, 1]) < 2 / 60 * 7 + 0.01  # the bias of y' under |y''| <= 7
    assert np.max(np.abs(run.xhat - run.x)[500:, 1]) < 0.2 * np.max(np.abs(run.x[500:, 1]))
    with pytest.raises(ValueError, match=re.escape("DrivenMap.u: given 0 derivatives of u; expected 1 of them, shape (1, 2)")):
        DrivenMap(Driven()).state(jnp.zeros(2), observers.algebraic.with_derivatives(DrivenMap(Driven()), jnp.zeros(1)))


def test_crossings_are_the_bad_inputs():
    ts, crossings = np.arange(0, 10, 0.01), jax.jit(lambda y, u: observers.crossings(GATED, y, u))
    for u, times in ((1 + 0.5 * np.sin(ts), []), (np.cos(ts), [math.pi / 2, 3 * math.pi / 2, 5 * math.pi / 2])):
        y = jnp.asarray(np.stack([0 * ts, 2 * u], axis=1))
        found = ts[np.asarray(crossings(y, jnp.asarray(u)[:, None, None]))]
        assert len(found) == len(times)
        assert np.all(np.abs(found - times) < 0.011)
        ours = jax.jit(jax.vmap(GATED.state))(y, jnp.asarray(u)[:, None, None])
        assert np.allclose(ours[:, 1], 2)
    assert np.all(observers.crossings(GATED, jnp.zeros((5, 2)), jnp.zeros((5, 1, 1))))
    duffing = jnp.asarray([[1.0, 0.0, 12.0], [1.0, 0.0, 12.5], [1.0, 0.0, 12.6]])  # the denominator vanishes at y'' = 37/3
    assert observers.crossings(DuffingRational(plants.Duffing()), duffing).tolist() == [False, True, False]
    assert not np.any(observers.crossings(DuffingRoot(plants.Duffing()), duffing))


def test_the_denominator_of_a_run_is_that_of_its_estimate():
    plant = plants.Duffing()
    observer = Algebraic(DuffingRational(plant), Tracker(3, 0, 10.0))
    z = observer.init(jnp.asarray([0.6, -0.3]))
    bottom = observer.denominators(jnp.zeros(()), z, jnp.zeros(0), jnp.zeros(1))
    assert np.isclose(bottom[0], 16 + 12 * 0.3 * 0.6 + 9 * (0.3 * 0.6) ** 2 + 18 * 0.3**2)  # y = 0.3, x1 = 0.6
    digital = DiscreteAlgebraic(DuffingRational(plant), observers.DiscreteTracker(3, 0, 10.0, 0.01))
    z = digital.init(jnp.asarray([0.6, -0.3]))
    again = digital.denominators(jnp.asarray(0), z, jnp.zeros(0), digital.predict(jnp.asarray(0), z, jnp.zeros(0)))
    assert np.allclose(again, bottom)


def test_sensitivity_grows_towards_the_singularity():
    phi, none = DuffingRational(plants.Duffing()), NONE
    slope = jax.jit(lambda y: observers.sensitivity(phi, y, none))
    slopes = [float(np.abs(slope(jnp.asarray([1.0, 0.0, v]))[0, 2])) for v in (0.0, 12.0, 12.3)]
    assert slopes[0] < 1 < slopes[1] < slopes[2]
    root = observers.sensitivity(DuffingRoot(plants.Duffing()), jnp.asarray([1.0, 0.0]), none)
    x1 = oracle.duffing_root(1.0, 0.0)
    assert np.isclose(root[0, 1], -1 / (2 + 3 * x1**2))


def test_noise_costs_the_rational_map_more_than_the_cubic_one():
    plant, ts = plants.Duffing(), 0.005 * np.arange(2000)
    rms = {}
    for phi in (DuffingRoot(plant), DuffingRational(plant)):
        run = simulate(
            plant, Algebraic(phi, Tracker(3, 1, 15.0)), x0=(1.0, 0.0), xhat0=(1.0, 0.0), ts=ts, noise=noise.Gaussian(0.1),
            key=jax.random.key(3), integrator=integrators.RK4(),
        )  # fmt: skip
        rms[type(phi).__name__] = float(np.sqrt(np.mean((run.xhat - run.x)[500:, 0] ** 2)))
    assert rms["DuffingRoot"] < 0.15 < 2 * rms["DuffingRoot"] < rms["DuffingRational"]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: Algebraic(DuffingRational(plants.Duffing()), Tracker(2, 1, 5.0)),
            "tracker.n >= 3: the map uses y and 2 deriv",
        ),
        (lambda: Algebraic(DuffingRoot(plants.Duffing()), observers.DiscreteTracker(3, 0, 5.0, 0.1)), "DiscreteAlgebraic"),
        (lambda: DiscreteAlgebraic(DuffingRoot(plants.Duffing()), Tracker(3, 0, 5.0)), "there is Algebraic"),
        (lambda: Algebraic(plants.Duffing(), Tracker(3, 0, 5.0)), "expected an instance of AbstractAlgebraicMap"),
        (lambda: DuffingRoot(plants.Duffing(1.0, 0.0)), "b > 0"),
        (lambda: DuffingRoot(plants.Duffing(-2.0, 1.0)), "1 + a > 0"),
        (lambda: DuffingRoot(plants.Lorenz()), "expected an instance of Duffing"),
        (lambda: RationalMap(plants.GatedChain(), 1, 0, (((1, 0, 0),),), [1.0]), "expected 4: numerator and denominator"),
        (lambda: RationalMap(plants.GatedChain(), 1, 0, GATED.exponents, [1.0]), "shape (4,)"),
        (
            lambda: Algebraic(DuffingRoot(plants.Duffing(np.float32(1), np.float32(1))), Tracker(3, 0, 5.0)),
            "precision float32; expected the tracker's float64",
        ),
    ],
)
@pytest.mark.usefixtures("as_users_have_it")
def test_bad_parts_are_refused(call, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        call()


def test_elimination_finds_the_two_forms_of_the_duffing_oscillator():
    y = sympy.symbols("y0:3")
    cubic = elimination.eliminate(plants.Duffing(), order=1)
    x1 = cubic.states[0]
    assert [one.degree for one in cubic.relations] == [3, 3]
    assert sympy.expand(cubic.relations[0].polynomial - (x1**3 + 2 * x1 - y[0] + y[1])) == 0
    rational = elimination.eliminate(plants.Duffing())
    assert rational.order == 2
    c = y[2] + 2 * y[1] - y[0]
    corrected = (9 * y[0] ** 2 * (y[0] - y[1]) - 4 * c) / (16 + 18 * y[0] ** 2 - 3 * y[0] * c)
    first = rational.relations[0]
    assert sympy.simplify(first.numerator / first.denominator - corrected) == 0
    p, q = rational.states
    trajectory = 16 + 12 * (p + q) * p + 9 * (p + q) ** 2 * p**2 + 18 * (p + q) ** 2
    assert sympy.expand(first.on_trajectories**2 - trajectory**2) == 0
    phi, by_hand = rational.map(), DuffingRational(plants.Duffing())
    for v in ([0.3, -1.0, 2.0], [2.0, 1.0, -0.5]):
        assert np.allclose(phi.state(jnp.asarray(v), NONE), by_hand.state(jnp.asarray(v), NONE), rtol=1e-12)
    with pytest.raises(ValueError, match=re.escape("expected degree 1. Eliminate with one more derivative")):
        cubic.map()


def test_elimination_carries_the_input_and_its_derivatives():
    found = elimination.eliminate(plants.GatedChain())
    assert (found.order, [str(v) for row in found.u for v in row]) == (1, ["u1"])
    assert str(found.relations[1].denominator) == "u1"
    assert np.allclose(found.map().state(jnp.asarray([3.0, 4.0]), jnp.asarray([[2.0]])), [3.0, 2.0])
    p, q, u = sympy.symbols("p q u")
    system = ([q + u, -(p**3)], p + q, [p, q], [u])  # y' = q + u - p^3
    found = elimination.eliminate(system, order=2)
    assert len(found.u[0]) == 2  # y'' contains u'
    assert all(one.degree == 1 for one in found.relations)
    assert found.relations[0].on_trajectories != 0
    given = dict(zip(found.y, elimination.derivatives(*system[:3], found.u, 2), strict=True))
    for one in found.relations:
        assert sympy.simplify(sympy.expand((one.numerator - one.state * one.denominator).subs(given))) == 0
    with pytest.raises(ValueError, match=re.escape("map.model: given NoneType")):
        found.map()


def test_an_observer_made_by_elimination_runs():
    plant = plants.Duffing(0.5, 2.0)
    phi = elimination.eliminate(plant).map()
    observer = Algebraic(phi, Tracker(3, 0, 30.0))
    run = simulate(plant, observer, x0=(0.5, 0.5), xhat0=(0.5, 0.5), ts=0.002 * np.arange(1500))
    assert np.max(np.abs(run.xhat - run.x)) < 0.1


def test_what_elimination_cannot_do_is_refused():
    p, q = sympy.symbols("p q")
    with pytest.raises(ValueError, match=re.escape("expected derivatives that determine q")):
        elimination.eliminate(([p, q], p, [p, q], []))
    with pytest.raises(ValueError, match="expected a polynomial in states and inputs"):
        elimination.eliminate(([sympy.sin(q), p], p, [p, q], []))
    with pytest.raises(ValueError, match="given the operation 'sin'"):
        elimination.eliminate(plants.Pendulum())
    with pytest.raises(ValueError, match=re.escape("expected an integer >= 0")):
        elimination.eliminate(plants.Duffing(), order=-1)


def test_without_sympy_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(ImportError, match=re.escape("pip install 'jaxobs[algebra]'")):
        elimination.eliminate(plants.Duffing())


def test_bound_on_a_box_is_the_triangle_inequality():
    p, q = sympy.symbols("p q")
    assert (
        elimination.bound_on_box(3 * p**2 * q - sympy.Rational(1, 2) * q + 4, {p: 2.0, q: 0.5}) == 6 + sympy.Rational(1, 4) + 4
    )
