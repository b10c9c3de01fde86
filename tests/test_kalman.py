"""The Kalman observers against textbook filters, their steady states against SciPy's Riccati solvers, and what they refuse."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from oracles import kalman as oracle

import jaxobs
from jaxobs._module import param
from jaxobs.integrators import RK4, Adaptive, Exponential
from jaxobs.observers import ContinuousDiscreteKalman, ContinuousKalman, DiscreteKalman
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant, IntegratorChain, Pendulum, SampledChain, VanDerPol

A = np.array([[0.0, 1.0, 0.0], [-2.0, -0.3, 1.0], [0.1, 0.0, -0.8]])
E = np.array([[0.0, 0.1], [1.0, 0.0], [0.0, 0.7]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 0.4, 1.0]])
Q = np.array([[0.5, 0.1], [0.1, 0.3]])
R = np.array([[0.2, 0.05], [0.05, 0.1]])
START = np.array([[1.0, 0.2, 0.0], [0.2, 2.0, -0.3], [0.0, -0.3, 0.5]])
G = E @ np.linalg.cholesky(Q)
DT = 0.1
YS = np.random.default_rng(0).normal(size=(60, 2))


class Linear(AbstractFlowPlant):
    """x' = A x, y = C x, with A, E, C as above."""

    a: jax.Array = param()
    n, m, p = 3, 0, 2

    def flow(self, t, x, u):
        return self.a @ x

    def h(self, x, u):
        return jnp.asarray(C, x.dtype) @ x

    def disturbance_matrix(self):
        return jnp.asarray(E, self.a.dtype)


class LinearStep(AbstractStepPlant):
    """x+ = A x, y = C x."""

    a: jax.Array = param()
    n, m, p = 3, 0, 2

    def step(self, k, x, u):
        return self.a @ x

    def h(self, x, u):
        return jnp.asarray(C, x.dtype) @ x

    def disturbance_matrix(self):
        return jnp.asarray(E, self.a.dtype)


@jax.jit
def path(observer, xhat0, ys):
    """Estimates with y in hand, and the covariances before it, of a step observer without inputs."""

    def body(z, sample):
        k, y = sample
        u = jnp.zeros((0,), y.dtype)
        return observer.step(k, z, u, y), (observer.estimate(k, z, u, y), z[1].T @ z[1])

    return jax.lax.scan(body, observer.init(xhat0), (jnp.arange(len(ys)), ys))[1]


def test_discrete_is_the_kalman_filter():
    a = scipy.linalg.expm(A * DT)
    xhat0 = np.array([1.0, -1.0, 0.5])
    xhat, before = path(DiscreteKalman(LinearStep(a), Q, R, START), jnp.asarray(xhat0), YS)
    expected, after = oracle.linear(a, G @ G.T, C, R, START, xhat0, YS)
    assert np.allclose(xhat, expected, rtol=0, atol=1e-13)
    assert np.allclose(before[0], START, rtol=1e-14)
    assert np.allclose(before[1:], a @ after[:-1] @ a.T + G @ G.T, rtol=0, atol=1e-13)


def test_discrete_steady_state_solves_the_riccati_equation():
    a = scipy.linalg.expm(A * DT)
    _, before = path(DiscreteKalman(LinearStep(a), Q, R, START), jnp.zeros(3), np.zeros((600, 2)))
    assert np.allclose(before[-1], scipy.linalg.solve_discrete_are(a.T, C.T, G @ G.T, R), rtol=1e-10)


def test_continuous_discrete_is_the_kalman_filter_of_the_sampled_plant_at_order_four():
    a, w = oracle.held(A, G, DT)
    xhat0 = np.array([1.0, -1.0, 0.5])
    expected, after = oracle.linear(a, w, C, R, START, xhat0, YS)
    expected_before = a @ after[:-1] @ a.T + w
    errors = []
    for substeps in (1, 2, 4):
        observer = ContinuousDiscreteKalman(Linear(A), Q, R, START, DT, RK4(), substeps)
        xhat, before = path(observer, jnp.asarray(xhat0), YS)
        assert np.max(np.abs(xhat - expected)) < 2e-6 / substeps**4
        errors.append(np.max(np.abs(before[1:] - expected_before)))
    assert np.all(np.abs(np.log2(np.array(errors[:-1]) / errors[1:]) - 4) < 0.2)


def test_simpson_is_exact_for_two_integrators():
    f, g = np.eye(2, k=1), np.array([[0.0], [0.6]])
    a, w = oracle.held(f, g, 0.5)
    observer = ContinuousDiscreteKalman(IntegratorChain(2), [[0.36]], [[0.1]], np.eye(2), 0.5)
    xhat, before = path(observer, jnp.zeros(2), YS[:, :1])
    expected, after = oracle.linear(a, w, np.eye(1, 2), np.array([[0.1]]), np.eye(2), np.zeros(2), YS[:, :1])
    assert np.allclose(xhat, expected, rtol=0, atol=1e-13)
    assert np.allclose(before[1:], a @ after[:-1] @ a.T + w, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "integrator", [Exponential(substeps=8), pytest.param(Adaptive(rtol=1e-10, atol=1e-12), marks=pytest.mark.slow)]
)
def test_integrators_agree(integrator):
    ts, ys = DT * np.arange(20), np.sin(0.3 * np.arange(20))

    def estimate(integrator):
        observer = ContinuousDiscreteKalman(Pendulum(), [[0.4]], [[0.01]], np.eye(2), DT, integrator)
        return jaxobs.observe(observer, ts, ys, np.cos(ts)[:, None], xhat0=np.zeros(2)).xhat

    assert np.allclose(estimate(integrator), estimate(RK4(substeps=8)), rtol=0, atol=1e-6)


def van_der_pol(x):
    plant = VanDerPol(1.3)
    return np.asarray(plant.flow(0.0, jnp.asarray(x), jnp.zeros(plant.m)))


def test_continuous_discrete_is_the_extended_filter():
    def flow(x):
        return np.array([x[1], 1.3 * (1 - x[0] ** 2) * x[1] - x[0]])

    assert np.allclose(flow(np.array([0.3, -0.7])), van_der_pol(np.array([0.3, -0.7])), rtol=1e-14)
    g, ys = np.array([[0.0], [0.5]]), 2 * np.sin(0.1 * np.arange(25))[:, None]
    xhat0, start, r = np.array([0.5, 0.0]), np.diag([0.5, 2.0]), np.array([[0.04]])
    expected, _ = oracle.extended(flow, lambda x: x[:1], g, r, start, xhat0, ys, DT)
    observer = ContinuousDiscreteKalman(VanDerPol(1.3), [[0.25]], r, start, DT, RK4(substeps=2), 4)
    assert observer.m == 0
    xhat, _ = path(observer, jnp.asarray(xhat0), ys)
    assert np.allclose(xhat, expected, rtol=0, atol=2e-6)


def test_continuous_root_moves_as_the_riccati_equation_says():
    observer = ContinuousKalman(Linear(A), Q, R, START)
    rng = np.random.default_rng(1)
    s = np.tril(rng.normal(size=(3, 3)))
    p = s @ s.T
    dx, ds = observer.flow(jnp.asarray(0.0), (jnp.ones(3), jnp.asarray(s)), jnp.zeros(0), jnp.ones(2))
    gain = p @ C.T @ np.linalg.inv(R)
    assert np.allclose(dx, A @ np.ones(3) + gain @ (np.ones(2) - C @ np.ones(3)), rtol=1e-12)
    assert np.allclose(ds @ s.T + s @ ds.T, A @ p + p @ A.T + G @ G.T - gain @ R @ gain.T, rtol=0, atol=1e-11)
    assert np.all(np.triu(ds, 1) == 0)


def test_continuous_is_the_extended_kalman_bucy_filter():
    def flow(x):
        return np.array([x[1], 1.3 * (1 - x[0] ** 2) * x[1] - x[0]])

    ts = np.linspace(0, 6, 601)
    start, r = np.diag([0.5, 2.0]), np.array([[0.1]])
    observer = ContinuousKalman(VanDerPol(1.3), [[0.25]], r, start)
    got = jaxobs.simulate(VanDerPol(1.3), observer, x0=[1.0, 0.0], xhat0=[0.2, 0.5], ts=ts).xhat
    expected, _ = oracle.bucy(
        flow, lambda x: x[:1], np.array([[0.0], [0.5]]), r, start, np.array([0.2, 0.5]), np.array([1.0, 0.0]), ts
    )
    assert np.allclose(got, expected, rtol=0, atol=1e-6)


def test_continuous_steady_state_solves_the_riccati_equation():
    observer = ContinuousKalman(Linear(A), Q, R, START)
    z, u, y = observer.init(jnp.zeros(3)), jnp.zeros(0), jnp.zeros(2)
    integrator = RK4()
    field = jaxobs.integrators.Field(lambda t, z: observer.flow(t, z, u, y))
    dt = jnp.asarray(0.05)
    z = jax.jit(lambda z: jax.lax.fori_loop(0, 1500, lambda _, z: integrator.step(field, None, dt, dt, z), z))(z)
    assert np.allclose(z[1] @ z[1].T, scipy.linalg.solve_continuous_are(A.T, C.T, G @ G.T, R), rtol=1e-9)


def test_single_precision_keeps_the_covariance_where_the_plain_form_loses_it():
    dt, r, start = np.float32(0.01), np.float32(1e-2), np.float32(1e6)
    observer = jaxobs.astype(DiscreteKalman(SampledChain(3, 0.01), [[1e-6]], [[1e-2]], 1e6 * np.eye(3)), jnp.float32)
    _, before = path(observer, jnp.zeros(3, jnp.float32), np.zeros((50, 1), np.float32))
    _, exact = path(jaxobs.astype(observer, jnp.float64), jnp.zeros(3), np.zeros((50, 1)))
    a = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]], np.float32)
    g = np.asarray(observer.model.disturbance_matrix(), np.float32) * np.float32(1e-3)
    p, lowest = start * np.eye(3, dtype=np.float32), np.inf
    for _ in range(49):
        k = p[:, :1] / (p[0, 0] + r)
        p = a @ (p - k @ p[:1]) @ a.T + g @ g.T
        lowest = min(lowest, np.linalg.eigvalsh((p + p.T).astype(float) / 2)[0])
    before, exact = np.asarray(before, float), np.asarray(exact)
    scale = np.sqrt(np.outer(np.diag(exact[-1]), np.diag(exact[-1])))
    assert lowest < 0
    assert np.max(np.abs(p - exact[-1]) / scale) > 0.1
    assert np.max(np.abs(before[-1] - exact[-1]) / scale) < 1e-3
    assert np.all(np.linalg.eigvalsh(before / scale) > 0)


def test_a_lost_sample_moves_the_estimate_by_the_model_alone():
    a = scipy.linalg.expm(A * DT)
    observer = DiscreteKalman(LinearStep(a), Q, R, START)
    ys = YS.copy()
    ys[20:30] = np.nan
    ts = DT * np.arange(len(ys))
    xhat = np.asarray(jaxobs.observe(observer, ts, ys, xhat0=np.ones(3)).xhat)
    for k in range(20, 30):
        assert np.allclose(xhat[k], a @ xhat[k - 1], rtol=0, atol=1e-14)
    # The filter that knows of the gap trusts the first sample after it more: this one moves there by its steady gain.
    known, _ = oracle.linear(a, G @ G.T, C, R, START, np.ones(3), ys)
    assert np.allclose(xhat[:30], known[:30], rtol=0, atol=1e-12)
    assert np.linalg.norm(xhat[30] - xhat[29]) < np.linalg.norm(known[30] - known[29])


def test_errors_have_the_covariance_that_is_claimed():
    """At every time, over many runs of the linear plant, the mean of e'P^-1 e is n."""
    a = scipy.linalg.expm(A * DT)
    observer = DiscreteKalman(LinearStep(a), Q, R, START)
    rng, runs, count = np.random.default_rng(2), 400, 20
    x = rng.normal(size=(runs, 3)) @ np.linalg.cholesky(START).T
    xs, ys = [], []
    for _ in range(count):
        xs.append(x)
        ys.append(x @ C.T + rng.normal(size=(runs, 2)) @ np.linalg.cholesky(R).T)
        x = x @ a.T + rng.normal(size=(runs, 2)) @ G.T
    xhat = jax.vmap(lambda y: path(observer, jnp.zeros(3), y)[0])(jnp.stack(ys, axis=1))
    _, after = oracle.linear(a, G @ G.T, C, R, START, np.zeros(3), np.zeros((count, 2)))
    error = np.stack(xs, axis=1) - xhat
    nees = np.einsum("rki,kij,rkj->rk", error, np.linalg.inv(after), error)
    assert abs(np.mean(nees) - 3) < 4 * np.sqrt(2 * 3 / (runs * count)) * 3  # samples of one run are correlated: factor 3


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"q": np.eye(3)}, r"\.q: given shape \(3, 3\); expected shape \(2, 2\).*disturbance_matrix"),
        ({"r": 0.1}, r"\.r: given shape \(\); expected shape \(2, 2\)"),
        ({"start": np.diag([1.0, 0.0, 1.0])}, r"\.start: given .* smallest eigenvalue 0; expected a positive definite"),
        ({"r": [[1.0, 2.0], [2.0, 1.0]]}, r"\.r: given .* smallest eigenvalue -1; expected a positive definite"),
        ({"q": [[1.0, 0.5], [0.0, 1.0]]}, r"\.q: given .*expected a symmetric matrix"),
        ({"q": [[1.0, np.nan], [np.nan, 1.0]]}, r"\.q: given [\s\S]*expected finite numbers"),
    ],
)
@pytest.mark.parametrize("kind", [ContinuousKalman, DiscreteKalman])
def test_covariances_must_be_positive_definite(kind, changed, message):
    plant = Linear(A) if kind is ContinuousKalman else LinearStep(A)
    with pytest.raises(ValueError, match=message):
        kind(**({"model": plant, "q": Q, "r": R, "start": START} | changed))


def test_a_start_too_fast_for_explicit_steps_is_refused_and_the_steps_that_are_asked_for_do():
    """Stiff at first, start / r = 1e4 /s: with steps that are small enough it gives what the sampled form gives."""
    plant, ts = Pendulum(), 0.01 * np.arange(400)
    setting = {"x0": [1.0, 0.0], "xhat0": [0.0, 0.0], "ts": ts, "signal": jaxobs.signals.Sine(0.5, 1.0, 0.0, 0.0)}
    observer = ContinuousKalman(plant, [[0.1]], [[1e-4]], np.eye(2))
    assert np.isclose(observer.fastest_rate, 1.5e4, rtol=1e-12)
    with pytest.raises(ValueError, match=r"simulate\.integrator: given RK4 .*rate \* step = 150; .*Take substeps=54 or more"):
        jaxobs.simulate(plant, observer, **setting)
    fine = jaxobs.simulate(plant, observer, **setting, integrator=RK4(substeps=54)).xhat
    sampled = jaxobs.simulate(plant, ContinuousDiscreteKalman(plant, [[0.1]], [[1e-2]], np.eye(2), 0.01), **setting).xhat
    assert np.max(np.abs(fine - sampled)[100:]) < 2e-3  # the samples lag by half a period


@pytest.mark.usefixtures("as_users_have_it")
def test_the_other_kind_of_plant_is_refused_with_the_observer_to_take():
    with pytest.raises(ValueError, match="take DiscreteKalman"):
        ContinuousKalman(LinearStep(A), Q, R, START)
    with pytest.raises(ValueError, match="take DiscreteKalman"):
        ContinuousDiscreteKalman(LinearStep(A), Q, R, START, DT)
    with pytest.raises(ValueError, match="take ContinuousDiscreteKalman"):
        DiscreteKalman(Linear(A), Q, R, START)
    with pytest.raises(ValueError, match="dt: given"):
        ContinuousDiscreteKalman(Linear(A), Q, R, START, -DT)
    with pytest.raises(ValueError, match="substeps: given 0"):
        ContinuousDiscreteKalman(Linear(A), Q, R, START, DT, RK4(), 0)
