"""Objectives against quadrature, dense responses and brute force; every gradient against finite differences."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from oracles import linear_error as oracle

import jaxobs
from jaxobs import noise, observers, plants
from jaxobs.tuning import objectives
from jaxobs.tuning.linear_error import linearise
from jaxobs.tuning.objectives import monte_carlo
from jaxobs.tuning.objectives.weighted import spectral_bound

CHAIN, SAMPLES, DT = plants.IntegratorChain(2), plants.SampledChain(2, 0.1), 0.1
GAIN, STEP, SMALL = np.array([1.4, 2.0]), np.array([0.5, 0.9]), 1e-5
DIRECTION = np.array([0.6, -0.8])
ORIGIN, UNITS = [[0.0, 0.0]], np.eye(2)
F = np.array([[-1.4, 1.0], [-2.0, 0.0]])
FS = np.array([[1 - 0.5, 0.1], [-0.9, 1.0]])


def flows():
    steady = objectives.SteadyNoise(CHAIN, ORIGIN, 0.1, 0.3, [0.0, 1.0], DT)
    squared = objectives.SquaredError(CHAIN, ORIGIN, weight=[[2.0, 1.0]])
    return {
        "noise": steady,
        "peak": objectives.Peak(CHAIN, ORIGIN),
        "settling": objectives.Settling(CHAIN, ORIGIN, [[0.0, 1.0]], weight=[0.0, 1.0]),
        "squared": squared,
        "L1": objectives.L1Gain(CHAIN, ORIGIN, weight=[0.0, 1.0]),
        "noise bandwidth": objectives.NoiseBandwidth(CHAIN, ORIGIN),
        "bandwidth": objectives.Bandwidth(CHAIN, ORIGIN),
        "capped": objectives.Weighted((squared, squared), [1.0, 0.5], 1.3, CHAIN, ORIGIN),
    }


def steps():
    return {
        "noise": objectives.SteadyNoise(SAMPLES, ORIGIN, 0.1, 0.3),
        "peak": objectives.Peak(SAMPLES, ORIGIN, [[0.0, 1.0], [1.0, -0.5]], [1.0, 0.1]),
        "settling": objectives.Settling(SAMPLES, ORIGIN),
        "squared": objectives.SquaredError(SAMPLES, ORIGIN, [[1.0, 0.0], [0.0, 1.0]]),
        "L1": objectives.L1Gain(SAMPLES, ORIGIN, 0.5, 0.2),
        "noise bandwidth": objectives.NoiseBandwidth(SAMPLES, ORIGIN),
        "bandwidth": objectives.Bandwidth(SAMPLES, ORIGIN),
    }


# Compiling is the cost of these tests: large programs that run once.
fast = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


@functools.cache
def found(kind):
    """{name: (values, gradients)} at the gain, a little further both ways, with poles that meet, and unstable: one program."""
    make, terms = (observers.Luenberger, flows()) if kind == "flow" else (observers.StepLuenberger, steps())
    plant, gain = (CHAIN, GAIN) if kind == "flow" else (SAMPLES, STEP)
    meeting = [2.0, 1.0] if kind == "flow" else [1.0, 2.5]
    points = jnp.asarray([gain, gain + SMALL * DIRECTION, gain - SMALL * DIRECTION, meeting, [0.5, -0.5]])

    @fast
    @jax.vmap
    def every(gain):
        return {
            name: jax.value_and_grad(lambda g, term=term: term(make(plant, g[:, None])))(gain) for name, term in terms.items()
        }

    return {name: (np.asarray(values), np.asarray(slopes)) for name, (values, slopes) in every(points).items()}


def step_path(b, count=4096):
    path = [np.asarray(b, float)]
    for _ in range(count - 1):
        path.append(FS @ path[-1])
    return np.asarray(path)


@pytest.mark.parametrize(("kind", "name"), [("flow", name) for name in flows()] + [("step", name) for name in steps()])
def test_gradients_are_those_of_finite_differences(kind, name):
    values, slopes = found(kind)[name]
    assert slopes[0] @ DIRECTION == pytest.approx((values[1] - values[2]) / (2 * SMALL), rel=2e-6, abs=1e-9)
    assert np.all(np.isfinite(slopes[3])), "where poles meet"
    assert np.isinf(values[4]), "where it is not stable"


def test_steady_noise():
    expected = oracle.sampled(F, 0.1 * GAIN[:, None], np.array([[0.0], [0.3]]), DT)[1, 1]
    assert found("flow")["noise"][0][0] == pytest.approx(np.sqrt(expected), rel=1e-12)
    driven = np.hstack([0.1 * STEP[:, None], [[0.0], [0.3]]])
    assert found("step")["noise"][0][0] == pytest.approx(np.sqrt(np.trace(oracle.steps(FS, driven))), rel=1e-12)


def test_peaks():
    _, path = oracle.dense(F, np.eye(2), np.eye(2), 8.0, 80_001)
    assert found("flow")["peak"][0][0] == pytest.approx(np.max(np.linalg.norm(path, 2, axis=(1, 2))), rel=1e-8)
    sizes = np.linalg.norm(np.diag([1.0, 0.1]) @ step_path([[0.0, 1.0], [1.0, -0.5]]), axis=1)
    assert found("step")["peak"][0][0] == pytest.approx(np.max(sizes), rel=1e-12)


def test_settling_times():
    ts, path = oracle.dense(F, np.array([0.0, 1.0]), np.array([0.0, 1.0]), 20.0, 200_001)
    last = ts[np.flatnonzero(np.abs(path) > 0.05 * np.max(np.abs(path)))[-1]]
    assert found("flow")["settling"][0][0] == pytest.approx(last, abs=1.1e-4)
    sizes = np.linalg.norm(step_path(np.eye(2)), axis=1)
    last = [np.flatnonzero(one > 0.05 * one.max())[-1] for one in sizes.T]
    assert max(last) * DT <= found("step")["settling"][0][0] <= (max(last) + 1) * DT


def test_squared_errors():
    ts, path = oracle.dense(F, np.eye(2), np.array([2.0, 1.0]), 60.0, 60_001)
    expected = scipy.integrate.simpson(np.sum(path**2, axis=1), x=ts)
    assert found("flow")["squared"][0][0] == pytest.approx(expected, rel=1e-9)
    expected = DT * np.sum(step_path(np.eye(2)) ** 2) / 2  # the mean over two first errors
    assert found("step")["squared"][0][0] == pytest.approx(expected, rel=1e-12)


def test_worst_case_gains():
    expected = oracle.absolute_integral(F, GAIN, np.array([0.0, 1.0]), 40.0)
    assert found("flow")["L1"][0][0] == pytest.approx(expected, rel=1e-6)
    driven = np.hstack([0.5 * STEP[:, None], [[0.0], [0.2]]])
    assert found("step")["L1"][0][0] == pytest.approx(np.max(np.sum(np.abs(step_path(driven)), axis=(0, 2))), rel=1e-12)


def test_bandwidths():
    h = np.array([1.0, 0.0])
    assert found("flow")["noise bandwidth"][0][0] == pytest.approx(oracle.noise_bandwidth(F, GAIN, h), rel=1e-7)
    assert found("flow")["bandwidth"][0][0] == pytest.approx(oracle.edge(F, GAIN, h), rel=1e-9)
    w = 2 * np.pi * DT * found("step")["bandwidth"][0][0]
    transfer = [abs(h @ np.linalg.solve(np.exp(1j * w) * np.eye(2) - FS, STEP)) for w in (1e-9, w)]
    assert transfer[1] / transfer[0] == pytest.approx(np.sqrt(0.5), rel=1e-9)
    energy = np.sum(step_path(STEP)[:, 0] ** 2) / (2 * DT)  # T(0) = 1
    assert found("step")["noise bandwidth"][0][0] == pytest.approx(energy, rel=1e-12)


def test_weighted_sum_and_cap():
    """Below the cap the sum alone; above it strength * log(rho / fastest)^2 more, and rho bounds the poles from above."""
    sums, capped = 1.5 * found("flow")["squared"][0], found("flow")["capped"][0]
    assert capped[3] == pytest.approx(sums[3], rel=1e-12)
    rho = 1.3 * np.exp(np.sqrt((capped[0] - sums[0]) / 100))
    assert np.sqrt(2) < rho < 1.02 * np.sqrt(2)  # the poles are a pair with the product 2


def test_bound_on_the_poles():
    bound = jax.jit(spectral_bound)
    rng = np.random.default_rng(0)
    for _ in range(20):
        f = rng.normal(size=(4, 4)) * 10.0 ** rng.uniform(-2, 2, size=(4, 1))
        poles = np.max(np.abs(np.linalg.eigvals(f)))
        assert poles * (1 - 1e-12) <= bound(f) < 1.1 * poles


def test_without_bias_less_gain_is_always_better():
    model = plants.Pendulum(1.1)
    points = [[0.5, 0.0]]
    observer = observers.Luenberger(model, GAIN[:, None])
    plain = objectives.SteadyNoise(plants.Pendulum(), points, 0.1)(observer)
    biased = objectives.SteadyNoise(plants.Pendulum(), points, 0.1, with_bias=True)(observer)
    bias = linearise(observer, plants.Pendulum(), points[0]).bias()
    assert float(biased**2) == pytest.approx(float(plain**2 + jnp.sum(bias**2)), rel=1e-12)


PENDULUM, TS = plants.Pendulum(), np.arange(41) * 0.05


def chance(**more):
    parts = {"noise": noise.Gaussian(0.2), "disturbance": noise.Gaussian(0.5), "after": 0.5, "weight": [0.0, 2.0]}
    return objectives.MonteCarlo(PENDULUM, TS, [0.3, 0.1], [0.0, 0.0], **(parts | more))


def pendulum_observer(gain):
    return observers.Luenberger(PENDULUM, gain[:, None])


def test_monte_carlo_is_the_rmse_of_the_simulation():
    key = jax.random.key(3)
    observer = pendulum_observer(GAIN)
    run = jaxobs.simulate(
        PENDULUM, observer, x0=[0.3, 0.1], xhat0=[0.0, 0.0], ts=TS, noise=noise.Gaussian(0.2), disturbance=noise.Gaussian(0.5),
        key=key,
    )  # fmt: skip
    expected = 2 * np.sqrt(np.mean((run.xhat - run.x)[TS >= 0.5, 1] ** 2))
    assert chance()(observer, key) == pytest.approx(expected, rel=1e-12)


def test_monte_carlo_gradient_in_both_modes(monkeypatch):
    """Forward, reverse over checkpoints and finite differences agree, over starts side by side."""
    loss = chance(noise=noise.Sinusoid(0.2, 3.0), disturbance=None, spread=[0.1, 0.2])
    key, gains = jax.random.key(0), jnp.asarray([GAIN, [3.0, 1.0]])

    def mean(gain):
        return loss(pendulum_observer(gain), key)

    values, forward = fast(jax.vmap(jax.value_and_grad(mean)))(gains)
    monkeypatch.setattr(monte_carlo, "FEW", 0)
    ends = jnp.concatenate([gains + SMALL * DIRECTION, gains - SMALL * DIRECTION])
    around, reverse = fast(jax.vmap(jax.value_and_grad(lambda gain: mean(gain))))(jnp.concatenate([gains, ends]))
    assert values == pytest.approx(np.asarray(around[:2]), rel=1e-12)
    assert forward == pytest.approx(np.asarray(reverse[:2]), rel=1e-9)
    assert forward @ DIRECTION == pytest.approx(np.asarray(around[2:4] - around[4:]) / (2 * SMALL), rel=1e-6)


def test_each_key_draws_a_plant_and_a_start():
    """Without noise a run is that of one of the members; a start is x0 + spread * normals."""
    quiet = chance(noise=None, disturbance=None, spread=[0.0, 0.0])
    several = eqx.tree_at(lambda o: o.plant, quiet, jaxobs.grid(PENDULUM, a=[0.5, 1.0, 2.0]))
    observer, keys = pendulum_observer(GAIN), jax.random.split(jax.random.key(1), 40)

    @fast
    @functools.partial(jax.vmap, in_axes=(None, 0))
    @functools.partial(jax.vmap, in_axes=(0, None))
    def run(spread, key):
        return eqx.tree_at(lambda o: o.spread, several, spread)(observer, key)

    drawn, spread = np.asarray(run(jnp.asarray([[0.0, 0.0], [0.0, 0.3]]), keys)).T
    single = chance(noise=None, disturbance=None)
    alone = [float(eqx.tree_at(lambda o: o.plant.a, single, jnp.asarray(a))(observer)) for a in (0.5, 1.0, 2.0)]
    nearest = np.argmin(np.abs(drawn[:, None] - alone), axis=1)
    assert drawn == pytest.approx(np.asarray(alone)[nearest], rel=1e-12)
    assert np.all(np.bincount(nearest, minlength=3) > 4)
    assert len(np.unique(spread)) == len(keys)


def record():
    rng = np.random.default_rng(0)
    ts = np.arange(60) * DT
    return ts, np.sin(ts) + 0.01 * rng.normal(size=60), np.cos(ts)


def test_record_with_and_without_a_reference():
    ts, ys, reference = record()
    ys[30], reference[25] = np.nan, np.nan
    observer = observers.CurrentLuenberger(SAMPLES, STEP[:, None])
    blocks = ((10, 28), (29, 45))
    chosen = np.r_[10:28, 29:45]
    est = jaxobs.observe(observer, ts, ys, xhat0=[0.0, 1.0])
    seen = chosen[chosen != 30]
    innovation = objectives.Innovation(ts, ys, [0.0, 1.0], blocks=blocks)(observer)
    assert innovation == pytest.approx(np.log(np.mean(np.asarray(est.innovation)[seen] ** 2)) / 2, rel=1e-12)
    known = chosen[chosen != 25]
    rmse = objectives.Recorded(ts, ys, [0.0, 1.0], reference, states=(1,), blocks=blocks)(observer)
    assert rmse == pytest.approx(np.sqrt(np.mean((est.xhat[known, 1] - reference[known]) ** 2)), rel=1e-12)


def test_gradients_on_a_record():
    ts, ys, reference = record()
    terms = [objectives.Innovation(ts, ys, [0.0, 1.0]), objectives.Recorded(ts, ys, [0.0, 1.0], reference, states=(1,))]

    @jax.jit
    def every(gain):
        return jnp.stack([term(observers.CurrentLuenberger(SAMPLES, gain[:, None])) for term in terms])

    slopes = jax.jit(jax.jacrev(every))(jnp.asarray(STEP))
    ends = every(STEP + SMALL * DIRECTION) - every(STEP - SMALL * DIRECTION)
    assert slopes @ DIRECTION == pytest.approx(np.asarray(ends) / (2 * SMALL), rel=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: objectives.SteadyNoise(CHAIN, [0.0, 0.0]), r"points: given shape \(2,\)"),
        (lambda: objectives.SteadyNoise(CHAIN, ORIGIN, weight=[1.0]), r"weight: given shape \(1,\)"),
        (lambda: objectives.SteadyNoise(CHAIN, ORIGIN, dt=-1.0), "dt: given -1"),
        (lambda: objectives.SteadyNoise(PENDULUM, ORIGIN, inputs=[0.0]), r"inputs: given shape \(1,\)"),
        (lambda: objectives.Peak(CHAIN, ORIGIN, [[1.0]]), r"initial: given shape \(1, 1\)"),
        (lambda: objectives.Settling(CHAIN, ORIGIN, band=2.0), "band: given 2"),
        (lambda: objectives.Bandwidth(CHAIN, ORIGIN, state=2), "state: given 2; expected less than 2"),
        (lambda: chance(spread=[1.0]), r"spread: given shape \(1,\)"),
        (lambda: chance(spread=[1.0, 1.0])(pendulum_observer(GAIN)), "key: given None; expected a PRNG key"),
        (lambda: objectives.Innovation(TS, TS[:5], [0.0, 0.0]), r"ys: given shape \(5, 1\)"),
        (lambda: objectives.Innovation(TS, TS, [0.0, 0.0], blocks=[(5, 99)]), r"blocks: given \(5, 99\)"),
        (lambda: objectives.Innovation(TS, TS * np.nan, [0.0, 0.0]), "ys: given no finite sample"),
        (lambda: objectives.Recorded(TS, TS, [0.0, 0.0], TS, states=(0, 1)), r"reference: given shape \(41, 1\)"),
        (lambda: objectives.Recorded(TS, TS, [0.0, 0.0], TS, states=(2,))(pendulum_observer(GAIN)), r"states: given \(2,\)"),
        (lambda: objectives.Weighted([flows()["noise"]]), "terms: given list"),
        (lambda: objectives.Weighted((flows()["noise"],), [1.0, 1.0]), r"weights: given shape \(2,\)"),
        (lambda: objectives.Weighted((flows()["noise"],), fastest=2.0), "fastest: given a cap without plant"),
    ],
)
def test_bad_arguments_are_named(make, message, as_users_have_it):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_cap_on_a_step_observer_is_refused():
    capped = objectives.Weighted((steps()["noise"],), fastest=2.0, plant=CHAIN, points=ORIGIN)
    with pytest.raises(ValueError, match="observer: given StepLuenberger; expected a flow observer"):
        capped(observers.StepLuenberger(SAMPLES, STEP[:, None]))
