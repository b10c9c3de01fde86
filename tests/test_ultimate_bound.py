"""The error under a wrong model: bounds against simulations of the wrong model, peak gains, and scalar closed forms."""

import dataclasses

import numpy as np
import pytest

from jaxobs import plants
from jaxobs.certificates import Mismatch, load
from jaxobs.designs import Infeasible, model_gap, ultimate_bound
from jaxobs.designs.polytope import Polytope
from tests.oracles import regional as oracle

GAIN = np.array([[3.0], [4.0]])
LAST = np.array([[0.0], [1.0]])


def pendulum(slope: float = 1.0) -> Polytope:
    """phi_model(x1) with |phi_model'| <= slope."""
    return Polytope(np.eye(2, k=1), LAST, np.eye(1, 2), np.array([-slope]), np.array([slope]), np.eye(1, 2))


def scalar(pole: float) -> Polytope:
    return Polytope(np.array([[-pole]]), np.zeros((1, 0)), np.zeros((0, 1)), np.zeros(0), np.zeros(0), np.eye(1))


def test_a_scalar_error_has_its_closed_form():
    """e' = -(pole + l) e + d - l v: |e| <= (size + l noise_size) / (pole + l)."""
    for size, noise in ((0.3, 0.0), (0.0, 0.2), (0.3, 0.2)):
        found = ultimate_bound(scalar(1.0), [[4.0]], disturbance=[[1.0]], size=size, noise_size=noise)
        assert found.bound == pytest.approx((size + 4 * noise) / 5, rel=2e-3)
        assert found.bound >= (size + 4 * noise) / 5


@pytest.mark.parametrize("row", [(1.0, 0.0), (0.0, 1.0)])
def test_above_the_peak_gain_of_every_constant_parameter_and_not_by_much(row):
    """The L1 norm of a frozen error system is a lower bound that a bang-bang disturbance attains."""
    model, weight = pendulum(), np.array([row])
    found = ultimate_bound(model, GAIN, disturbance=LAST, size=0.2, weight=weight)
    lowest = 0.2 * max(oracle.peak_gain(f, LAST[:, 0], weight[0]) for f in model.closed(GAIN))
    print(f"\nbound {found.bound:.6f}, at least {lowest:.6f}, ratio {found.bound / lowest:.4f}")
    assert lowest <= found.bound <= 1.25 * lowest


def test_a_pendulum_of_the_wrong_length_and_friction():
    """The plant has 1.15 sin(x1) - 0.1 x2 in place of sin(x1): |phi - phi_model| <= 0.15 + 0.1 max |x2| along its trajectory,
    of which the worst error is a part, and the bound holds from the beginning and in the end."""
    push = 0.4

    def plant(t, x):
        return np.array([x[1], 1.15 * np.sin(x[0]) - 0.1 * x[1] + push * np.cos(0.7 * t) - 1.5 * x[0]])

    def model(t, x):
        return np.array([x[1], np.sin(x[0]) + push * np.cos(0.7 * t) - 1.5 * x[0]])

    # The same spring -1.5 x1 in both keeps the pendulum upright; it belongs to A.
    box = dataclasses.replace(pendulum(), a=np.array([[0.0, 1.0], [-1.5, 0.0]]))
    clock = lambda t, z: np.concatenate([plant(t, z), [1.0]])  # noqa: E731
    ts, x, xhat = oracle.together(
        clock, lambda z: np.append(model(z[2], z[:2]), 1.0), np.append(GAIN[:, 0], 0.0), [0.5, 0, 0], [0.5, 0, 0], 60.0, 4000
    )
    x, xhat = x[:, :2], xhat[:, :2]
    lacks = 0.15 * np.abs(np.sin(x[:, 0])) + 0.1 * np.abs(x[:, 1])
    size = 1.0001 * float(np.max(lacks))
    for weight in (np.eye(1, 2), np.array([[0.0, 1.0]]), np.eye(2)):
        found = ultimate_bound(box, GAIN, disturbance=LAST, size=size, weight=weight, origin="a simulation")
        worst = np.linalg.norm((x - xhat) @ weight.T, axis=1)
        print(f"\nbound {found.bound:.6f}, worst error {worst.max():.6f}, ratio {found.bound / worst.max():.3f}")
        assert worst.max() <= found.bound
        assert found.bound < 8 * worst[len(ts) // 2 :].max()


def test_how_far_a_plant_is_from_its_model_is_proved(as_users_have_it):
    """0.15 sin x1 - 0.1 x2, what is left of two pendulums: its supremum in closed form, whatever the inputs in common."""
    plant, model = plants.Pendulum(1.15, 0.1), plants.Pendulum()
    a, b = float(plant.a), float(plant.b)
    found = model_gap(plant, model, ([-1.5, -2.0], [1.5, 2.0]))
    np.testing.assert_array_equal(found.disturbance, LAST)
    sup = (a - 1) * np.sin(1.5) + 2 * b
    assert found.attained <= found.size <= sup * (1 + 1e-6)
    assert found.attained >= sup * (1 - 1e-6)
    anywhere = model_gap(plant, model, ([-np.inf, -2.0], [np.inf, 2.0]))
    assert anywhere.size == pytest.approx(a - 1 + 2 * b, rel=1e-6)
    assert "x2 in [-2.0, 2.0]" in anywhere.origin
    certificate = ultimate_bound(pendulum(), GAIN, disturbance=found.disturbance, size=found.size, origin=found.origin)
    assert found.origin in certificate.assumptions[-1]


def test_gaps_of_several_components_and_of_none(as_users_have_it):
    one, other = plants.Lorenz(10.0, 28.0, 2.5), plants.Lorenz(10.0, 27.0, 2.6)
    found = model_gap(one, other, (-np.ones(3), np.ones(3)))
    np.testing.assert_array_equal(found.disturbance, np.eye(3)[:, 1:])
    assert found.size == pytest.approx(np.hypot(1.0, 0.1), rel=1e-6)  # (x1, 0.1 x3)
    assert found.size >= found.attained
    assert model_gap(one, one, (-np.ones(3), np.ones(3))).size == 0
    assert model_gap(lambda x: x + 0.25, lambda x: x, ([-np.inf], [np.inf])).size == pytest.approx(0.25, rel=1e-12)
    with pytest.raises(ValueError, match=r"model_gap.box: given nothing bounds x1 or 0\.1.*x3"):
        model_gap(one, other, (-np.full(3, np.inf), np.full(3, np.inf)))
    with pytest.raises(ValueError, match=r"model_gap.model: given inputs \('t',\); expected \('u1', 't'\)"):
        model_gap(plants.Pendulum(), one, (-np.ones(2), np.ones(2)))
    with pytest.raises(ValueError, match=r"model_gap\.box: given 2 states"):
        model_gap(lambda x: x[:1], lambda x: 2 * x[:1], (-np.ones(2), np.ones(2)))


@pytest.mark.parametrize("inner", [0.0, 0.8])
def test_the_transient_is_bounded_as_claimed(inner):
    """|weight e(t)|^2 <= bound^2 (1 + e^{-alpha t} (V(0) - 1)) from a large error under a bang-bang disturbance and noise."""
    model = pendulum()
    found = ultimate_bound(model, GAIN, disturbance=LAST, size=0.2, noise_size=0.05, inner=[[inner]])
    assert found.inner == (((inner,),) if inner else ())
    rng, p = np.random.default_rng(3), np.array(found.p)
    e, dt, now = np.array([1.0, -2.0]), 2e-3, 0.0
    start = e @ p @ e
    for k in range(4000):
        if k % 200 == 0:
            rho, d, v = rng.choice([-1, 1]), 0.2 * rng.choice([-1, 1]), 0.05 * rng.choice([-1, 1])
            injected = GAIN + LAST * rho * inner
            f, push = model.at(np.array([rho])) - injected @ model.output, LAST[:, 0] * d - injected[:, 0] * v
        middle = e + dt / 2 * (f @ e + push)
        e, now = e + dt * (f @ middle + push), now + dt
        assert e @ e <= found.bound**2 * (1 + np.exp(-found.alpha * now) * (start - 1)) * (1 + 1e-6)
    assert e @ p @ e < 1


def test_more_of_anything_is_a_larger_bound():
    def bound(slope=1.0, size=0.2, **options):
        return ultimate_bound(pendulum(slope), GAIN, disturbance=LAST, size=size, **({"alpha": 0.5} | options)).bound

    base = bound()
    assert bound(size=0.4) == pytest.approx(2 * base, rel=1e-4)  # it is linear
    assert bound(noise_size=0.02) > base
    assert bound(1.4) > base
    assert bound(alpha=None) <= base * (1 + 1e-6)


def test_anything_better_is_refused(tmp_path):
    certificate = ultimate_bound(pendulum(), GAIN, disturbance=LAST, size=0.2, noise_size=0.01)
    assert certificate.verify().margins == {"bound": certificate.bound}
    certificate.to_json(tmp_path / "c.json")
    again = load(tmp_path / "c.json")
    assert isinstance(again, Mismatch)
    assert again == certificate
    assert again.verify()
    for change in (
        {"bound": certificate.bound * 0.999},
        {"bound": -certificate.bound},
        {"size": 0.21},
        {"size": -0.2},
        {"noise_size": 0.011},
        {"alpha": certificate.alpha * 1.1},
        {"alpha": -1.0},
        {"beta": certificate.beta * 1.01},
        {"beta": certificate.beta * 0.5},
        {"upper": (2.0,)},
        {"disturbance": ((0.3,), (1.0,))},
        {"weight": ((1.1, 0.0), (0.0, 1.1))},
        {"inner": ((50.0,),)},
        {"inner": ((0.1,),), "taus": (1.0,)},
    ):
        verdict = dataclasses.replace(certificate, **change).verify()
        assert not verdict, change
        assert verdict.why.startswith("not certified")


def test_what_cannot_be_proved_is_said_so():
    with pytest.raises(Infeasible, match="alpha has to be below"):
        ultimate_bound(pendulum(), GAIN, disturbance=LAST, size=0.2, alpha=50.0)
    with pytest.raises(Infeasible, match="decay rate"):
        ultimate_bound(pendulum(), [[-1.0], [0.0]], disturbance=LAST, size=0.2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": -1.0}, "ultimate_bound.size: given -1.0; expected a number >= 0"),
        ({"size": 0.0}, "ultimate_bound.size: given 0.0 and noise_size 0.0; .*corner_lmi.prove"),
        ({"disturbance": np.ones((1, 2))}, "ultimate_bound.disturbance: given shape .* 2 rows"),
        ({"weight": np.ones((2, 1))}, "ultimate_bound.weight: given shape .* 2 columns"),
        ({"weight": np.zeros((1, 2))}, "ultimate_bound.weight: given zero"),
        ({"alpha": 0.0}, "ultimate_bound.alpha: given 0.0; expected a positive number"),
    ],
)
def test_bad_arguments_are_refused(change, message):
    given = {"disturbance": LAST, "size": 0.2} | change
    with pytest.raises(ValueError, match=message):
        ultimate_bound(pendulum(), GAIN, **given)
