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

pytestmark = pytest.mark.usefixtures("hardly_optimised")

CHAIN, SAMPLES, DT = plants.IntegratorChain(2), plants.SampledChain(2, 0.1), 0.1
GAIN, STEP, SMALL = np.array([1.4, 2.0]), np.array([0.5, 0.9]), 1e-5
DIRECTION = np.array([0.6, -0.8])
ORIGIN, UNITS = [[0.0, 0.0]], np.eye(2)
PENDULUM, TS = plants.Pendulum(), np.arange(41) * 0.05
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


# Every objective once; the other kind of observer is slow.
FAST = {"flow": ("peak", "L1", "bandwidth"), "step": ("noise", "squared", "noise bandwidth")}


def marked(kind, name):
    return pytest.param(kind, name, marks=[] if name in FAST[kind] else pytest.mark.slow)


def both_kinds(name):
    return pytest.mark.parametrize(("kind", "name"), [marked("flow", name), marked("step", name)])


def found(kind, name):
    """(values, gradients) at the gain, a little further both ways, with poles that meet, and unstable."""
    return computed(kind, name in FAST[kind])[name]


@functools.cache
def computed(kind, fast):
    """All that are fast, or all that are not, in one program."""
    make, terms = (observers.Luenberger, flows()) if kind == "flow" else (observers.StepLuenberger, steps())
    terms = {name: term for name, term in terms.items() if (name in FAST[kind]) == fast}
    plant, gain = (CHAIN, GAIN) if kind == "flow" else (SAMPLES, STEP)
    meeting = [2.0, 1.0] if kind == "flow" else [1.0, 2.5]
    points = jnp.asarray([gain, gain + SMALL * DIRECTION, gain - SMALL * DIRECTION, meeting, [0.5, -0.5]])

    @jax.jit
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


@pytest.mark.parametrize(
    ("kind", "name"), [marked("flow", name) for name in flows()] + [marked("step", name) for name in steps()]
)
def test_gradients_are_those_of_finite_differences(kind, name):
    values, slopes = found(kind, name)
    assert slopes[0] @ DIRECTION == pytest.approx((values[1] - values[2]) / (2 * SMALL), rel=2e-6, abs=1e-9)
    assert np.all(np.isfinite(slopes[3])), "where poles meet"
    assert np.isinf(values[4]), "where it is not stable"


@both_kinds("noise")
def test_steady_noise(kind, name):
    if kind == "flow":
        expected = oracle.sampled(F, 0.1 * GAIN[:, None], np.array([[0.0], [0.3]]), DT)[1, 1]
    else:
        expected = np.trace(oracle.steps(FS, np.hstack([0.1 * STEP[:, None], [[0.0], [0.3]]])))
    assert found(kind, name)[0][0] == pytest.approx(np.sqrt(expected), rel=1e-12)


@both_kinds("peak")
def test_peaks(kind, name):
    value = found(kind, name)[0][0]
    if kind == "flow":
        _, path = oracle.dense(F, np.eye(2), np.eye(2), 8.0, 80_001)
        assert value == pytest.approx(np.max(np.linalg.norm(path, 2, axis=(1, 2))), rel=1e-8)
    else:
        sizes = np.linalg.norm(np.diag([1.0, 0.1]) @ step_path([[0.0, 1.0], [1.0, -0.5]]), axis=1)
        assert value == pytest.approx(np.max(sizes), rel=1e-12)


@both_kinds("settling")
def test_settling_times(kind, name):
    value = found(kind, name)[0][0]
    if kind == "flow":
        ts, path = oracle.dense(F, np.array([0.0, 1.0]), np.array([0.0, 1.0]), 20.0, 200_001)
        last = ts[np.flatnonzero(np.abs(path) > 0.05 * np.max(np.abs(path)))[-1]]
        assert value == pytest.approx(last, abs=1.1e-4)
    else:
        last = last_sample_outside()
        assert last * DT <= value <= (last + 1) * DT


def last_sample_outside():
    """The later of the samples at which the responses to the unit errors leave the band."""
    sizes = np.linalg.norm(step_path(np.eye(2)), axis=1)
    return max(np.flatnonzero(one > 0.05 * one.max())[-1] for one in sizes.T)


def test_settling_time_without_its_gradient():
    value = jax.jit(lambda gain: steps()["settling"](observers.StepLuenberger(SAMPLES, gain[:, None])))(STEP)
    last = last_sample_outside()
    assert last * DT <= value <= (last + 1) * DT


@both_kinds("squared")
def test_squared_errors(kind, name):
    value = found(kind, name)[0][0]
    if kind == "flow":
        ts, path = oracle.dense(F, np.eye(2), np.array([2.0, 1.0]), 60.0, 60_001)
        assert value == pytest.approx(scipy.integrate.simpson(np.sum(path**2, axis=1), x=ts), rel=1e-9)
    else:  # the mean over two first errors
        assert value == pytest.approx(DT * np.sum(step_path(np.eye(2)) ** 2) / 2, rel=1e-12)


@both_kinds("L1")
def test_worst_case_gains(kind, name):
    value = found(kind, name)[0][0]
    if kind == "flow":
        assert value == pytest.approx(oracle.absolute_integral(F, GAIN, np.array([0.0, 1.0]), 40.0), rel=1e-6)
    else:
        driven = np.hstack([0.5 * STEP[:, None], [[0.0], [0.2]]])
        assert value == pytest.approx(np.max(np.sum(np.abs(step_path(driven)), axis=(0, 2))), rel=1e-12)


@both_kinds("bandwidth")
def test_bandwidths(kind, name):
    value, h = found(kind, name)[0][0], np.array([1.0, 0.0])
    if kind == "flow":
        assert value == pytest.approx(oracle.edge(F, GAIN, h), rel=1e-9)
    else:
        w = 2 * np.pi * DT * value
        transfer = [abs(h @ np.linalg.solve(np.exp(1j * w) * np.eye(2) - FS, STEP)) for w in (1e-9, w)]
        assert transfer[1] / transfer[0] == pytest.approx(np.sqrt(0.5), rel=1e-9)


@both_kinds("noise bandwidth")
def test_noise_bandwidths(kind, name):
    value = found(kind, name)[0][0]
    if kind == "flow":
        assert value == pytest.approx(oracle.noise_bandwidth(F, GAIN, np.array([1.0, 0.0])), rel=1e-7)
    else:  # T(0) = 1
        assert value == pytest.approx(np.sum(step_path(STEP)[:, 0] ** 2) / (2 * DT), rel=1e-12)


def test_weighted_sum_and_cap():
    """The poles are a pair with the product 2: rho is a little above its root."""
    terms = (lambda observer, key: observer.gain[0, 0], lambda observer, key: observer.gain[1, 0] ** 2)
    one, observer = objectives.Weighted(terms, [1.0, 0.5], 1.3, CHAIN, ORIGIN), observers.Luenberger(CHAIN, GAIN[:, None])
    capped, free = jax.jit(jax.vmap(lambda cap: eqx.tree_at(lambda one: one.fastest, one, cap)(observer)))(
        np.array([1.3, 1.45])
    )
    sums = GAIN[0] + GAIN[1] ** 2 / 2
    assert free == pytest.approx(sums, rel=1e-12)
    assert np.sqrt(2) < 1.3 * np.exp(np.sqrt((capped - sums) / 100)) < 1.02 * np.sqrt(2)


@pytest.mark.slow
def test_weighted_objectives_and_cap():
    """Below the cap the sum alone; above it strength * log(rho / fastest)^2 more, and rho bounds the poles from above."""
    sums, capped = 1.5 * found("flow", "squared")[0], found("flow", "capped")[0]
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
    terms = [objectives.SteadyNoise(PENDULUM, points, 0.1, with_bias=with_bias) for with_bias in (False, True)]

    @jax.jit
    def every(gain):
        observer = observers.Luenberger(model, gain[:, None])
        return *(term(observer) for term in terms), linearise(observer, PENDULUM, points[0]).bias()

    plain, biased, bias = every(GAIN)
    assert float(biased**2) == pytest.approx(float(plain**2 + jnp.sum(bias**2)), rel=1e-12)


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
    assert eqx.filter_jit(chance())(observer, key) == pytest.approx(expected, rel=1e-12)


def monte_carlo_slopes(gains):
    """(values, gradients) over starts side by side."""
    loss = chance(noise=noise.Sinusoid(0.2, 3.0), disturbance=None, spread=[0.1, 0.2])

    def mean(gain):
        return loss(pendulum_observer(gain), jax.random.key(0))

    return tuple(np.asarray(part) for part in jax.jit(jax.vmap(jax.value_and_grad(mean)))(gains))


def test_monte_carlo_gradient():
    gains = jnp.asarray([GAIN, [3.0, 1.0]])
    values, slopes = monte_carlo_slopes(jnp.concatenate([gains, gains + SMALL * DIRECTION, gains - SMALL * DIRECTION]))
    assert slopes[:2] @ DIRECTION == pytest.approx((values[2:4] - values[4:]) / (2 * SMALL), rel=1e-6)


@pytest.mark.slow
def test_monte_carlo_gradient_in_both_modes(monkeypatch):
    """Forward and reverse over checkpoints."""
    gains = jnp.asarray([GAIN, [3.0, 1.0]])
    values, forward = monte_carlo_slopes(gains)
    monkeypatch.setattr(monte_carlo, "FEW", 0)
    again, reverse = monte_carlo_slopes(gains)
    assert values == pytest.approx(again, rel=1e-12)
    assert forward == pytest.approx(reverse, rel=1e-9)


@pytest.mark.slow
def test_each_key_draws_a_plant_and_a_start():
    """Without noise a run is that of one of the members; a start is x0 + spread * normals."""
    quiet = chance(noise=None, disturbance=None, spread=[0.0, 0.0])
    several = eqx.tree_at(lambda o: o.plant, quiet, jaxobs.grid(PENDULUM, a=[0.5, 1.0, 2.0]))
    observer, keys = pendulum_observer(GAIN), jax.random.split(jax.random.key(1), 40)

    @jax.jit
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
    innovation = eqx.filter_jit(objectives.Innovation(ts, ys, [0.0, 1.0], blocks=blocks))(observer)
    assert innovation == pytest.approx(np.log(np.mean(np.asarray(est.innovation)[seen] ** 2)) / 2, rel=1e-12)
    known = chosen[chosen != 25]
    rmse = eqx.filter_jit(objectives.Recorded(ts, ys, [0.0, 1.0], reference, states=(1,), blocks=blocks))(observer)
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
