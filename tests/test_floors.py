"""Floors against SciPy's solvers, iterated filters, closed forms and filters that run; what has no floor is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from oracles import floors as oracle
from oracles import kalman

import jaxobs
from jaxobs._module import param
from jaxobs.noise import Bias, Gaussian, Uniform
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant, IntegratorChain, Pendulum
from jaxobs.tuning.floors import disturbance_covariance, kalman_bound
from jaxobs.tuning.posterior_bound import posterior_cramer_rao

pytestmark = pytest.mark.usefixtures("hardly_optimised")

A = np.array([[0.0, 1.0, 0.0], [-2.0, -0.3, 1.0], [0.1, 0.0, -0.8]])
C = np.array([[1.0, 0.0, 0.0], [0.0, 0.4, 1.0]])
E = np.array([[0.0, 0.1], [1.0, 0.0], [0.0, 0.7]])
Q = E @ np.array([[0.5, 0.1], [0.1, 0.3]]) @ E.T
R = np.array([[0.2, 0.05], [0.05, 0.1]])
DOUBLE, ANGLE, LAST = np.eye(2, k=1), np.eye(1, 2), np.array([[0.0], [1.0]])
DT = 0.05
SEEDS = jaxobs.Seeds(jax.random.key(3), 60)


class Linear(AbstractFlowPlant):
    """x' = A x, y = C x, with A, C, E as above."""

    scale: jax.Array = param(default=1.0)
    n, m, p = 3, 0, 2

    def flow(self, t, x, u):
        return jnp.asarray(A, x.dtype) @ x

    def h(self, x, u):
        return jnp.asarray(C, x.dtype) @ x

    def disturbance_matrix(self):
        return jnp.asarray(E, self.scale.dtype)


class Sine(AbstractStepPlant):
    """x+ = a sin(x) + b x^3, y = x."""

    a: jax.Array = param(default=1.3)
    b: jax.Array = param(default=0.0)
    n, m, p = 1, 0, 1

    def step(self, k, x, u):
        return self.a * jnp.sin(x) + self.b * x**3

    def h(self, x, u):
        return x

    def disturbance_matrix(self):
        return jnp.ones((1, 1), self.a.dtype)


class Stepped(AbstractStepPlant):
    """The pendulum by RK4 with w_k = root d_k added after the step, d_k ~ N(0, I)."""

    plant: Pendulum
    root: jax.Array = param()
    dt: jax.Array = param(default=DT)
    n, m, p = 2, 1, 1

    def step(self, k, x, u):
        field = jaxobs.integrators.Field(lambda t, x: self.plant.flow(t, x, u))
        return jaxobs.integrators.RK4().step(field, None, jnp.zeros_like(self.dt), self.dt, x)

    def h(self, x, u):
        return self.plant.h(x, u)

    def disturbance_matrix(self):
        return self.root


def test_continuous_bound_in_closed_form():
    """Two integrators, intensities q and r: S_11 = r sqrt(2) w, S_22 = r sqrt(2) w^3 with w^4 = q / r, Butterworth poles."""
    q, r = 3.0, 0.02
    w = (q / r) ** 0.25
    found = kalman_bound(DOUBLE, ANGLE, q * LAST @ LAST.T, [[r]])
    assert found.rmse == pytest.approx(np.sqrt(r * np.sqrt(2) * np.array([w, w**3])), rel=1e-10)
    assert found.gain[:, 0] == pytest.approx([np.sqrt(2) * w, w**2], rel=1e-10)
    assert np.abs(found.poles) == pytest.approx([w, w], rel=1e-7)
    assert kalman_bound(DOUBLE, ANGLE, q * LAST @ LAST.T, [[r]], weight=[[0.0, 2.0]]).level == pytest.approx(2 * found.rmse[1])


def test_continuous_bound_is_the_least_of_all_gains():
    found = kalman_bound(A, C, Q, R)
    rng = np.random.default_rng(0)
    for size in (1e-3, 1e-2, 0.1):
        gain = found.gain + size * rng.normal(size=found.gain.shape)
        s = scipy.linalg.solve_continuous_lyapunov(A - gain @ C, -Q - gain @ R @ gain.T)
        assert np.min(np.linalg.eigvalsh(s - found.covariance)) > 0


def test_sampled_bound_is_the_limit_of_the_filter():
    for q in (Q, 2 * np.eye(3)):
        found = kalman_bound(A, C, q, R, dt=DT)
        expected = oracle.iterated(A, C, q, R, DT, 800, np.eye(3))
        assert found.covariance == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert np.max(np.abs(found.poles)) < 1


def test_samples_ever_denser_approach_the_continuous_bound():
    limit = kalman_bound(DOUBLE, ANGLE, LAST @ LAST.T, [[0.02]]).rmse
    gaps = []
    for dt in (0.04, 0.02, 0.01):
        white = kalman_bound(DOUBLE, ANGLE, LAST @ LAST.T, [[0.02 / dt]], dt=dt).rmse
        by_step = kalman_bound(DOUBLE, ANGLE, LAST @ LAST.T / dt, [[0.02 / dt]], dt=dt, held=True).rmse
        assert np.all(by_step <= white)
        gaps.append([np.max(np.abs(white / limit - 1)), np.max(1 - by_step / white)])
    first, second = np.log2(np.array(gaps[:-1]) / gaps[1:]).T
    assert first == pytest.approx(1, abs=0.1), "the measurement is that of the sample: of order dt"
    assert second == pytest.approx(2, abs=0.1), "holding the disturbance matters to the second order"


@pytest.mark.slow
def test_the_bound_is_met_in_a_study():
    """Two integrators, a held disturbance: the filter of the bound, run on samples, has its RMSE, and no gain near less."""
    dt, sigma, level = 0.1, 0.2, 2.0
    found = kalman_bound(DOUBLE, ANGLE, level**2 * LAST @ LAST.T, [[sigma**2]], dt=dt, held=True)
    plant = IntegratorChain(2)
    model = jaxobs.plants.Discretised(plant, jaxobs.integrators.RK4(), dt)
    best = jaxobs.observers.CurrentLuenberger(model, found.gain)
    family = jaxobs.grid(best, gain=np.array([1.0, 0.7, 1.4])[:, None, None] * found.gain)

    def rmse(observer, key):
        return jaxobs.score(
            plant, observer, ts=dt * np.arange(400), x0=[0.0, 0.0], xhat0=[0.0, 0.0], key=key, noise=Gaussian(sigma),
            disturbance=Gaussian(level), metrics={"rmse": jaxobs.metrics.RMSE(5.0)},
        )["rmse"]  # fmt: skip

    squares = np.asarray(jaxobs.over(family, rmse)(jax.random.split(jax.random.key(0), 64))) ** 2
    mean, error = squares.mean(axis=1), squares.std(axis=1, ddof=1) / 8
    assert np.all(np.abs(mean[0] - found.rmse**2) < 3 * error[0])
    assert np.all(error[0] < 0.03 * mean[0])
    assert np.all(mean[1:] > mean[0])


def test_a_flow_observer_between_held_noises_has_no_floor():
    dt, sigma, level = 0.01, 0.1, 1.0
    floor = kalman_bound(DOUBLE, ANGLE, level**2 * LAST @ LAST.T, [[sigma**2]], dt=dt, held=True).rmse
    aliased = np.array([[1e-3], [(2 * np.pi / dt) ** 2]])
    error = np.sqrt(np.diagonal(oracle.held_noise(DOUBLE, ANGLE, LAST, aliased, dt, sigma, level)))
    assert np.all(error[:1] < 0.1 * floor[:1])
    ordinary = [
        np.sqrt(np.diagonal(oracle.held_noise(DOUBLE, ANGLE, LAST, np.array([[2 * z * w], [w * w]]), dt, sigma, level)))
        for w in np.geomspace(0.3, 2 / dt, 30)
        for z in (0.3, 0.5, 0.7, 1.0)
    ]
    assert np.all(np.min(ordinary, axis=0) > floor)
    assert np.all(np.min(ordinary, axis=0) < 1.03 * floor)


def test_disturbance_covariance_is_that_of_the_step():
    """Held: sigma^2 Gamma Gamma' of e^{A dt}; white: Van Loan's; both against quadrature, and a step plant's E."""
    noise = Gaussian(0.7)
    f, white = kalman.held(A, 0.7 * np.sqrt(0.01) * E, 0.01)
    gamma = np.linalg.solve(A, f - np.eye(3)) @ E
    finely = disturbance_covariance(Linear(), noise, 0.01, integrator=jaxobs.integrators.RK4(substeps=8))
    assert finely == pytest.approx(0.49 * gamma @ gamma.T, rel=1e-9, abs=1e-18)
    assert disturbance_covariance(Linear(), noise, 0.01, held=False) == pytest.approx(white, rel=1e-9, abs=1e-18)
    assert disturbance_covariance(Sine(), Uniform(3.0)) == pytest.approx(3.0)
    x, u, dt = np.array([0.4, -1.0]), np.array([0.3]), 0.1

    def end(d):
        """One step of RK4."""

        def flow(x):
            return np.array([x[1], np.sin(x[0]) + u[0] * np.cos(x[0]) + d])

        k1 = flow(x)
        k2 = flow(x + dt / 2 * k1)
        k3 = flow(x + dt / 2 * k2)
        return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + flow(x + dt * k3))

    slope = (end(1e-4) - end(-1e-4)) / 2e-4
    found = disturbance_covariance(Pendulum(), noise, dt, x=x, u=u)
    assert found == pytest.approx(0.49 * np.outer(slope, slope), rel=1e-7)


@pytest.mark.slow
def test_disturbance_covariance_of_a_split_flow_and_of_white_noise_at_a_point():
    noise, x, u, dt = Gaussian(0.7), np.array([0.4, -1.0]), np.array([0.3]), 0.1
    exponential = disturbance_covariance(IntegratorChain(2), noise, 0.3, integrator=jaxobs.integrators.Exponential())
    assert exponential == pytest.approx(0.49 * np.array([[0.045**2, 0.045 * 0.3], [0.045 * 0.3, 0.09]]), rel=1e-12)
    found = disturbance_covariance(Pendulum(), noise, dt, x=x, u=u)
    assert np.min(np.linalg.eigvalsh(disturbance_covariance(Pendulum(), noise, dt, held=False) - found)) > -1e-7


def drawn(keys, count, size):
    """The normal numbers (keys, count, size) of the paths: those of x_0 first, then those of each step."""

    def one(key, k):
        return jax.random.normal(jax.random.fold_in(key, k), (size,))

    return np.asarray(jax.jit(jax.vmap(lambda key: jax.vmap(lambda k: one(key, k))(jnp.arange(count))))(keys))


def scalar_bound(plant=None, seed=5, m=0.5, p0=0.6, r=0.2, q=0.3, count=2000):
    """Of one shape, so that it is compiled once."""
    return posterior_cramer_rao(
        Sine() if plant is None else plant, ts=np.arange(5.0), x0_mean=[m], x0_covariance=[[p0]], noise_covariance=[[r]],
        process_covariance=[[q]], keys=jax.random.split(jax.random.key(seed), count),
    )  # fmt: skip


def linear_bound(q, p0, count=300):
    return posterior_cramer_rao(
        Linear(), ts=DT * np.arange(count), x0_mean=np.ones(3), x0_covariance=p0, noise_covariance=R, process_covariance=q,
        keys=SEEDS,
    )  # fmt: skip


def test_of_a_linear_plant_it_is_the_kalman_filter():
    """Whatever the ranks: of full-rank noise, of held noise of rank 2, of none at all, from a start of rank 1."""
    f = np.eye(3) + sum(np.linalg.matrix_power(A * DT, k) / np.prod(range(1, k + 1)) for k in range(1, 5))  # RK4
    full, p0 = kalman.held(A, np.eye(3), DT)[1], np.diag([1.0, 0.3, 2.0])
    for q, start in ((full, p0), (disturbance_covariance(Linear(), Gaussian(2.0), DT), np.outer(p0[0], p0[0])), (0 * p0, p0)):
        found = linear_bound(q, start)
        expected = kalman.linear(f, q, C, R, start, np.zeros(3), np.zeros((300, 2)))[1]
        assert found.covariance == pytest.approx(expected, rel=1e-10, abs=1e-13)
        assert np.max(found.standard_error) < 1e-7  # of variances that rounding leaves at 1e-16
    steady = kalman_bound(A, C, 4 * E @ E.T, R, dt=DT, held=True)
    late = linear_bound(disturbance_covariance(Linear(), Gaussian(2.0), DT), p0)
    assert late.over(14.0)[0] == pytest.approx(steady.rmse, rel=1e-5)


def test_one_step_in_closed_form():
    """x_0 ~ N(m, s^2), x_1 = a sin x_0 + w: E F = a e^{-s^2/2} cos m, E F^2 = a^2 (1 + e^{-2 s^2} cos 2m) / 2."""
    m, s, a, q, r = 0.4, 0.5, 1.3, 0.2, 0.3
    found = scalar_bound(Sine(a), 1, m, s * s, r, q)
    mean, square = a * np.exp(-s * s / 2) * np.cos(m), a**2 * (1 + np.exp(-2 * s * s) * np.cos(2 * m)) / 2
    first = 1 / (1 / s**2 + 1 / r)
    second = 1 / (1 / (q + mean**2 / (1 / first + (square - mean**2) / q)) + 1 / r)
    assert found.rmse[0, 0] == pytest.approx(np.sqrt(first), rel=1e-12)
    with pytest.raises(ValueError, match="after: given 9"):
        found.over(9.0)
    assert abs(found.rmse[1, 0] - np.sqrt(second)) < 4 * found.standard_error[1, 0] < 0.02 * np.sqrt(second)


def test_the_recursion_inverts_the_information_of_the_whole_path():
    """Jacobians of the same paths, drawn here by hand, in one matrix for all times; and the printed recursion of the source."""
    q, r, p0, count = np.array([[0.3]]), np.array([[0.2]]), np.array([[0.6]]), 2000
    found, keys = scalar_bound(), jax.random.split(jax.random.key(5), count)
    draws = drawn(keys, 5, 1)
    paths = [0.5 + np.sqrt(p0[0]) * draws[:, 0]]
    for k in range(4):
        paths.append(1.3 * np.sin(paths[-1]) + np.sqrt(q[0]) * draws[:, k + 1])
    fs = 1.3 * np.cos(np.stack(paths[:-1], axis=1))[..., None]
    j = 1 / p0 + 1 / r
    for k in range(5):
        whole = oracle.information(fs[:, :k], np.ones((count, k + 1, 1, 1)), q, r, p0)
        assert found.covariance[k] == pytest.approx(whole, rel=1e-10)
        assert found.covariance[k] == pytest.approx(1 / j, rel=1e-10)
        if k < 4:
            d11, d12 = np.mean(fs[:, k] ** 2) / q, -np.mean(fs[:, k]) / q
            j = 1 / q + 1 / r - d12 * d12 / (j + d11)


def test_standard_errors_are_those_of_repetition():
    runs = [scalar_bound(seed=i) for i in range(60)]
    values = np.array([run.rmse[-1, 0] for run in runs])
    predicted = np.sqrt(np.mean([run.standard_error[-1, 0] ** 2 for run in runs]))
    assert np.std(values, ddof=1) == pytest.approx(predicted, rel=0.3)  # the ratio itself has a standard error of 0.1
    over = np.array([run.over(3.0) for run in runs])[..., 0]
    assert np.std(over[:, 0], ddof=1) == pytest.approx(np.sqrt(np.mean(over[:, 1] ** 2)), rel=0.3)


@pytest.mark.slow
def test_a_matched_nonlinearity_needs_no_full_rank():
    """Euler's pendulum varies only where the noise enters: rank 1 is the limit of rank 2."""
    q, count, steps = np.diag([0.0, DT**2]), 40, 12
    keys = jax.random.split(jax.random.key(5), count)
    around = {"ts": DT * np.arange(steps), "x0_mean": [1.0, 0.0], "x0_covariance": 0.2 * np.eye(2), "keys": keys}
    around |= {"noise_covariance": [[0.01]], "process_covariance": q, "signal": jaxobs.signals.Zero(1)}
    found = posterior_cramer_rao(Pendulum(), integrator=jaxobs.integrators.Euler(), **around)
    draws = drawn(keys, steps, 2)
    x, slopes = [1.0, 0.0] + np.sqrt(0.2) * draws[:, 0], []
    for k in range(1, steps):
        slopes.append(np.eye(2) + DT * np.array([[[0.0, 1.0], [np.cos(one), 0.0]] for one in x[:, 0]]))
        x = x + DT * np.stack([x[:, 1], np.sin(x[:, 0])], axis=1) + DT * draws[:, k] * [0.0, 1.0]
    hs = np.tile(ANGLE, (count, steps, 1, 1))
    near = [
        oracle.information(np.stack(slopes, axis=1), hs, q + np.diag([eps, 0.0]), np.array([[0.01]]), 0.2 * np.eye(2))
        for eps in (1e-6, 1e-8)
    ]
    gaps = [np.max(np.abs(found.covariance[-1] / one - 1)) for one in near]
    assert gaps[0] < 1e-2
    assert gaps[1] < 2e-2 * gaps[0]


@pytest.mark.slow
def test_the_extended_kalman_filter_stays_above():
    """A strongly driven pendulum: the extended filter is above the bound at all times, and late by less than a tenth."""
    sigma, count, p0 = 0.3, 60, np.diag([0.3, 0.3])
    q = disturbance_covariance(Pendulum(), Gaussian(6.0), DT, held=False)
    ts, keys = DT * np.arange(count), jax.random.split(jax.random.key(9), 1500)
    around = {"ts": ts, "x0_mean": [2.0, 0.0], "x0_covariance": p0, "noise_covariance": [[sigma**2]], "keys": keys[:600]}
    around |= {"signal": jaxobs.signals.Sine(0.5)}
    bound = posterior_cramer_rao(Pendulum(), process_covariance=q, **around)
    # Held noise has rank 1, and RK4's Jacobian varies outside its range.
    with pytest.raises(ValueError, match=r"process_covariance: given rank 1 of 2, .*held=False"):
        posterior_cramer_rao(Pendulum(), process_covariance=disturbance_covariance(Pendulum(), Gaussian(6.0), DT), **around)
    plant = Stepped(Pendulum(), np.linalg.cholesky(q))
    filtering = jaxobs.observers.DiscreteKalman(plant, np.eye(2), [[sigma**2]], p0)

    @jax.jit
    def error(key):
        first, rest = jax.random.split(key)
        x0 = jnp.asarray([2.0, 0.0]) + jnp.sqrt(0.3) * jax.random.normal(first, (2,))
        run = jaxobs.simulate(
            plant, filtering, x0=x0, xhat0=jnp.asarray([2.0, 0.0]), ts=ts, noise=Gaussian(sigma), disturbance=Gaussian(1.0),
            signal=jaxobs.signals.Sine(0.5), key=rest,
        )  # fmt: skip
        return (run.xhat - run.x) ** 2

    squares = np.asarray(jax.lax.map(error, keys, batch_size=250))
    rmse = np.sqrt(np.mean(squares, axis=0))
    spread = np.std(squares, axis=0, ddof=1) / np.sqrt(len(keys)) / (2 * rmse)
    assert np.all(rmse > bound.rmse - 3.5 * np.hypot(spread, bound.standard_error))
    late = np.sqrt(np.mean(squares[:, 20:], axis=(0, 1)))
    floor, _ = bound.over(float(ts[20]))
    assert np.all(late < 1.1 * floor)
    assert np.all(late > 0.98 * floor)


def test_what_has_no_floor_is_refused(as_users_have_it):
    q, r = np.diag([0.0, 1.0]), [[0.1]]
    with pytest.raises(ValueError, match=r"c: given outputs that do not see the mode 0.*detectable"):
        kalman_bound(DOUBLE, [[0.0, 1.0]], np.eye(2), r)
    with pytest.raises(ValueError, match="c: given outputs that do not see the mode 1"):
        kalman_bound(DOUBLE, [[0.0, 1.0]], np.eye(2), r, dt=0.1)
    for more in ({}, {"dt": 0.1}):
        with pytest.raises(ValueError, match=r"process: .*falls to zero with time"):
            kalman_bound(DOUBLE, ANGLE, 0 * q, r, **more)
    with pytest.raises(ValueError, match=r"noise: .*positive definite"):
        kalman_bound(DOUBLE, ANGLE, q, [[0.0]])
    with pytest.raises(ValueError, match=r"process: .*semidefinite"):
        kalman_bound(DOUBLE, ANGLE, -q, r)
    with pytest.raises(ValueError, match="held: given True"):
        kalman_bound(DOUBLE, ANGLE, q, r, held=True)
    with pytest.raises(ValueError, match="dt: given -1"):
        kalman_bound(DOUBLE, ANGLE, q, r, dt=-1.0)
    with pytest.raises(ValueError, match="weight: given shape"):
        kalman_bound(DOUBLE, ANGLE, q, r, weight=[1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="disturbance: given Bias; expected Gaussian or Uniform"):
        disturbance_covariance(Pendulum(), Bias(1.0), 0.1)
    with pytest.raises(ValueError, match="dt: given None"):
        disturbance_covariance(Pendulum(), Gaussian(1.0))


def test_bad_arguments_of_the_posterior_bound_are_named(as_users_have_it):
    good = {"ts": DT * np.arange(20), "x0_mean": [1.0, 0.0], "x0_covariance": np.eye(2), "noise_covariance": [[0.1]]}
    good |= {"process_covariance": np.eye(2), "keys": SEEDS, "signal": jaxobs.signals.Sine(0.5)}
    for name, value, message in (
        ("keys", jax.random.key(0), "keys: given"),
        ("keys", jax.random.split(jax.random.key(0), 1), "keys: given 1 of them"),
        ("process_covariance", np.eye(3), r"process_covariance: given shape \(3, 3\)"),
        ("process_covariance", -np.eye(2), "process_covariance: .*semidefinite"),
        ("x0_covariance", [[1.0, 0.5], [0.0, 1.0]], "x0_covariance: .*symmetric"),
        ("noise_covariance", [[0.0]], "noise_covariance: .*positive definite"),
        ("x0_mean", [1.0], "x0_mean: given shape"),
        ("ts", [0.0, 1.0, 3.0], "ts: given a step of"),
        ("signal", jaxobs.signals.Zero(2), "signal: given m = 2"),
    ):
        with pytest.raises(ValueError, match=message):
            posterior_cramer_rao(Pendulum(), **(good | {name: value}))
    with pytest.raises(ValueError, match="integrator: given RK4; expected none"):
        posterior_cramer_rao(Sine(), **(good | {"signal": None, "integrator": jaxobs.integrators.RK4()}))
    with pytest.raises(ValueError, match="trajectories that are not finite at t = "):
        scalar_bound(Sine(1.3, 1e60))
    # Without noise the Jacobian still varies with the start.
    with pytest.raises(ValueError, match=r"process_covariance: given rank 0 of 1, .*held=False"):
        scalar_bound(q=0.0)
