"""The linear error of observers of every kind, and its covariance, against closed forms, SciPy and a simulated path."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from oracles import linear_error as oracle
from oracles import noise

from jaxobs import hurwitz, integrators, observers, plants
from jaxobs.tuning.linear_error import covariance, linearise

pytestmark = pytest.mark.usefixtures("hardly_optimised")

PENDULUM = plants.Pendulum()
DT = 0.05
X = np.array([0.4, -0.3])


def pendulum_matrices(gain, x=X, a=1.0, u=0.0):
    """(A - L C, A) of the pendulum at x, by hand."""
    jacobian = np.array([[0.0, 1.0], [a * np.cos(x[0]) - u * np.sin(x[0]), 0.0]])
    return jacobian - np.outer(gain, [1.0, 0.0]), jacobian


@pytest.mark.parametrize(("n", "gamma", "q"), [pytest.param(5, 100.0, 0, marks=pytest.mark.slow), (5, 100.0, 1)])
def test_chain_under_white_noise_at_any_gain(n, gamma, q):
    """sigma^2 gamma^{i+j-1} times the covariance at gain 1, over 16 decades."""
    alphas = hurwitz.binomial(n + q)
    plant = plants.IntegratorChain(n)
    error = linearise(observers.IntegralHighGain(plant, alphas, gamma, q), plant, np.zeros(n), noise=0.3)
    assert np.all(error.mismatch == 0)
    assert np.all(error.drift == 0)
    assert np.all(error.offset == 0)
    order = np.arange(1, n + 1)
    expected = 0.09 * gamma ** (order[:, None] + order[None, :] - 1.0) * noise.white(np.asarray(alphas), q)[q:, q:]
    found = np.asarray(covariance(error))
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(found - expected) / size) < 1e-12


@pytest.mark.slow
def test_held_samples_at_high_gain():
    alphas, gamma, n = np.asarray(hurwitz.binomial(5)), 30.0, 5
    plant = plants.IntegratorChain(n)
    error = linearise(observers.HighGain(plant, alphas, gamma), plant, np.zeros(n), noise=0.3)
    order = np.arange(1, n + 1)
    # The oracle at gain 1 with the period gamma dt.
    expected = 0.09 * gamma ** (order[:, None] + order[None, :] - 2.0) * noise.held(alphas, 0, 0.01 * gamma) * 0.01 * gamma
    found = np.asarray(covariance(error, 0.01))
    assert np.max(np.abs(found / expected - 1)) < 1e-9


def test_process_and_measurement_noise_of_a_pendulum():
    gain = np.array([2.0, 1.7])
    error = linearise(observers.Luenberger(PENDULUM, gain[:, None]), PENDULUM, X, noise=0.1, process=0.4)
    f, _ = pendulum_matrices(gain)
    b, w = 0.1 * gain[:, None], 0.4 * np.array([[0.0], [1.0]])
    assert error.f == pytest.approx(f, abs=1e-15)
    assert covariance(error) == pytest.approx(oracle.white(f, np.hstack([b, w])), rel=1e-12)
    assert covariance(error, DT) == pytest.approx(oracle.sampled(f, b, w, DT), rel=1e-12)
    phi, gamma = oracle.held_matrix(f, np.hstack([b, -w]), DT)
    both = covariance(error, DT, process_held=True)
    assert both == pytest.approx(oracle.steps(phi, gamma), rel=1e-12)
    path = oracle.simulated(phi, gamma, 100_000, 0)
    assert np.diag(path) == pytest.approx(np.diag(np.asarray(both)), rel=0.05)  # about 3 standard errors


def test_another_model_leaves_a_mismatch():
    """F X + G C - X A = A_model - A, the drift f_model - f, and the bias where the observer rests."""
    gain = np.array([2.0, 1.7])
    observer = observers.Luenberger(plants.Pendulum(1.3), gain[:, None])
    error = linearise(observer, PENDULUM, X)
    f, model = pendulum_matrices(gain, a=1.3)
    _, jacobian = pendulum_matrices(gain)
    assert error.f == pytest.approx(f, abs=1e-15)
    assert error.mismatch == pytest.approx(model - jacobian, abs=1e-15)
    assert error.drift == pytest.approx([0.0, 0.3 * np.sin(X[0])], abs=1e-15)
    assert error.bias() == pytest.approx(-np.linalg.solve(f, [0.0, 0.3 * np.sin(X[0])]), rel=1e-12)


def test_input_and_a_matrix_of_noise():
    observer = observers.Luenberger(PENDULUM, np.array([[2.0], [1.7]]))
    error = linearise(observer, PENDULUM, X, [0.5], noise=[[0.1, 0.2]], process=[[1.0, 0.0], [0.0, 2.0]])
    assert error.f == pytest.approx(pendulum_matrices([2.0, 1.7], u=0.5)[0], abs=1e-15)
    assert error.noise == pytest.approx(np.outer([2.0, 1.7], [0.1, 0.2]))
    assert error.process == pytest.approx(-np.diag([1.0, 2.0]))


def test_current_form_sees_the_sample_at_once():
    """xhat = z + K (y - C z): output I - K C, direct K, and the filter's covariance by hand."""
    plant, gain = plants.SampledChain(2, DT), np.array([[0.4], [1.5]])
    error = linearise(observers.CurrentLuenberger(plant, gain), plant, np.zeros(2), noise=0.2, process=0.03)
    a, c = np.array([[1.0, DT], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    inner = np.eye(2) - gain @ c
    before = oracle.steps(a @ inner, np.hstack([0.2 * a @ gain, [[0.0], [0.03]]]))
    assert error.direct == pytest.approx(0.2 * gain)
    assert covariance(error) == pytest.approx(inner @ before @ inner.T + 0.04 * gain @ gain.T, rel=1e-12)


def test_sampled_observer_on_a_continuous_plant():
    """Sampled holds y: F = e^{(A - L C) dt}, G = int e^{(A - L C) s} ds L; the held disturbance moves the plant exactly."""
    gain, plant = np.array([[2.0], [1.7]]), plants.IntegratorChain(2)
    inner = observers.Luenberger(plant, gain)
    observer = observers.Sampled(inner, integrators.Exponential(), DT)
    error = eqx.filter_jit(linearise)(observer, plant, np.zeros(2), noise=0.2, process=0.5)
    a = np.eye(2, k=1)
    f, g = oracle.held_matrix(a - gain @ np.eye(1, 2), gain, DT)
    assert error.f.shape == (2, 2), "the matrices of the integrator are no part of the error"
    assert error.f == pytest.approx(f, rel=1e-12)
    assert error.noise == pytest.approx(0.2 * g, rel=1e-12)
    assert error.process == pytest.approx(-0.5 * np.array([[DT**2 / 2], [DT]]), rel=1e-12)
    assert error.mismatch == pytest.approx(f + g @ np.eye(1, 2) - scipy.linalg.expm(a * DT), abs=1e-12)
    assert np.max(np.abs(error.mismatch)) > 1e-3, "a held output is late"


@pytest.mark.parametrize("q", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_trackers_are_taken_with_their_gain_open(q):
    mu, plant = 3.0, plants.IntegratorChain(2)
    flow = linearise(observers.Tracker(2, q, mu), plant, np.zeros(2))
    gain = np.asarray(hurwitz.binomial(2 + q)) * mu ** np.arange(1, 3 + q)
    known = [[-gain[0], -1, 0], [gain[1], 0, 1], [gain[2], 0, 0]] if q else [[-gain[0], 1], [-gain[1], 0]]
    assert flow.f == pytest.approx(np.array(known, float), rel=1e-12)
    assert flow.noise[:, 0] == pytest.approx(np.eye(3)[0] if q else gain, rel=1e-12)
    step = linearise(observers.DiscreteTracker(2, q, mu, DT, 1.0), plant, np.zeros(2))
    known = linearise(observers.DiscreteTracker(2, q, mu, DT), plant, np.zeros(2))  # steady from the start
    assert step.f == pytest.approx(np.asarray(known.f), abs=1e-9)
    sigma, live = np.exp(-mu * DT), np.sort(np.abs(np.linalg.eigvals(step.f)))[-2 - q :]
    assert live == pytest.approx(sigma, rel=1e-3)  # poles that meet split under rounding


def test_a_clock_that_has_just_started():
    closed = linearise(observers.Tracker(2, 0, 3.0, 100.0), plants.IntegratorChain(2), np.zeros(2), clock=0.0)
    assert closed.noise == pytest.approx(np.array([[0.01], [0.0]]), abs=1e-12)  # H(0)^-1 C'


def test_a_state_may_be_given():
    """The gain of a Kalman observer is that of its covariance."""
    plant = plants.IntegratorChain(2)
    observer = observers.ContinuousKalman(plant, [[0.5]], [[0.1]], np.eye(2))
    p = scipy.linalg.solve_continuous_are(np.eye(2, k=1).T, np.eye(1, 2).T, np.diag([0.0, 0.5]), 0.1 * np.eye(1))
    z = (jnp.zeros(2), jnp.linalg.cholesky(jnp.asarray(p)))
    root = float(np.sqrt(0.1))
    error = linearise(observer, plant, np.zeros(2), noise=root, process=float(np.sqrt(0.5)), z=z)
    driven = np.hstack([error.noise, error.process])
    found = error.output @ oracle.white(np.asarray(error.f), driven) @ error.output.T
    assert found == pytest.approx(p, rel=1e-9)


def test_points_side_by_side_and_derivatives():
    points = jnp.asarray([[0.4, -0.3], [1.0, 0.2]])

    def size(observer):
        found = jax.vmap(lambda x: covariance(linearise(observer, PENDULUM, x, noise=0.1, process=0.3), DT))(points)
        return jnp.trace(jnp.sum(found, axis=0))

    observer = observers.Luenberger(plants.Pendulum(1.1), [[2.0], [1.7]])
    alone = sum(np.trace(covariance(linearise(observer, PENDULUM, x, noise=0.1, process=0.3), DT)) for x in points)
    both = eqx.filter_jit(eqx.filter_value_and_grad(size))
    value, slope = both(observer)
    assert value == pytest.approx(alone, rel=1e-12)
    for leaf, change, found in (
        (lambda o: o.gain, np.array([[1.0], [-2.0]]), slope.gain),
        (lambda o: o.model.a, np.array(1.0), slope.model.a),
    ):
        ends = [both(eqx.tree_at(leaf, observer, leaf(observer) + s * 1e-5 * change))[0] for s in (1, -1)]
        assert float(np.sum(found * change)) == pytest.approx(float(ends[0] - ends[1]) / 2e-5, rel=1e-7)


def test_what_is_not_stable_is_infinite():
    flow = linearise(observers.Luenberger(PENDULUM, [[1.0], [-0.5]]), PENDULUM, X)
    plant = plants.SampledChain(2, DT)
    step = linearise(observers.StepLuenberger(plant, [[0.1], [-0.1]]), plant, np.zeros(2))
    for found in (covariance(flow), covariance(flow, DT), covariance(step)):
        assert np.all(np.isinf(found))


@pytest.mark.slow
def test_what_is_not_stable_has_no_gradient():
    plant = plants.IntegratorChain(2)

    def size(gain):
        error = linearise(observers.Luenberger(plant, gain), plant, jnp.zeros(2))
        return jnp.trace(covariance(error)), jnp.trace(covariance(error, DT))

    gain = jnp.asarray([[1.0], [-0.5]])
    values, slopes = jax.jit(lambda gain: (size(gain), jax.jacrev(size)(gain)))(gain)
    assert np.all(np.isinf(values))
    assert np.all(np.isfinite(slopes))


def test_white_noise_that_is_seen_directly_is_infinite():
    observer = linearise(observers.Luenberger(PENDULUM, [[2.0], [1.7]]), PENDULUM, X)
    seen = eqx.tree_at(lambda e: e.direct, observer, jnp.asarray([[0.5], [0.0]]))
    assert np.isinf(np.diag(covariance(seen))).tolist() == [True, False]


def test_what_cannot_be_linearised_is_refused(as_users_have_it):
    observer = observers.Luenberger(PENDULUM, [[2.0], [1.7]])
    step = plants.Discretised(PENDULUM, integrators.RK4(), DT)
    with pytest.raises(ValueError, match="observer: given Luenberger; expected a step observer for a step plant"):
        linearise(observer, step, X)
    with pytest.raises(ValueError, match="x: given shape"):
        linearise(observer, PENDULUM, [X, X])
    with pytest.raises(ValueError, match="process: given shape"):
        linearise(observer, PENDULUM, X, process=[1.0, 2.0])
    with pytest.raises(ValueError, match="n = 3, p = 1; expected the plant's n = 2"):
        linearise(observers.Tracker(3, 0, 1.0), PENDULUM, X)
    with pytest.raises(ValueError, match="observer: given tuple"):
        linearise((observer, None), PENDULUM, X)
    with pytest.raises(ValueError, match=r"dt: given 0\.05; expected None"):
        covariance(linearise(observers.StepLuenberger(step, [[0.1], [0.1]]), step, X), DT)
    with pytest.raises(ValueError, match=r"dt: given 0\.0; expected a positive number"):
        covariance(linearise(observer, PENDULUM, X), 0.0)
