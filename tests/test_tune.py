"""tune: the optimum against another search, proofs that hold, starts that are repaired or refused, and bad input."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
import scipy.linalg
import scipy.optimize

import jaxobs
from jaxobs import linalg
from jaxobs.certificates import Condition5, Corners, StepCorners
from jaxobs.designs import Infeasible, NormBounded, Polytope, corner_lmi, lpv_model, riccati_gamma, slope_entries
from jaxobs.integrators import Euler
from jaxobs.observers import DiscreteTracker, HighGain, IntegralHighGain, Luenberger, StepLuenberger, Tracker
from jaxobs.plants import Discretised, IntegratorChain, Pendulum, SampledChain
from jaxobs.tuning import Affine, ByCondition5, Linear, LogQ, Positive, Quadratic, tune
from jaxobs.tuning.descent import Search
from jaxobs.tuning.history import History
from jaxobs.tuning.tuned import change

pytestmark = pytest.mark.usefixtures("hardly_optimised")

PLANT = Pendulum()
MODEL = lpv_model(PLANT, slope_entries([[-1.0, 0.0]], [[1.0, 0.0]]))
CHART = LogQ()
START = {"log_q": CHART.encode([3.0, 2.0])}
RATE = 0.3
LUENBERGER = jnp.asarray([[2.0], [10.0]])


def high_gain(theta):
    return HighGain(PLANT, CHART.decode(theta["log_q"]), 1.0)


def variance(alphas, process=0.05):
    """Of x_2, under white noise of intensity 0.1 on y and `process` on x_2', without the nonlinearity."""
    f = jnp.eye(2, k=1).at[:, 0].add(-alphas)
    return linalg.lyapunov(f, 0.1 * jnp.outer(alphas, alphas) + jnp.diag(jnp.asarray([0.0, process])))[1, 1]


def quiet(observer, key):
    return jnp.sqrt(variance(observer.alphas))


@functools.cache
def tuned():
    return tune(high_gain, quiet, START, certify=Quadratic(MODEL), rate=RATE, starts=[{"log_q": CHART.encode([6.0, 9.0])}])


def largest_rate(alphas):
    return corner_lmi.largest_rate(MODEL, np.asarray(alphas, float)[:, None], rtol=1e-8)


def test_the_certificate_is_exact_and_of_this_observer_and_rate():
    found = tuned()
    assert isinstance(found.certificate, Corners)
    assert found.certificate.verify()
    assert found.certificate.rate == RATE
    assert np.array_equal(np.asarray(found.certificate.gain)[:, 0], np.asarray(found.observer.gain()))
    assert found.loss < found.first_loss


@pytest.mark.slow
def test_the_optimum_is_that_of_a_search_without_gradients():
    """Nelder-Mead over log alphas, with the largest rate of a semidefinite search as the constraint."""

    def cost(v):
        alphas = np.exp(v)
        missing = RATE - largest_rate(alphas)
        return float(jnp.sqrt(variance(jnp.asarray(alphas)))) + max(missing, 0.0)

    best = min(
        (scipy.optimize.minimize(cost, np.log(start), method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-6})
         for start in ([3.0, 2.0], [2.0, 2.0])), key=lambda one: one.fun
    )  # fmt: skip
    assert tuned().loss <= best.fun * (1 + 2e-3)
    assert tuned().loss >= best.fun * (1 - 2e-3)


def test_what_the_proof_costs():
    """Without a certificate the best is the Kalman filter's gain, in closed form."""
    s = scipy.linalg.solve_continuous_are(np.eye(2, k=-1), [[1.0], [0.0]], np.diag([0.0, 0.05]), [[0.1]])
    assert tuned().free_loss == pytest.approx(np.sqrt(s[1, 1]), rel=1e-4)
    assert tuned().loss > tuned().free_loss
    assert "the proof costs +" in str(tuned())


def test_the_history_records_every_step():
    history = tuned().history
    starts, steps = history.loss.shape
    assert starts == 2
    assert history.theta["['log_q']"].shape == (2, steps, 2)
    assert history.calls == 2 * steps
    assert np.all(np.diff(history.best, axis=1) <= 0)
    assert np.all(np.diff(history.weight) <= 0)
    at = np.argmin(np.where(history.good, history.loss, np.inf)[tuned().start])
    again = quiet(high_gain({"log_q": jnp.asarray(history.theta["['log_q']"][tuned().start, at])}), None)
    assert history.loss[tuned().start, at] == pytest.approx(float(again), rel=1e-12)
    assert history.seconds >= history.compile_seconds > 0


@pytest.mark.slow
def test_nothing_is_proved_when_that_is_said():
    found = tune(high_gain, quiet, START, certify=None, steps=20)
    assert found.certificate is None
    assert "nothing is proved" in str(found)


@pytest.mark.slow
def test_another_optimizer():
    found = tune(high_gain, quiet, START, certify=None, steps=400, optimizer=optax.adam(2e-2))
    assert found.loss == pytest.approx(tuned().free_loss, rel=1e-3)


@pytest.mark.slow
def test_common_random_numbers_are_averaged():
    keys = jax.random.split(jax.random.key(0), 8)

    def loss(observer, key):
        return quiet(observer, None) * (1 + 0.1 * jax.random.normal(key))

    found = tune(high_gain, loss, START, certify=None, steps=5, keys=keys)
    factor = 1 + 0.1 * np.mean([float(jax.random.normal(key)) for key in keys])
    assert found.first_loss == pytest.approx(float(quiet(high_gain(START), None)) * factor, rel=1e-12)
    assert found.history.calls == 5 * 8


@pytest.mark.slow
def test_a_start_that_does_not_prove_the_rate_is_moved():
    slow = {"log_q": CHART.encode([0.5, 0.1])}
    assert largest_rate(high_gain(slow).alphas) < RATE
    found = tune(high_gain, quiet, slow, certify=Quadratic(MODEL), rate=RATE, steps=100, price=False)
    assert found.repaired == (0,)
    assert found.certificate.verify()
    assert "was repaired" in str(found)


@pytest.mark.slow
def test_a_rate_out_of_reach_is_refused_with_the_nearest():
    """With alpha_1 = 1 the poles sum to -1: 1/2 is the supremum, which alpha_2 approaches at infinity."""

    def make(theta):
        return HighGain(PLANT, jnp.stack([jnp.ones(()), jnp.exp(theta)]), 1.0)

    assert largest_rate([1.0, 300.0]) > 0.45
    with pytest.raises(Infeasible, match=r"no start proves the rate 2 1/s.*The nearest that was reached is") as error:
        tune(make, lambda observer, key: variance(observer.alphas), jnp.asarray(0.0), certify=Quadratic(MODEL), rate=2.0)
    assert 0.45 < error.value.best < 0.5


def total(observer, key):
    return sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(observer))


@pytest.mark.parametrize(
    ("q", "cover"),
    [
        pytest.param(1, "multiplier", marks=pytest.mark.slow),
        pytest.param(0, "corners", marks=pytest.mark.slow),
        pytest.param(0, "multiplier", marks=pytest.mark.slow),
        pytest.param(1, "corners", marks=pytest.mark.slow),
    ],
)
def test_quadratic_for_chains_with_and_without_integrators(cover, q):
    alphas = [3.0, 3.0, 1.0][: 2 + q] if q else [3.0, 2.0]

    def make(theta):
        own = CHART.decode(theta)
        return IntegralHighGain(PLANT, own, 3.0, q) if q else HighGain(PLANT, own, 3.0)

    model, theta = MODEL.behind(q), CHART.encode(alphas)
    largest = corner_lmi.largest_rate(model, np.asarray(make(theta).gain())[:, None])
    certify = Quadratic(model, cover=cover)
    start = certify.start(make(theta), 0.0)
    assert start.rate == pytest.approx(largest, rel=1e-3)
    inside, outside = (float(certify.barrier(make(theta), start.fixed, start.free, jnp.asarray(share * largest)))
                       for share in (0.99, 1.01))  # fmt: skip
    assert np.isfinite(inside)
    assert np.isnan(outside)
    found = tune(make, total, theta, certify=certify, rate=0.9 * largest, steps=30, price=False)
    assert found.certificate.verify()
    assert any(found.certificate.taus) == (cover == "multiplier")
    with pytest.raises(Infeasible):
        certify.prove(make(theta), start.fixed, start.free, 1.01 * largest)


@pytest.mark.slow
def test_the_s_lemma():
    slope = NormBounded.lipschitz(2, 1.0, [1])
    none = np.zeros((2, 0))
    model = Polytope(np.eye(2, k=1), none, none.T, np.zeros(0), np.zeros(0), np.eye(1, 2))

    def make(theta):
        return HighGain(PLANT, CHART.decode(theta), 3.0)

    found = tune(make, total, CHART.encode([3.0, 2.0]), certify=Quadratic(model, slope), rate=1.0, steps=50, price=False)
    assert found.certificate.verify()
    assert found.certificate.tau > 0
    assert found.loss < found.first_loss


@pytest.mark.slow
def test_condition_5():
    gamma = 2 * riccati_gamma(alphas=[3.0, 2.0], lipschitz=1.5)

    def make(theta):
        return HighGain(PLANT, CHART.decode(theta), gamma)

    certify = ByCondition5(1.5)
    start = certify.start(make(CHART.encode([3.0, 2.0])), 0.0)
    found = tune(make, total, CHART.encode([3.0, 2.0]), certify=certify, rate=0.5 * start.rate, steps=50, price=False)
    assert isinstance(found.certificate, Condition5)
    assert found.certificate.verify()
    assert found.loss < found.first_loss
    with pytest.raises(Infeasible, match="prove less than the rate"):
        certify.prove(make(CHART.encode([3.0, 2.0])), (), (), start.rate * (1 + 1e-6))


@pytest.mark.slow
def test_a_step_observer():
    plant = Discretised(PLANT, Euler(), 0.1)
    model = lpv_model(plant, slope_entries([[-1.0, 0.0]], [[1.0, 0.0]]))
    chart = Affine([[0.6], [0.8]], [[0.1], [0.1]])

    def make(theta):
        return StepLuenberger(plant, chart.decode(theta))

    certify, theta = Quadratic(model, step=True), jnp.zeros((2, 1))
    least = corner_lmi.largest_rate(model, np.asarray(make(theta).gain), step=True)
    start = certify.start(make(theta), 1.0)
    assert start.rate == pytest.approx(least, rel=1e-3)
    found = tune(make, lambda o, key: jnp.sum(o.gain**2), theta, certify=certify, rate=0.95, steps=50, price=False)
    assert isinstance(found.certificate, StepCorners)
    assert found.certificate.verify()
    assert found.loss < found.first_loss
    fast = tune(
        make, lambda o, key: jnp.sum(o.gain**2), jnp.asarray([[-5.0], [-7.0]]), certify=certify, rate=0.9, steps=50, price=False
    )
    assert fast.repaired == (0,)
    assert fast.certificate.factor == 0.9


@pytest.mark.parametrize(
    ("make", "certify", "rate"),
    [
        (lambda theta: Tracker(2, 1, jnp.exp(theta)), Linear(IntegratorChain(2)), 5.0),
        pytest.param(
            lambda theta: DiscreteTracker(2, 0, jnp.exp(theta), 0.01), Linear(SampledChain(2, 0.01), step=True), np.exp(-0.05),
            marks=pytest.mark.slow,
        ),
        pytest.param(
            lambda theta: Luenberger(IntegratorChain(2), jnp.exp(theta) * LUENBERGER), Linear(IntegratorChain(2)), 3.0,
            marks=pytest.mark.slow,
        ),
    ],
    ids=["tracker", "discrete tracker", "Luenberger"],
)  # fmt: skip
def test_linear_errors(make, certify, rate):
    """The least mu that decays at the rate is the rate itself."""
    found = tune(make, lambda o, key: sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(o)), jnp.log(jnp.asarray(8.0)),
                 certify=certify, rate=float(rate), price=False)  # fmt: skip
    assert found.certificate.verify()
    if hasattr(found.observer, "mu"):
        assert float(found.observer.mu) == pytest.approx(5.0, rel=0.02)
        assert float(found.observer.mu) > 5.0


def test_linear_refuses_what_is_not():
    with pytest.raises(ValueError, match=r"Linear.observer: given HighGain; expected an observer whose error is linear"):
        Linear(PLANT).start(HighGain(PLANT, [3.0, 2.0], 1.0), 0.0)


def bad(observer, key):
    return jnp.where(jax.random.uniform(key) > 0.6, jnp.nan, 1.0) * jnp.sum(observer.alphas)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"loss": lambda o, key: o.alphas}, r"tune.loss: given shape \(2,\); expected a number"),
        ({"loss": lambda o, key: jnp.nan * o.gamma}, "tune.loss: given nan at theta0"),
        ({"loss": bad, "keys": jax.random.split(jax.random.key(1), 4)}, r"tune.loss: given nan at theta0, step 0, lane keys\["),
        ({"loss": lambda o, key: jnp.sum(o.gamma)}, r"tune.theta0\['log_q'\]: given a loss with no slope along it"),
        ({"theta0": {}}, "tune.theta0: given {}; expected at least one number"),
        ({"starts": [{"log_q": jnp.zeros(3)}]}, r"tune.starts\[0\]"),
        ({"rate": -1.0}, "tune.rate: given -1.0; expected a number >= 0"),
        ({"certify": None, "rate": 1.0}, "tune.rate: given 1.0; expected nothing with certify=None"),
        ({"theta0": {"log_q": jnp.full(2, jnp.nan)}}, "HighGain.alphas: given .* expected finite numbers"),
        ({"steps": 0}, "tune.steps: given 0"),
        ({"certify": Quadratic(MODEL.behind(1))}, "Polytope.gain: given shape"),
    ],
)  # fmt: skip
def test_bad_input_is_named(change, match):
    asked = {"make": high_gain, "loss": quiet, "theta0": START, "certify": Quadratic(MODEL), "rate": RATE} | change
    with pytest.raises(ValueError, match=match):
        tune(asked.pop("make"), asked.pop("loss"), asked.pop("theta0"), **asked)


def test_float32_is_refused():
    with jax.enable_x64(False), pytest.raises(ValueError, match=r"tune.precision: given float32; expected float64"):
        tune(high_gain, quiet, START, certify=None)


def test_a_loss_that_fails_on_the_way_is_named():
    """NaN below alpha_2 = 1.5, where the descent goes."""

    def loss(observer, key):
        return jnp.where((observer.alphas[1] < 1.5) & (key == 2), jnp.nan, 1.0) * quiet(observer, None)

    found = tune(high_gain, loss, START, certify=None, keys=jnp.arange(4), steps=40, optimizer=optax.adam(0.1))
    (said,) = found.history.refused()
    assert "the loss of keys[2] was not finite" in said
    assert float(found.observer.alphas[1]) >= 1.5


@pytest.mark.slow
def test_ctrl_c_ends_with_a_proof():
    seen = []

    def stop(progress):
        seen.append(progress)
        raise KeyboardInterrupt

    found = tune(high_gain, quiet, START, certify=Quadratic(MODEL), rate=RATE, progress=stop)
    assert len(seen) == 1
    assert found.stopped
    assert found.certificate.verify()


def test_ctrl_c_before_anything_is_searched_is_passed_on(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Search, "run", interrupted)
    with pytest.raises(KeyboardInterrupt):
        tune(high_gain, quiet, START, certify=None)


def test_why_steps_were_taken_back():
    """Start 0 left what is proved at step 1, in start 1 the loss of keys[3] failed at step 0 and a gradient at step 2."""
    good = np.array([[True, False, True], [False, True, False]])
    lane = np.array([[-1, -1, -1], [3, -1, -1]])
    numbers = np.ones((2, 3))
    one = History(numbers, numbers, np.array([0.1, 0.1, 0.0]), numbers, good, lane, {}, 6, 1.0, 0.5)
    first, second = one.refused()
    assert first == "start 0: 1 of 3 steps taken back, the first at step 1: left what is proved"
    assert second == "start 1: 2 of 3 steps taken back, the first at step 0: the loss of keys[3] was not finite"
    bare = dataclasses.replace(one, weight=np.zeros(3), lane=np.full((2, 3), -1))
    assert all(said.endswith("its gradient was not finite") for said in bare.refused())


@pytest.mark.parametrize(("new", "old", "said"), [(0.8, 1.0, "-20.0%"), (-3.5, -3.0, "-0.5"), (0.25, -0.25, "+0.5")])
def test_a_loss_that_may_be_negative_changes_by_a_difference(new, old, said):
    assert change(new, old) == said


def test_the_names_at_the_top():
    assert jaxobs.tune is tune


@pytest.mark.slow
def test_gamma_itself_may_be_tuned():
    chart = Positive()

    def make(theta):
        return HighGain(PLANT, [3.0, 2.0], chart.decode(theta))

    def loss(observer, key):
        return jnp.sqrt(variance(observer.gain()))

    found = tune(make, loss, jnp.log(jnp.asarray(4.0)), certify=Quadratic(MODEL), rate=1.0)
    least = scipy.optimize.brentq(lambda g: largest_rate([3 * g, 2 * g * g]) - 1.0, 0.5, 4.0)
    assert float(found.observer.gamma) == pytest.approx(least, rel=2e-3)
    assert float(found.observer.gamma) > least
