"""The mean of a metric over a study's lanes and its gradient, against `jax.grad` through `score`, lane by lane."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxobs
from jaxobs import Seeds, grid, hurwitz, integrators, mean_gradient, metrics, noise, observers, plants, signals
from jaxobs.noise import BLOCK

KEY = jax.random.key(3)
PENDULUM = plants.Pendulum(a=0.8)
HIGH = observers.HighGain(plants.Pendulum(), [3.0, 2.0], 2.0)  # its model differs from the plant
TS = np.linspace(0, 1.4, BLOCK + 7)  # more than one block of noise, the last one cut
RUN = {"ts": TS, "metrics": {"rmse": metrics.RMSE(0.7), "peak": metrics.Peak()}, "signal": signals.Sine(0.3, 2.0)}
LANES = {"x0": [[0.5, 0.0], [-0.2, 0.3], [0.1, 0.1]], "xhat0": [0.1, 0.0]}
NOISE = {"noise": noise.Sum((noise.Gaussian(0.1), noise.Dropout(0.2))), "keys": Seeds(KEY, 2)}
RUN |= {"integrator": integrators.Euler()}  # a third of the time to compile


def second(found):
    return found["rmse"][1]


def mixed(found):
    return found["rmse"][1] ** 2 + found["peak"][0]


def slow(plant, observer, of, *, x0, xhat0, keys=None, ts, **run):
    """value_and_grad of the plain mean over lanes, each through `score`."""
    starts = jnp.asarray(np.atleast_2d(x0))
    seeds = jnp.zeros(1, int) if keys is None else jnp.arange(len(keys))

    def loss(observer):
        def lane(start, s):
            key = None if keys is None else keys[s]
            return of(jaxobs.score(plant, observer, x0=start, xhat0=xhat0, ts=ts, key=key, **run))

        return jnp.mean(jax.vmap(jax.vmap(lane, (None, 0)), (0, None))(starts, seeds))

    return eqx.filter_jit(eqx.filter_value_and_grad(loss))(observer)


def close(actual, desired, rtol=1e-8):
    for a, b in zip(jax.tree.leaves(actual), jax.tree.leaves(desired), strict=True):
        np.testing.assert_allclose(a, b, rtol=rtol, atol=1e-12)


@pytest.mark.parametrize("mode", ["forward", pytest.param("reverse", marks=pytest.mark.slow)])
def test_the_gradient_is_that_of_the_plain_loop(mode):
    rest = RUN | LANES | NOISE | {"hold_innovation": True}
    found = mean_gradient(mixed, PENDULUM, HIGH, mode=mode, **rest)()
    value, gradient = slow(PENDULUM, HIGH, mixed, **rest)
    np.testing.assert_allclose(found.value, value, rtol=1e-12)
    close(found.gradient, gradient)
    assert int(found.diverged) == 0


CHAIN = plants.SineChain(1.0, 5)
FIVE = {"ts": TS[:20], "metrics": {"rmse": metrics.RMSE()}, "xhat0": np.zeros(5)}
FIVE |= {"x0": [np.full(5, 0.3), np.linspace(-0.5, 0.5, 5)]}
OBSERVERS = {
    "HighGain": observers.HighGain(CHAIN, hurwitz.binomial(5), 2.0),
    "IntegralHighGain": observers.IntegralHighGain(CHAIN, hurwitz.binomial(6), 2.0, 1),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "integrator"),
    [
        ("HighGain", integrators.RK4()),
        ("HighGain", integrators.Exponential()),
        ("IntegralHighGain", integrators.Euler()),
    ],
)
def test_five_states(name, integrator):
    observer, rest = OBSERVERS[name], FIVE | {"integrator": integrator}
    found = mean_gradient(second, CHAIN, observer, wrt=("gamma", "alphas"), **rest)()
    value, gradient = slow(CHAIN, observer, second, **rest)
    np.testing.assert_allclose(found.value, value, rtol=1e-12)
    close(found.gradient, {"gamma": gradient.gamma, "alphas": gradient.alphas})


@pytest.mark.slow
def test_finite_differences():
    f = mean_gradient(second, PENDULUM, HIGH, wrt="gamma", **RUN, **LANES, **NOISE)
    step = 1e-5

    def at(change):
        return float(f(eqx.tree_at(lambda o: o.gamma, HIGH, HIGH.gamma + change)).value)

    np.testing.assert_allclose(f().gradient["gamma"], (at(step) - at(-step)) / (2 * step), rtol=1e-6)


def test_other_numbers_trace_nothing_again_and_jit_takes_it():
    traces = []

    def counted(found):
        traces.append(1)
        return second(found)

    f = mean_gradient(counted, PENDULUM, HIGH, wrt=["gamma", "alphas"], **RUN, **LANES)
    first, count = f(), len(traces)
    other = eqx.tree_at(lambda o: o.gamma, HIGH, jnp.asarray(3.0))
    assert float(f(other).value) != float(first.value)
    assert len(traces) == count

    @jax.jit
    def descend(log_gamma):
        def loss(log_gamma):
            return f.loss(eqx.tree_at(lambda o: o.gamma, HIGH, jnp.exp(log_gamma)))

        value, slope = jax.value_and_grad(loss)(log_gamma)
        return value, slope, log_gamma - 0.1 * slope

    value, slope, log_gamma = descend(jnp.log(HIGH.gamma))
    np.testing.assert_allclose(value, first.value, rtol=1e-12)
    np.testing.assert_allclose(slope, HIGH.gamma * first.gradient["gamma"], rtol=1e-10)
    count = len(traces)
    assert float(descend(log_gamma)[0]) < float(value)
    assert len(traces) == count


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_lanes_that_diverge_are_counted_and_dropped_if_asked(mode):
    starts = LANES | {"x0": [*LANES["x0"], [1e308, 1e308]]}
    kept, dropped = (
        mean_gradient(second, PENDULUM, HIGH, wrt="alphas", mode=mode, diverged=rule, **RUN, **starts)()
        for rule in ("keep", "drop")
    )
    assert int(kept.diverged) == int(dropped.diverged) == 1
    assert np.isnan(kept.gradient["alphas"]).all()
    alone = mean_gradient(second, PENDULUM, HIGH, wrt="alphas", mode=mode, **RUN, **LANES)()
    close((dropped.value, dropped.gradient), (alone.value, alone.gradient), rtol=1e-12)


@pytest.mark.slow
def test_single_precision():
    def single(tree):
        return jaxobs.astype(tree, jnp.float32)

    rest = {name: single(part) for name, part in (RUN | NOISE).items() if name not in ("ts", "keys", "integrator")}
    rest |= {"ts": TS, "keys": NOISE["keys"], "integrator": RUN["integrator"]} | LANES
    found = mean_gradient(second, single(PENDULUM), single(HIGH), wrt="alphas", **rest)()
    exact = mean_gradient(second, PENDULUM, HIGH, wrt="alphas", **(rest | RUN | {"noise": None, "keys": None}))()
    quiet = mean_gradient(second, single(PENDULUM), single(HIGH), wrt="alphas", **(rest | {"noise": None, "keys": None}))()
    assert found.gradient["alphas"].dtype == found.value.dtype == jnp.float32
    np.testing.assert_allclose(quiet.gradient["alphas"], exact.gradient["alphas"], rtol=1e-4)


@pytest.mark.slow
def test_axes_and_tiles():
    """A family's axis is one of lanes; the bits do not depend on the tile."""
    family = grid(HIGH, gamma=[2.0, 3.0])
    rest = RUN | LANES | NOISE
    one, two = (mean_gradient(second, PENDULUM, family, wrt="alphas", tile=tile, **rest)() for tile in (512, 16))
    np.testing.assert_array_equal(one.gradient["alphas"], two.gradient["alphas"])
    apart = [mean_gradient(second, PENDULUM, family.member(gamma), wrt="alphas", **rest)() for gamma in family.values[0]]
    np.testing.assert_allclose(one.gradient["alphas"], np.mean([a.gradient["alphas"] for a in apart], axis=0), rtol=1e-11)


def test_the_mode_is_chosen_by_the_count():
    chain = plants.SineChain(1.0, 70)
    rest = {"ts": TS, "metrics": {"rmse": metrics.RMSE()}, "x0": np.zeros(70), "xhat0": np.zeros(70)}
    observer = observers.HighGain(chain, hurwitz.binomial(70), 1.0)
    assert mean_gradient(second, chain, observer, wrt="gamma", **rest).mode == "forward"
    assert mean_gradient(second, chain, observer, wrt=["alphas"], **rest).mode == "reverse"
    adaptive = RUN | LANES | {"integrator": integrators.Adaptive()}
    assert mean_gradient(second, PENDULUM, HIGH, **adaptive).mode == "reverse"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"of": 3}, r"mean_gradient\.of: given int"),
        ({"wrt": "beta"}, r"mean_gradient\.wrt: given 'beta'; expected one of model\.a, model\.b, alphas, gamma"),
        ({"wrt": []}, r"mean_gradient\.wrt"),
        ({"wrt": ["gamma", "gamma"]}, r"each once"),
        ({"mode": "backward"}, r"mean_gradient\.mode"),
        ({"diverged": "ignore"}, r"mean_gradient\.diverged"),
        ({"tile": 0}, r"mean_gradient\.tile"),
        ({"observer": {"one": HIGH}}, r"mean_gradient\.observer"),
        ({"observer": grid(HIGH, gamma=[1.0, 2.0]), "wrt": "gamma"}, r"runs over values"),
        ({"mode": "forward", "integrator": integrators.Adaptive()}, r"Adaptive"),
    ],
)
def test_bad_input(as_users_have_it, changed, message):
    given = {"of": second, "plant": PENDULUM, "observer": HIGH} | RUN | LANES | changed
    with pytest.raises(ValueError, match=message):
        mean_gradient(given.pop("of"), given.pop("plant"), given.pop("observer"), **given)


def test_another_structure_is_refused():
    f = mean_gradient(second, PENDULUM, HIGH, **RUN, **LANES)
    with pytest.raises(ValueError, match=r"mean_gradient\.observer: given IntegralHighGain; expected the HighGain"):
        f(observers.IntegralHighGain(PENDULUM, hurwitz.binomial(3), 2.0, 1))
    with pytest.raises(ValueError, match=r"expected the HighGain"):
        f(jaxobs.astype(HIGH, jnp.float32))
