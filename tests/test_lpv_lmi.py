"""designs.lpv_lmi: the certificate against the nonlinear error itself, structure of bounds, undetectable points, refusals."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import lpv

import jaxobs
from jaxobs import designs, plants
from jaxobs._module import Scalar, param
from jaxobs.designs import Channels, Infeasible, corner_lmi, lpv_lmi, lpv_model, lpv_rate, midpoint_channels, slope_entries
from jaxobs.designs.polytope import Polytope
from jaxobs.integrators import RK4, Euler
from jaxobs.observers import InnerInjection, Luenberger, OutputInjection, Sampled, StepLuenberger
from jaxobs.plants import AbstractLipschitz, Discretised

RNG = np.random.default_rng(7)
T = 0.001
LOW, HIGH = np.array([-30.0, -30.0, -2.0]), np.array([30.0, 30.0, 58.0])
LORENZ = plants.Lorenz()


class Wavy(AbstractLipschitz):
    """x' = -rate x + sin x + y^2, y = x: one state, whose g knows the output."""

    rate: Scalar = param(default=1.5)
    n, m, p = 1, 0, 1

    def a(self):
        return -self.rate[None, None]

    def b(self):
        return jnp.ones((1, 1), self.rate.dtype)

    def c(self):
        return jnp.ones((1, 1), self.rate.dtype)

    def f(self, x):
        return jnp.sin(x)

    def g(self, y, u):
        return y**2


def arrays(kind, *values, **others):
    return kind(*(np.asarray(value, float) for value in values), **others)


def lorenz_entries(low=LOW, high=HIGH):
    return tuple(np.array([[x[2], 0, x[0]], [x[1], x[0], 0]]) for x in (low, high))


def joint_channels(angle):
    return arrays(Channels, np.eye(2), [[-1, 0, 1, 0], [0, 0, 1, 0]], [0, -1], [3 * angle**2, 1])


def saturated():
    return plants.Saturated(LORENZ, LOW, HIGH)


def joint_points(count):
    """States of the joint whose motor and link differ by at most 1 rad; z too."""
    x = RNG.uniform(-3, 3, (2, count, 4))
    x[..., 2] = x[..., 0] + RNG.uniform(-1, 1, (2, count))
    return x


def box(low, high):
    return lambda count: RNG.uniform(low, high, (2, count, len(low)))


# plant, what lpv_lmi is told, the observer it makes, and pairs (x, estimate) for which its bounds hold
DESIGNS = {
    "Duffing": (plants.ForcedDuffing(), {"bounds": ([[0, 0]], [[12.0, 0]]), "rate": 0.5}, Luenberger, box([-2, -9], [2, 9])),
    "joint": (plants.FlexibleJoint(), {"bounds": joint_channels(1.0), "rate": 2.0}, Luenberger, joint_points),
    "Lorenz, midpoint": (LORENZ, {"bounds": midpoint_channels(LORENZ, LOW, HIGH)}, Luenberger, box(LOW, HIGH)),
    "Lorenz step, midpoint": (
        Discretised(LORENZ, Euler(), T), {"bounds": midpoint_channels(LORENZ, LOW, HIGH), "rate": 0.999},
        StepLuenberger, box(LOW, HIGH)),
    "Lorenz step, inner": (
        Discretised(LORENZ, Euler(), T), {"bounds": lorenz_entries(), "inner": True}, Sampled, box(LOW, HIGH)),
    "Lorenz step, saturated": (
        Discretised(saturated(), Euler(), T), {"bounds": lorenz_entries(), "rate": 0.999}, StepLuenberger,
        lambda count: np.stack([RNG.uniform(LOW, HIGH, (count, 3)), RNG.normal(size=(count, 3)) * 200])),
    "Van der Pol chain": (plants.VanDerPol(), {"bounds": ([[-9, -3]], [[7, 1.0]])}, Luenberger, box([-2, -2], [2, 2])),
    "Van der Pol chain, inner": (
        plants.VanDerPol(), {"bounds": ([[-9, -3]], [[7, 1.0]]), "inner": True}, OutputInjection, box([-2, -2], [2, 2])),
    "g knows y": (Wavy(), {"bounds": ([[-1.0]], [[1.0]]), "rate": 2.0}, InnerInjection, box([-5], [5])),
}  # fmt: skip


@functools.cache
def made(name):
    plant, wishes, *_ = DESIGNS[name]
    return lpv_lmi(plant, **wishes)


def moved(plant, observer, x, z):
    """(x, z) after a step, or their derivatives, with the measurement of x."""
    u, t = jnp.ones(plant.m), jnp.asarray(0.0)
    y = plant.h(x, u)
    if isinstance(observer, Sampled):
        start = (z, observer.init(z)[1])
        return plant.step(jnp.asarray(0), x, u), observer.step(jnp.asarray(0), start, u, y)[0]
    if isinstance(observer, StepLuenberger):
        return plant.step(jnp.asarray(0), x, u), observer.step(jnp.asarray(0), z, u, y)
    return plant.flow(t, x, u), observer.flow(t, z, u, y)


@pytest.mark.parametrize("name", DESIGNS)
def test_the_error_of_the_observer_itself_decays_as_certified(name):
    """e'P e along the nonlinear equations, for random states and estimates between which the bounds hold."""
    plant, _, kind, pairs = DESIGNS[name]
    observer, certificate = made(name)
    assert type(observer) is kind
    assert certificate.verify()
    p = np.asarray(certificate.p)
    xs, zs = pairs(2000)
    ahead = jax.jit(jax.vmap(lambda x, z: moved(plant, observer, x, z)))(xs, zs)
    e, de = xs - zs, np.asarray(ahead[0] - ahead[1])
    energy = np.einsum("ki,ij,kj->k", e, p, e)
    if isinstance(certificate, designs.corner_lmi.StepCorners):
        assert (np.einsum("ki,ij,kj->k", de, p, de) <= certificate.factor**2 * energy * (1 + 1e-9)).all()
    else:
        change = 2 * np.einsum("ki,ij,kj->k", e, p, de)
        assert (change <= -2 * certificate.rate * energy + 1e-9 * (energy + np.abs(change))).all()


def test_the_bounds_are_needed():
    """Pairs far outside them break what is certified inside."""
    plant = DESIGNS["Lorenz, midpoint"][0]
    observer, certificate = made("Lorenz, midpoint")
    p = np.asarray(certificate.p)
    xs, zs = RNG.normal(size=(2, 2000, 3)) * 1e4
    ahead = jax.jit(jax.vmap(lambda x, z: moved(plant, observer, x, z)))(xs, zs)
    assert np.max(np.einsum("ki,ij,kj->k", xs - zs, p, np.asarray(ahead[0] - ahead[1]))) > 0


def test_a_saturated_model_converges_from_anywhere():
    observer, certificate = made("Lorenz step, saturated")
    assert any("estimate is free" in line for line in certificate.assumptions)
    run = jaxobs.simulate(
        Discretised(LORENZ, Euler(), T), observer, x0=[1.0, 2, 20], xhat0=[3e4, -2e4, 9e4], ts=np.arange(20001) * T
    )
    assert np.max(np.abs(run.x[-1] - run.xhat[-1])) < 1e-3


@pytest.mark.parametrize(
    ("model", "corners"),
    [
        (lambda: lpv_model(plants.ForcedDuffing(), slope_entries([[0, 0]], [[45.86, 0]])), 2),
        (lambda: lpv_model(plants.FlexibleJoint(), joint_channels(1.0)), 4),
        (lambda: lpv_model(LORENZ, midpoint_channels(LORENZ, LOW, HIGH)), 8),
        (lambda: lpv_model(LORENZ, slope_entries(*lorenz_entries())), 16),
        (lambda: lpv_model(LORENZ, slope_entries(*lorenz_entries()), inner=True), 8),  # y = x2: its column goes
        (lambda: lpv_model(LORENZ, midpoint_channels(LORENZ, LOW, HIGH), inner=True), 8),
    ],
)
def test_zeros_ties_and_measured_states_make_no_corners(model, corners):
    assert len(model().corners()) == corners


@pytest.mark.parametrize("plant", [LORENZ, plants.Rossler(), Discretised(LORENZ, Euler(), T)])
def test_the_midpoint_is_exact(plant):
    """A(m) (x - z) is the difference of the right-hand sides, at m = (x + z) / 2."""
    flow = plant.plant if isinstance(plant, Discretised) else plant
    channels = midpoint_channels(flow, np.full(3, -99.0), np.full(3, 99.0))
    model = lpv_model(plant, channels)
    rhs = lpv.rossler if isinstance(flow, plants.Rossler) else lpv.lorenz
    for x, z in RNG.normal(size=(8, 2, 3)) * 9:
        rho = np.where(channels.lower == channels.upper, channels.lower, ((x + z) / 2)[list(channels.tied)])
        expected = rhs(x) - rhs(z)
        if isinstance(plant, Discretised):
            expected = x - z + T * expected
        np.testing.assert_allclose(model.at(rho) @ (x - z), expected, rtol=1e-9, atol=1e-9)


def test_slopes_of_a_run_are_its_extremes():
    xs = RNG.normal(size=(500, 3)) * 5
    channels = designs.simulated_entries(LORENZ, xs)
    np.testing.assert_allclose(channels.lower, xs.min(0)[[2, 0, 1, 0]])
    np.testing.assert_allclose(channels.upper, xs.max(0)[[2, 0, 1, 0]])
    assert "conditional" in channels.origin
    _, certificate = lpv_lmi(LORENZ, bounds=channels)
    assert any("simulation" in line for line in certificate.assumptions)


def test_ties_survive_the_file(tmp_path):
    _, certificate = made("Lorenz, midpoint")
    certificate.to_json(tmp_path / "c.json")
    again = jaxobs.certificates.load(tmp_path / "c.json")
    assert again == certificate
    assert len(set(again.tied)) == 3
    assert again.verify()
    torn = dataclasses.replace(certificate, upper=(*certificate.upper[:-1], certificate.upper[-1] + 1))
    assert not torn.verify()


def test_rate_in_closed_form():
    """x' = -1.5 x + sin x + y^2 with L = l decays at 1.5 + l - 1."""
    bounds = ([[-1.0]], [[1.0]])
    assert lpv_rate(Wavy(), bounds=bounds, gain=[[0.75]]) == pytest.approx(1.25, rel=1e-3)
    lpv_lmi(Wavy(), bounds=bounds, gain=[[0.75]], rate=1.249)
    with pytest.raises(Infeasible) as refused:
        lpv_lmi(Wavy(), bounds=bounds, gain=[[0.75]], rate=1.26)
    assert refused.value.best == pytest.approx(1.25, rel=1e-2)


def test_the_certificate_is_about_the_gain_in_single_precision():
    plant = jaxobs.astype(plants.ForcedDuffing(), jnp.float32)
    observer, certificate = lpv_lmi(plant, bounds=([[0, 0]], [[12.0, 0]]), rate=0.5)
    assert observer.gain.dtype == jnp.float32
    assert np.array_equal(np.asarray(observer.gain, float), certificate.gain)
    assert certificate.verify()


def test_large_gains_warn():
    with pytest.warns(designs.LargeGain, match="lpv_lmi: a gain of"):
        lpv_lmi(plants.ForcedDuffing(), bounds=([[0, 0]], [[12.0, 0]]), gain=[[0.0], [2e6]])


# Undetectable points


def rossler(output, low=(0.0, -9.2), high=(23.0, 11.5)):
    plant = plants.Rossler(output=output)
    return lpv_model(plant, slope_entries([[low[0], 0, low[1]]], [[high[0], 0, high[1]]]))


UNDETECTABLE = {
    "Roessler, y = x1: x1 - c = a": (rossler([[1, 0, 0]]), 0.2, {1: 5.9}),
    "Roessler, y = x3: x3 = 0": (rossler([[0, 0, 1]]), 0.1, {0: 0.0}),
    "Van der Pol, y = x2: 2 mu x1 x2 = -1": (
        lpv_model(plants.VanDerPolSeen(output=[[0, 1]]), slope_entries([[-9, 0]], [[9, 4]])), 0.0, {0: -1.0}),
    "Lorenz, y = x3 on the axis": (
        arrays(Polytope, LORENZ.a(), np.eye(3)[:, :1], np.eye(3)[1:2], [-3], [4], np.eye(3)[2:]), None, {}),
}  # fmt: skip


@pytest.mark.parametrize("name", UNDETECTABLE)
def test_undetectable_points_are_named(name):
    model, growth, coordinates = UNDETECTABLE[name]
    point = designs.undetectable(model)
    assert point.is_exact
    assert ((model.lower <= point.rho) & (point.rho <= model.upper)).all()
    for place, value in coordinates.items():
        assert point.rho[place] == pytest.approx(value, abs=1e-12)
    a = model.at(np.asarray(point.rho))
    seen = [s for s in lpv.unobservable_modes(a, model.output) if s.real > -1e-9]
    assert min(abs(s - point.eigenvalue) for s in seen) < 1e-6
    assert growth is None or point.eigenvalue.real == pytest.approx(growth, abs=1e-12)
    v = np.asarray(point.direction)
    np.testing.assert_allclose(a @ v, point.eigenvalue * v, atol=1e-9)
    np.testing.assert_allclose(model.output @ v, 0, atol=1e-12)


def test_no_gain_helps_there():
    """With any L the frozen error keeps the mode."""
    model, *_ = UNDETECTABLE["Roessler, y = x1: x1 - c = a"]
    a = model.at(np.asarray(designs.undetectable(model).rho))
    for gain in RNG.normal(size=(50, 3, 1)) * 10 ** RNG.uniform(-2, 4, (50, 1, 1)):
        assert np.max(np.linalg.eigvals(a - gain @ model.output).real) > 0.2 - 1e-6


def test_nothing_is_named_where_every_point_is_observable():
    plant = Discretised(LORENZ, Euler(), T)
    assert designs.undetectable(lpv_model(plant, midpoint_channels(LORENZ, LOW, HIGH)), step=True) is None
    assert designs.undetectable(rossler([[0, 1, 0]])) is None


def test_a_decaying_hidden_mode_counts_only_against_faster_rates():
    """x1' = -x1 unseen: detectable, but not at rate 2; and for steps likewise."""
    a = np.diag([-1.0, 1.0])
    model = arrays(Polytope, a, np.zeros((2, 0)), np.zeros((0, 2)), [], [], [[0.0, 1.0]])
    assert designs.undetectable(model) is None
    assert designs.undetectable(model, rate=2.0).eigenvalue == -1
    step = dataclasses.replace(model, a=np.diag([0.5, 2.0]))
    assert designs.undetectable(step, step=True) is None
    assert designs.undetectable(step, rate=0.4, step=True).eigenvalue == 0.5


def test_an_irrational_point_is_found_in_floats():
    """(a, c) with a = [[1, rho^... ]]: x1 is seen through rho^2 - 2 only, by two tied channels in series."""
    a = np.array([[1.0, 0, 0], [0, -3, 0], [-2.0, 0, -5]])
    b, c = np.array([[0, 0], [1, 0], [0, 1.0]]), np.array([[1.0, 0, 0], [0, 1, 0]])
    # x2' = -3 x2 + rho x1, x3' = -5 x3 + rho x2 - 2 x1: at the mode s = 1 x3 sees (rho^2 / 4 - 2) x1, zero at rho = sqrt 8
    model = arrays(Polytope, a, b, c, [1.0, 1.0], [3.0, 3.0], [[0, 0, 1.0]], tied=(0, 0))
    point = designs.undetectable(model)
    assert not point.is_exact
    assert point.rho[0] == point.rho[1] == pytest.approx(np.sqrt(8))
    assert point.eigenvalue == pytest.approx(1)


def test_undetectable_points_come_before_any_solve(monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("solved")

    monkeypatch.setattr(corner_lmi, "synthesise", never)
    with pytest.raises(Infeasible, match=r"undetectable at rho = .*, 5\.9\), exactly.*whatever|measure something else"):
        lpv_lmi(plants.Rossler(output=[[1, 0, 0]]), bounds=([[0, 0, -9.2]], [[23.0, 0, 11.5]]))


# Bad input

DUFFING = plants.ForcedDuffing()
REFUSED = [
    (lambda: slope_entries([[1, 0]], [[0, 0]]), r"slope_entries.lower: given lower\[0, 0\] = 1 and upper\[0, 0\] = 0"),
    (lambda: slope_entries([[0, 0]], [[1, 0, 0]]), r"slope_entries.upper: given shape \(1, 3\); expected that of lower"),
    (lambda: slope_entries([[np.nan, 0]], [[1, 0]]), r"slope_entries.lower: given lower\[0, 0\] = nan"),
    (lambda: Channels([[1.0]], [[1.0, 0]], [2.0], [1.0]), r"Channels.lower: given lower\[0\] = 2, upper\[0\] = 1"),
    (lambda: Channels([[1.0, 2.0]], [[1.0, 0]], [0.0], [1.0]), r"Channels.left: given shape \(1, 2\)"),
    (lambda: arrays(Polytope, -np.eye(2), np.eye(2), np.eye(2), [0, 0], [1, 2], np.eye(2), tied=(0, 0)), r"Polytope.tied"),
    (lambda: arrays(Polytope, -np.eye(2), np.eye(2), np.eye(2), [0, 0], [1, 1], np.eye(2), tied=(0,)), r"Polytope.tied"),
    (lambda: lpv_lmi(DUFFING, bounds=([[0], [0]], [[1], [0]])), r"lpv_model.channels.left: .*They look transposed"),
    (lambda: lpv_lmi(DUFFING, bounds=3), r"lpv_lmi.bounds: given int; expected \(lower, upper\)"),
    (lambda: lpv_lmi(LORENZ, bounds=([[0, 0, -1], [-1, 0, 0]], [[1, 0, 1], [1, 0, 0]])), r"no channel for the slope .* of f_2"),
    (lambda: lpv_lmi(DUFFING, bounds=([[0, 0]], [[9, 0]]), gain=[[1.0, 2.0]]), r"Polytope.gain: .*It looks transposed"),
    (lambda: lpv_lmi(DUFFING, bounds=([[0, 0]], [[9, 0]]), rate=-1.0), r"rate: given -1.0; expected a number >= 0"),
    (lambda: lpv_lmi(plants.Duffing(), bounds=([[0, 0]], [[9, 0]])), r"lpv_model.plant: given Duffing"),
    (lambda: lpv_lmi(Discretised(LORENZ, RK4(), T), bounds=lorenz_entries()), r"given RK4 .*expected Euler\(\), one step"),
    (lambda: lpv_lmi(Discretised(LORENZ, Euler(), T), bounds=lorenz_entries(), rate=1.5), r"a factor in \]0, 1\]"),
    (lambda: midpoint_channels(DUFFING, [-1, -1], [1, 1]), r"midpoint_channels.plant: .*expected quadratic f"),
    (lambda: designs.simulated_entries(LORENZ, [1.0, 2.0]), r"simulated_entries.xs: given shape \(2,\)"),
    (lambda: lpv_lmi(saturated(), bounds=lorenz_entries(LOW + 40, HIGH + 40)), r"bounds \[38, 98\] of channel 0"),
    (lambda: lpv_lmi(saturated(), bounds=midpoint_channels(LORENZ, LOW, HIGH)), r"a channel of several states"),
    (lambda: plants.Saturated(LORENZ, HIGH, LOW), r"Saturated.lower: given .*expected lower <= upper"),
    (lambda: plants.Saturated(DUFFING.delta, LOW, HIGH), r"Saturated.plant: given"),
    (lambda: plants.Rossler(output=[[1.0, 0]]), r"Rossler.output: given shape \(1, 2\); expected shape \(p, 3\)"),
    (lambda: plants.VanDerPolSeen(output=[1.0, 0]), r"VanDerPolSeen.output: given shape \(2,\)"),
    (lambda: InnerInjection(LORENZ, np.ones((3, 1)), np.ones((1, 3))), r"InnerInjection.inner: given shape \(1, 3\)"),
    (lambda: InnerInjection(plants.VanDerPol(), np.ones((2, 1)), np.ones((2, 1))), r"InnerInjection.model: given VanDerPol"),
]  # fmt: skip


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(("call", "message"), REFUSED, ids=range(len(REFUSED)))
def test_bad_input_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


class Sideways(AbstractLipschitz):
    """A plant whose C is written as a column."""

    n, m, p = 2, 0, 1

    def a(self):
        return -jnp.eye(2)

    def b(self):
        return jnp.ones((2, 1))

    def c(self):
        return jnp.asarray([[1.0], [0.0]])

    def f(self, x):
        return jnp.sin(x[:1])

    def g(self, y, u):
        return jnp.zeros(2)


@pytest.mark.usefixtures("as_users_have_it")
def test_a_transposed_output_matrix_is_named():
    with pytest.raises(ValueError, match=r"Sideways.c: given shape \(2, 1\); expected shape \(1, 2\). It looks transposed"):
        lpv_lmi(Sideways(), bounds=([[-1, 0]], [[1, 0]]))
