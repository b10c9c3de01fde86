"""The observers (12) and (25) of paper 003: against scipy, least squares, the trackers of paper 001; and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import lyapunov as oracle

import jaxobs
from jaxobs import integrators, linalg, observers, plants, signals
from jaxobs.observers import DiscreteTracker, HighGain, Lyapunov, StepLyapunov, Tracker
from jaxobs.observers.lyapunov import from_scaled

S0 = np.array([[1.0, 0.2, 0.0], [0.2, 0.5, 0.1], [0.0, 0.1, 2.0]])
MOTOR = plants.FieldMotor(1.0, 0.5, 1.0, 0.5, 0.2, 0.5, 0.1)


def field(t):
    return np.array([1 + 0.8 * np.sin(2 * t), np.cos(t)])


class Field(signals.AbstractSignal):
    m = 2

    def __call__(self, t):
        return jnp.stack([1 + 0.8 * jnp.sin(2 * t), jnp.cos(t)])


def motor_a(u):
    return np.diag([-2 * u[0], -2.0], 1)


def motor_g(x, u):
    friction = 0.2 * np.tanh(x[1] / 0.5) + 0.1 * x[1]
    return np.array([2 * (u[1] - x[0]), 2 * (u[0] * x[0] - friction), 0.0])


C = np.eye(1, 3)
X0, XHAT0 = np.array([0.5, 1.0, -0.5]), np.zeros(3)


@pytest.mark.parametrize("scaled", [False, True])
def test_both_observers_equal_scipy(scaled):
    """(12) is integrated as printed, in its own variables, and met by the one engine through from_scaled."""
    ts = np.linspace(0, 3, 301)
    if scaled:
        _, expected, _ = oracle.observer_12(motor_a, C, motor_g, 2.0, 1.5, S0, field, X0, XHAT0, ts)
        theta, start = from_scaled(2.0, 1.5, S0)
    else:
        _, expected, _ = oracle.observer_25(motor_a, C, motor_g, 3.0, S0, field, X0, XHAT0, ts)
        theta, start = 3.0, S0
    run = jaxobs.simulate(
        MOTOR, Lyapunov(MOTOR, theta, start), x0=X0, xhat0=XHAT0, ts=ts, signal=Field(), integrator=integrators.RK4(4)
    )
    np.testing.assert_allclose(run.xhat, expected, rtol=0, atol=2e-8)


def test_s_equals_its_equation_and_keeps_v():
    """V = e'S e of an affine plant falls by exactly e^{-theta t} + what the innovation takes; S is scipy's."""
    ts = np.linspace(0, 4, 401)
    a, theta = (lambda u: np.array([[0.0, u], [0.0, 0.0]])), 2.0
    x, xhat, s = oracle.observer_25(a, C[:, :2], lambda x, u: 0 * x, theta, np.eye(2), np.cos, [1.0, 1.0], [0.0, 0.0], ts)
    e = xhat - x
    v = np.einsum("ki,kij,kj->k", e, s, e)
    assert np.all(v * np.exp(theta * ts) <= v[0] * (1 + 1e-9))
    observer = Lyapunov(plants.GatedChain(), theta, 1.0)

    @jax.jit
    def run(z):
        rk4, dt = integrators.RK4(2), jnp.asarray(0.01)

        def body(z, t):
            wave = lambda t: jnp.cos(t)[None]  # noqa: E731
            return rk4.step(integrators.Field(lambda t, z: observer.flow(t, z, wave(t), jnp.zeros(1))), None, t, dt, z), z[1]

        return jax.lax.scan(body, z, jnp.asarray(ts))[1]

    np.testing.assert_allclose(run(observer.init(jnp.zeros(2))), s, rtol=0, atol=1e-9)


class Turning(plants.AbstractStateAffine):
    """Two outputs of three states, an input that turns and pushes."""

    n, m, p = 3, 1, 2

    def a(self, u):
        return jnp.asarray([[0.0, 1.0, 0.2], [-1.0, -0.1, 0.0], [0.0, 0.3, 0.1]], u.dtype) * (1 + u[0])

    def b(self, u):
        return jnp.stack([u[0], jnp.zeros_like(u[0]), jnp.ones_like(u[0])])

    def c(self):
        return jnp.asarray([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])


@pytest.mark.parametrize("theta", [0.5, 40.0])  # theta dt = 0.1 and 8: no limit
def test_the_step_observer_is_fading_least_squares(theta):
    rng, dt, count = np.random.default_rng(0), 0.2, 12
    us, ys = rng.normal(size=(count, 1)), rng.normal(size=(count, 2))
    plant = Turning()
    a, b = (lambda u: np.asarray(plant.a(jnp.asarray(u)))), (lambda u: np.asarray(plant.b(jnp.asarray(u))))
    expected = oracle.fading_least_squares(a, b, np.asarray(plant.c()), theta, dt, S0, us, ys, X0)
    observer = StepLyapunov(plant, theta, dt, S0, integrators.RK4(40))
    ours = jaxobs.observe(observer, np.arange(count) * dt, ys, us, xhat0=X0)
    # Two samples at least fix the state; then only the arithmetic differs.
    np.testing.assert_allclose(ours.xhat, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("n", [2, 4])
def test_on_a_chain_it_is_the_tracker(n):
    mu, dt, start = 5.0, 0.05, 0.3
    ts = np.arange(40) * dt
    ys = np.sin(3 * ts)
    chain = plants.IntegratorChain(n)
    discrete = jaxobs.observe(DiscreteTracker(n, 0, mu, dt, start), ts, ys, xhat0=np.ones(n))
    ours = jaxobs.observe(StepLyapunov(chain, mu, dt, start), ts, ys, xhat0=np.ones(n))
    scale = mu ** np.arange(n)
    np.testing.assert_allclose(ours.xhat / scale, discrete.xhat / scale, rtol=0, atol=1e-9)
    x0 = np.ones(n)
    flows = [
        jaxobs.simulate(chain, one, x0=x0, xhat0=0 * x0, ts=np.arange(0, 2, 0.002)).xhat
        for one in (Tracker(n, 0, mu, start), Lyapunov(chain, mu, start))
    ]
    np.testing.assert_allclose(flows[0] / scale, flows[1] / scale, rtol=0, atol=1e-7)


def test_its_steady_gain_is_gauthiers():
    mu, n = 3.0, 4
    chain = plants.IntegratorChain(n)
    s = jnp.asarray([[(-1.0) ** (i + j) * np.prod(np.arange(1, i + j + 1)) / (np.prod(np.arange(1, i + 1)) * np.prod(
        np.arange(1, j + 1))) / mu ** (i + j + 1) for j in range(n)] for i in range(n)])  # fmt: skip
    observer = Lyapunov(chain, mu, 1.0)
    u, zero = jnp.zeros(0), jnp.zeros(n)
    assert np.max(np.abs(observer.flow(jnp.zeros(()), (zero, s), u, jnp.zeros(1))[1])) < 1e-12
    np.testing.assert_allclose(observer.gain(s, u)[:, 0], HighGain(chain, jaxobs.hurwitz.binomial(n), mu).gain(), rtol=1e-10)


def test_the_step_observer_tends_to_the_flow_observer():
    ts = np.arange(0, 2, 0.01)
    us = np.stack([field(t) for t in ts])
    errors = []
    for dt in (0.01, 0.005):
        grid = np.arange(0, 2, dt)
        _, expected, _ = oracle.observer_25(motor_a, C, motor_g, 3.0, S0, field, X0, XHAT0, grid)
        plain, _, _ = oracle.observer_25(motor_a, C, motor_g, 3.0, S0, field, X0, XHAT0, grid)
        us = np.stack([field(t + dt / 2) for t in grid])  # held at the middle: second order in the plant's map
        ours = jaxobs.observe(StepLyapunov(MOTOR, 3.0, dt, S0), grid, plain[:, 0], us, xhat0=XHAT0)
        errors.append(np.max(np.abs(ours.xhat - expected)[grid > 0.5]))
    assert errors[1] < 0.6 * errors[0] < 0.02


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_root_outlives_gaps_and_grading(dtype):
    """A gap of 60 / theta, where S_22 falls by e^-60, then sight again: finite throughout, the error gone."""
    dt, theta = 0.1, 20.0
    ts = np.arange(0, 9, dt)
    us = np.where((ts > 3) & (ts < 6), 0.0, 1.0)[:, None]
    x2 = 0.7
    y = np.concatenate([[0.0], np.cumsum(us[:-1, 0] * x2 * dt)])
    observer = jaxobs.astype(StepLyapunov(plants.GatedChain(), theta, dt, 1.0), dtype)
    run = jaxobs.observe(observer, ts, y.astype(dtype), us.astype(dtype), xhat0=np.zeros(2, dtype))
    assert np.all(np.isfinite(run.xhat))
    assert abs(run.xhat[-1, 1] - x2) < (1e-3 if dtype == np.float32 else 1e-9)
    chain = jaxobs.astype(StepLyapunov(plants.IntegratorChain(4), 200.0, 0.01, 1.0), dtype)
    s = np.arange(0, 1, 0.01)
    smooth = jaxobs.observe(chain, s, (s**2).astype(dtype), xhat0=np.zeros(4, dtype))
    assert np.allclose(smooth.xhat[-1, :3], [0.99**2, 1.98, 2.0], rtol=0.05 if dtype == np.float32 else 1e-6)


def test_triangularise_is_exact_in_graded_columns():
    rng = np.random.default_rng(1)
    rows, scale = rng.normal(size=(6, 4)), 10.0 ** np.array([0, -40, 30, -80])
    r = linalg.triangularise(jnp.asarray(rows))
    assert np.all(np.diag(r) > 0)
    assert np.all(np.tril(r, -1) == 0)
    np.testing.assert_allclose(r.T @ r, rows.T @ rows, atol=1e-13)
    np.testing.assert_allclose(linalg.triangularise(jnp.asarray(rows * scale)) / scale, r, atol=1e-13)
    single = linalg.triangularise(jnp.asarray(rows, jnp.float32))
    assert single.dtype == jnp.float32


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Lyapunov(MOTOR, 3.0, np.diag([1.0, 0.0, 1.0])), ("Lyapunov.start", "definite", "smallest eigenvalue")),
        (lambda: Lyapunov(MOTOR, 3.0, -1.0), ("Lyapunov.start", "positive definite")),
        (lambda: Lyapunov(MOTOR, 3.0, np.eye(3) + np.eye(3, k=1)), ("Lyapunov.start", "symmetric")),
        (lambda: StepLyapunov(MOTOR, 3.0, 0.1, np.diag([1.0, 1.0, -1e-9])), ("StepLyapunov.start", "positive definite")),
        (lambda: Lyapunov(MOTOR, 3.0, np.eye(2)), ("Lyapunov.start", "(2, 2)", "(3, 3)")),
        (lambda: Lyapunov(plants.Lorenz(), 3.0), ("Lyapunov.model", "Lorenz", "state-affine form")),
        (lambda: Lyapunov(MOTOR, 0.0), ("Lyapunov.theta", "positive")),
        (lambda: StepLyapunov(MOTOR, 3.0, 0.0), ("StepLyapunov.dt", "positive")),
        (
            lambda: observers.Sampled(Lyapunov(MOTOR, 30.0), integrators.RK4(), 0.1),
            ("rate * step = 3", "less than 2.785", "substeps=2", "StepLyapunov"),
        ),
        (
            lambda: jaxobs.simulate(
                MOTOR, Lyapunov(MOTOR, 30.0), x0=X0, xhat0=X0, ts=np.arange(0, 1, 0.1), signal=signals.Zero(2),
                integrator=integrators.Euler(1),
            ),
            ("simulate.integrator", "Euler", "less than 2.0"),
        ),
        (
            lambda: jaxobs.observe(Lyapunov(MOTOR, 30.0), np.arange(0, 1, 0.1), np.zeros(10), np.zeros((10, 2)), xhat0=X0),
            ("rate * step = 3", "2.785"),
        ),
    ],
)  # fmt: skip
def test_refused(call, words):
    with pytest.raises(ValueError, match="given") as error:
        call()
    assert all(word in str(error.value) for word in words), str(error.value)


def test_substeps_and_adaptive_steps_are_let_through():
    observers.Sampled(Lyapunov(MOTOR, 30.0), integrators.RK4(2), 0.1)
    observers.Sampled(Lyapunov(MOTOR, 30.0), integrators.Adaptive(), 0.1)
