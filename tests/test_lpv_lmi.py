"""designs.lpv_lmi: the certificate against the nonlinear error itself, rates, gains, refusals."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lpv_cases import HIGH, LORENZ, LOW, T, arrays, joint_channels, lorenz_entries, saturated

import jaxobs
from jaxobs import designs, plants
from jaxobs._module import Scalar, param
from jaxobs.designs import Channels, Infeasible, lpv_lmi, lpv_rate, midpoint_channels, slope_entries
from jaxobs.designs.polytope import Polytope
from jaxobs.integrators import RK4, Euler
from jaxobs.observers import InnerInjection, Luenberger, OutputInjection, Sampled, StepLuenberger
from jaxobs.plants import AbstractLipschitz, Discretised

RNG = np.random.default_rng(7)


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
