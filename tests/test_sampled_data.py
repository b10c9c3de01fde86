"""Sampling periods of the continuous plant: proofs against monodromy matrices, random walks and the observer itself."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxobs
from jaxobs import integrators, observers, plants
from jaxobs.certificates import Sampled, SampledTube, load
from jaxobs.designs import Infeasible, euler_delta, largest_delta, sampled_data, sampling
from jaxobs.designs.polytope import Polytope
from tests.oracles import sampled as oracle

GAIN = np.array([[18.0], [72.0]])


def pendulum(slope: float) -> Polytope:
    """x1' = x2, x2' = phi(x1), |phi'| <= slope, y = x1."""
    return Polytope(np.eye(2, k=1), np.eye(2)[:, 1:], np.eye(2)[:1], np.array([-slope]), np.array([slope]), np.eye(1, 2))


def constant(model: Polytope) -> list[np.ndarray]:
    return [model.at(rho) for rho in np.linspace(model.lower, model.upper, 21)]


def two_outputs() -> tuple[Polytope, np.ndarray]:
    """Three states, two outputs, two channels of which one enters twice."""
    a, c = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, -0.5]]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    b, seen = np.array([[0.0, 0, 1], [0, 1, 0], [1, 0, 0]]).T, np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
    bound = np.array([0.5, 0.3, 0.5])
    model = Polytope(a, b, seen, -bound, bound, c, tied=(0, 1, 0))
    return model, np.array([[4.0, 0.0], [4.0, 1.0], [0.0, 2.0]])


@pytest.fixture(scope="module")
def rows():
    return sampling(pendulum(1.0), GAIN, rtol=1e-3)


def test_what_each_period_is_worth(rows):
    """L = (18, 72): the Euler model keeps its promise far beyond the period from which on the observer is unstable; Wirtinger's
    inequality stops well below it, the tube just below."""
    model = pendulum(1.0)
    euler, wirtinger, tube = rows
    assert [row.model for row in rows] == [
        "Euler model only",
        "the continuous plant (Wirtinger)",
        "the continuous plant (tube)",
    ]
    assert all(row.certificate.verify() for row in rows)
    true = oracle.limit(constant(model), GAIN, model.output)
    frozen = oracle.euler_limit(constant(model), GAIN, model.output)
    print(f"\nEuler corners {euler.delta:.6f} (frozen {frozen:.6f}), true limit {true:.6f}, ", end="")
    print(f"Wirtinger {wirtinger.delta:.6f}, tube {tube.delta:.6f}")
    assert 0.164 <= euler.delta <= frozen
    assert 0.1105 < true < 0.1115
    assert 0.087 <= wirtinger.delta < 0.9 * true
    assert 0.998 * true <= tube.delta <= true


def test_sampling_without_channels_is_the_monodromy_matrix():
    model = Polytope(
        np.array([[0.0, 1.0], [-3.0, 0.2]]), np.zeros((2, 0)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.eye(1, 2)
    )
    gain = np.array([[5.0], [4.0]])
    true = oracle.limit([model.a], gain, model.output, high=0.6)
    assert 0.995 * true <= largest_delta(model, gain) <= true
    frozen = oracle.euler_limit([model.a], gain, model.output)  # one matrix: its eigenvalues decide
    assert 0.998 * frozen <= euler_delta(model, gain) <= frozen


@pytest.mark.parametrize("degree", [0, 5])
@pytest.mark.parametrize("rate", [0.0, 1.5])
def test_every_walk_within_the_certificate_decays(degree, rate):
    """Random intervals, parameters that jump between samples: the certificate's own norm falls by the promised factor."""
    rng = np.random.default_rng(1)
    for model, gain in ((pendulum(1.5), GAIN), two_outputs()):
        own = min(rate, 0.2 if model.n == 3 else rate)
        delta = largest_delta(model, gain, rate=own, degree=degree, rtol=0.05)
        certificate = sampled_data(model, gain, delta=delta, rate=own, degree=degree)
        assert certificate.verify().margins == {"decay_rate": own}
        norm = np.linalg.inv(certificate.start) if degree else np.array(certificate.p)
        for _ in range(2):
            times, errors, since = oracle.walk(model, gain, delta, pieces=4, samples=12, rng=rng)
            values = np.einsum("ti,ij,tj->t", errors, norm, errors)
            at_samples = values[np.flatnonzero(since == 0).tolist() + list(range(4, len(times), 4))]
            assert np.all(values <= values[0] * np.exp(-2 * own * times) * (1 + 1e-9))
            assert np.all(np.diff(at_samples) < 0)


@pytest.mark.parametrize("degree", [0, 5])
def test_injected_innovations_are_held_too(degree):
    """f(z + K (y - C z)) with the innovation of the last sample: G depends on rho, and the walks have that G."""
    model, inner = pendulum(8.0), np.array([[0.6]])
    plain, delta = (largest_delta(model, GAIN, degree=degree, rtol=0.02, inner=one) for one in (None, inner))
    assert delta != plain
    certificate = sampled_data(model, GAIN, delta=delta, degree=degree, inner=inner)
    assert certificate.inner == ((0.6,),)
    norm = np.linalg.inv(certificate.start) if degree else np.array(certificate.p)
    _, errors, _ = oracle.walk(model, GAIN, delta, 4, 15, np.random.default_rng(5), inner)
    values = np.einsum("ti,ij,tj->t", errors, norm, errors)
    assert np.all(np.diff(values[::4]) < 0)
    with pytest.raises(
        ValueError, match=r"sampled_data.inner: given shape \(2, 1\); expected finite numbers of shape \(1, 1\)"
    ):
        sampled_data(model, GAIN, delta=0.01, inner=np.ones((2, 1)))


def test_longer_tubes_and_slower_rates_allow_longer_periods():
    model = pendulum(1.0)
    by_degree = [largest_delta(model, GAIN, degree=degree, rtol=1e-2) for degree in (1, 2, 3, 4)]
    assert by_degree == sorted(by_degree)
    by_rate = [largest_delta(model, GAIN, rate=rate, degree=degree, rtol=1e-2) for degree in (0, 5) for rate in (4.0, 1.0, 0.0)]
    assert by_rate[:3] == sorted(by_rate[:3])
    assert by_rate[3:] == sorted(by_rate[3:])
    assert all(tube > wirtinger for wirtinger, tube in zip(by_rate[:3], by_rate[3:], strict=True))


def test_the_constant_of_wirtingers_inequality_at_a_rate():
    """kappa of the certificate is below the exact constant, and equal to it at both ends."""
    for x in np.linspace(0, 0.999, 40):
        kappa = 9.8696 / 4 * (1 - x) + x**2
        assert kappa <= oracle.wirtinger(x)
        assert kappa > 0.85 * oracle.wirtinger(x)
    assert oracle.wirtinger(0.0) == pytest.approx(9.8696 / 4, rel=1e-6)
    assert oracle.wirtinger(0.99999) == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize("kind", [Sampled, SampledTube])
def test_anything_worse_is_refused(kind, tmp_path):
    certificate = sampled_data(pendulum(1.0), GAIN, delta=0.08, rate=0.5, degree=5 if kind is SampledTube else 0)
    assert type(certificate) is kind
    certificate.to_json(tmp_path / "c.json")
    again = load(tmp_path / "c.json")
    assert again == certificate
    assert again.verify()
    assert "continuous plant" in again.assumptions[0]
    metric = "start" if kind is SampledTube else "p"
    worse = [
        {"delta": 0.12},
        {"delta": 0.0},
        {"delta": -0.01},
        {"rate": 20.0},
        {"rate": -0.5},
        {"upper": (60.0,)},
        {"gain": ((40.0,), (72.0,))},
        {metric: tuple(tuple(-x for x in row) for row in getattr(certificate, metric))},
        {"inner": ((100.0,),)},
    ]
    worse += [{"tube": certificate.tube[:-1]}, {"tube": certificate.tube[3:]}] if kind is SampledTube else [{"w": ((-1.0,),)}]
    for change in worse:
        verdict = dataclasses.replace(certificate, **change).verify()
        assert not verdict, change
        assert verdict.why.startswith("not certified")
    assert dataclasses.replace(certificate, delta=0.04).verify().holds is (kind is Sampled)  # a tube has its own length


def test_what_cannot_be_proved_is_said_so():
    model = pendulum(1.0)
    with pytest.raises(Infeasible, match=r"proves no decay at 0 /s with samples up to 0\.12 s apart") as caught:
        sampled_data(model, GAIN, delta=0.12)
    assert 0.1 < caught.value.best < 0.111
    assert "unstable" not in str(caught.value)
    with pytest.raises(Infeasible, match="A tube may do more: degree=5"):
        sampled_data(model, GAIN, delta=0.1, degree=0)
    with pytest.raises(Infeasible, match="decay rate"):
        sampled_data(model, np.array([[-1.0], [2.0]]), delta=0.01)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"delta": 0.0}, r"sampled_data.delta: given 0.0; expected a positive number"),
        ({"rate": -1.0}, r"sampled_data.rate: given -1.0; expected a number >= 0"),
        ({"degree": -1}, r"sampled_data.degree: given -1; expected an integer >= 0"),
        ({"gain": np.ones((1, 2))}, "looks transposed"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    given = {"gain": GAIN, "delta": 0.05} | change
    with pytest.raises(ValueError, match=message):
        sampled_data(pendulum(1.0), **given)


def observer(dt: float, holds: str) -> observers.Sampled:
    return observers.Sampled(observers.Luenberger(plants.Pendulum(), GAIN), integrators.RK4(4), dt, holds)


def last_error(dt: float, holds: str, steps: int = 150) -> float:
    run = jaxobs.simulate(plants.Pendulum(), observer(dt, holds), x0=[1.0, 0.0], xhat0=[0.0, 0.0], ts=dt * np.arange(steps))
    return float(jnp.max(jnp.abs(run.x[-20:] - run.xhat[-20:])))


def test_the_observer_converges_at_the_certified_period_and_not_beyond_the_limit(rows):
    """|phi'| <= 1 for the pendulum without input. Held outputs leave an error; held innovations do not."""
    assert last_error(rows[1].delta, "innovation") < 1e-6
    assert last_error(0.95 * rows[2].delta, "innovation") < 1e-3
    assert last_error(rows[1].delta, "output") > 1e-2
    assert last_error(0.125, "innovation") > 0.1
    assert rows[0].delta > 0.125  # though the Euler model's corners still promise decay


def test_one_held_step_is_the_matrix_exponential():
    """With phi = 0 the observer over one period is exactly linear."""
    dt = 0.09
    one = observers.Sampled(observers.Luenberger(plants.IntegratorChain(2), GAIN), integrators.RK4(), dt, "innovation")
    chain = np.eye(2, k=1)
    z, _ = one.step(jnp.asarray(0), one.init(jnp.array([0.3, -0.2])), jnp.zeros(0), jnp.array([1.0]))
    expected = oracle.over(chain, -GAIN, dt) @ np.array([0.3, -0.2, 1.0 - 0.3])
    np.testing.assert_allclose(z, expected[:2], rtol=1e-12)


def test_held_innovations_under_transformations_and_in_float32():
    @jax.jit
    def step(one, y):
        return one.step(jnp.asarray(3), one.init(jnp.array([0.3, -0.2], y.dtype)), jnp.zeros(1, y.dtype), y)[0]

    one = observers.Sampled(observers.Luenberger(plants.Pendulum(), GAIN), integrators.RK4(), 0.05, "innovation")
    ys = jnp.linspace(-1, 1, 5)[:, None]
    batched = jax.vmap(step, (None, 0))(one, ys)
    np.testing.assert_allclose(batched[2], step(one, ys[2]), rtol=1e-12)
    slope = jax.grad(lambda y: step(one, y[None])[0])(ys[2, 0])
    assert slope == pytest.approx(float(batched[3, 0] - batched[1, 0]), rel=1e-2)  # over a unit of y
    single = step(jaxobs.astype(one, jnp.float32), jnp.zeros(1, jnp.float32))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, batched[2], rtol=1e-5)


def test_other_holds_are_refused():
    with pytest.raises(ValueError, match=r"Sampled.holds: given 'error'; expected 'output' or 'innovation'"):
        observer(0.05, "error")
