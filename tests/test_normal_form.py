"""Normal coordinates: there and back, the flow in them, observers pulled back, designs from end to end."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sympy

import jaxobs
from jaxobs import designs, plants, structure
from jaxobs.observers import HighGain, IntegralHighGain, Luenberger, PulledBack
from jaxobs.plants import Duffing, Lienard, NormalChain, NormalTriangular, from_function

pytestmark = pytest.mark.usefixtures("hardly_optimised")
T0 = jnp.asarray(0.0)


def reactor(x, u):
    """Biomass and substrate with Contois growth (Gauthier, Hammouri and Othman 1992), the biomass measured."""
    growth = x[0] * x[1] / (x[0] + x[1])
    return [growth - u[0] * x[0], -growth + u[0] * (0.1 - x[1])]


def biomass(x, u):
    return x[0]


BOX, DILUTION = ([0.02, 0.02], [0.08, 0.08]), ([0.0], [0.1])


def bioreactor() -> NormalTriangular:
    return NormalTriangular(from_function(reactor, biomass, n=2, m=1), jnp.asarray([0.05, 0.05]))


@pytest.mark.slow
def test_coordinates_there_and_back_with_the_implicit_derivative():
    form, x = bioreactor(), jnp.asarray([0.03, 0.07])
    z = form.to_normal(x)
    np.testing.assert_allclose(form.to_original(z), x, rtol=1e-13)
    np.testing.assert_allclose(jax.jacfwd(form.to_original)(z), np.linalg.inv(form.jacobian(x)), rtol=1e-10)
    reverse = jax.grad(lambda z: form.to_original(z)[1])(z)
    np.testing.assert_allclose(reverse, np.linalg.inv(form.jacobian(x))[1], rtol=1e-10)
    many = jax.vmap(lambda z: form.to_original(z, x))(jnp.stack([z, 1.1 * z]))
    np.testing.assert_allclose(form.to_normal(many[1]), 1.1 * z, rtol=1e-12)


def test_a_state_outside_the_image_is_nan_in_its_lane_alone():
    form = bioreactor()
    z = form.to_normal(jnp.asarray([0.03, 0.07]))
    lanes = jax.vmap(form.to_original)(jnp.stack([z, jnp.asarray([0.03, 5.0])]))  # growth is below the biomass
    assert np.isfinite(lanes[0]).all()
    assert np.isnan(lanes[1]).all()


@pytest.mark.slow
def test_the_jacobian_equals_that_of_sympy():
    a, b, u = sympy.symbols("a b u")
    growth = a * b / (a + b)
    f = [growth - u * a, -growth + u * (sympy.Rational(1, 10) - b)]
    phi = sympy.Matrix([a, f[0].subs(u, 0)])
    at = {a: 0.03, b: 0.07, u: 0.06}
    slope = phi.jacobian([a, b])
    form, x = bioreactor(), jnp.asarray([0.03, 0.07])
    np.testing.assert_allclose(form.jacobian(x), np.asarray(slope.subs(at), float), rtol=1e-12)
    moved = np.asarray((slope * sympy.Matrix(f)).subs(at), float)[:, 0]
    np.testing.assert_allclose(form.flow(T0, form.to_normal(x), jnp.asarray([0.06])), moved, rtol=1e-11)


@pytest.mark.slow
def test_the_triangular_form_is_triangular():
    form = bioreactor()
    z = form.to_normal(jnp.asarray([0.03, 0.07]))
    slope = jax.jacfwd(lambda z: form.g(z, jnp.asarray([0.06])))(z)
    assert slope[0, 1] == 0
    step = 1e-6
    numeric = [
        (form.g(z + step * e, jnp.asarray([0.06])) - form.g(z - step * e, jnp.asarray([0.06]))) / (2 * step) for e in np.eye(2)
    ]
    np.testing.assert_allclose(slope, np.stack(numeric, axis=1), atol=1e-7)


@pytest.mark.parametrize("kind", ["HighGain", "IntegralHighGain", "Luenberger"])
def test_pulled_back_equals_the_observer_in_z_mapped_back(kind):
    plant = Lienard(1.3)
    form = NormalChain(plant, jnp.zeros(2))
    inner = {
        "HighGain": lambda: HighGain(form, [3.0, 2.0], 2.0),
        "IntegralHighGain": lambda: IntegralHighGain(form, [3.0, 3.0, 1.0], 3.0, 1),
        "Luenberger": lambda: Luenberger(form, [[4.0], [5.0]]),
    }[kind]()
    ts = np.linspace(0, 1, 21)
    ys = 0.8 * np.cos(1.1 * ts)[:, None]
    rk4 = jaxobs.integrators.RK4(40)
    mine = jaxobs.observe(PulledBack(inner), ts, ys, xhat0=[0.3, -0.2], integrator=rk4).xhat
    z0 = form.to_normal(jnp.asarray([0.3, -0.2]))
    theirs = jaxobs.observe(inner, ts, ys, xhat0=z0, integrator=rk4).xhat
    np.testing.assert_allclose(jax.vmap(form.to_original)(jnp.asarray(theirs)), mine, atol=1e-8)


def test_the_pulled_back_correction_is_the_inverse_jacobian_times_the_gain():
    form = bioreactor()
    gain = jnp.asarray([[0.5], [0.02]])
    observer, x, u, y = PulledBack(Luenberger(form, gain)), jnp.asarray([0.03, 0.07]), jnp.asarray([0.06]), jnp.asarray([0.05])
    expected = form.plant.flow(T0, x, u) + np.linalg.solve(form.jacobian(x), gain @ (y - x[:1]))
    np.testing.assert_allclose(observer.flow(T0, x, u, y), expected, rtol=1e-12)
    with pytest.raises(ValueError, match=r"PulledBack.observer.model: given Lienard"):
        PulledBack(Luenberger(Lienard(1.0), [[1.0], [1.0]]))


def test_the_slopes_in_normal_coordinates_enclose_samples():
    """Duffing with y = x1 + x2, as z1' = z2, z2' = phi: phi = d(L_f h)/dx f, by finite differences between two states."""
    form = structure.normal_form(Duffing(), states=([-0.3, -0.3], [0.3, 0.3]), count=16)
    assert isinstance(form, NormalChain)
    found = structure.normal_slopes(form, states=([-0.3, -0.3], [0.3, 0.3]), pieces=256)
    assert (found.gradient, found.pairs) == ("proved", True)
    rng = np.random.default_rng(0)
    a, b = jnp.asarray(rng.uniform(-0.3, 0.3, (2, 200, 2)))
    phi = jax.jit(jax.vmap(lambda x: form.pushed(x, jnp.zeros(0))[-1]))
    z = jax.jit(jax.vmap(form.to_normal))
    ratio = np.abs(phi(a) - phi(b)) / np.linalg.norm(np.asarray(z(a) - z(b)), axis=1)
    assert 0.5 * found.constant < ratio.max() <= found.constant
    assert "any two states of the box" in " ".join(str(found).split())


def test_a_chain_in_normal_coordinates_goes_from_design_to_estimate():
    box = ([-0.3, -0.3], [0.3, 0.3])
    form = structure.normal_form(Duffing(), states=box, count=16)
    slopes = structure.normal_slopes(form, states=box, pieces=256)
    ts = np.linspace(0, 8, 161)
    for observer, certificate in (
        designs.riccati(form, lipschitz=slopes.constant),
        designs.high_gain_lmi(form, bounds=slopes.bounds, j0=1),
    ):
        assert certificate.verify()
        rk4 = jaxobs.integrators.RK4(8)
        run = jaxobs.simulate(Duffing(), PulledBack(observer), x0=[0.2, 0.1], xhat0=[0.0, 0.0], ts=ts, integrator=rk4)
        error = np.abs(np.asarray(run.x - run.xhat))
        assert error[-1].max() < 1e-5 * error[0].max()


@pytest.mark.slow
def test_the_bioreactor_is_observed_through_its_normal_form():
    plant = from_function(reactor, biomass, n=2, m=1)
    assert "none of these forms" in str(structure.forms(plant))
    form = structure.normal_form(plant, states=BOX, inputs=DILUTION, count=32)
    assert isinstance(form, NormalTriangular)
    slopes = structure.normal_slopes(form, states=BOX, inputs=DILUTION)
    assert slopes.gradient == "proved"
    assert slopes.constant < 20
    theta, ts = 3.0, np.linspace(0, 20, 401)
    observer = PulledBack(Luenberger(form, [[2 * theta], [theta**2]]))
    signal = jaxobs.signals.Sine(0.02, 0.5, 0.0, 0.05)
    run = jaxobs.simulate(plant, observer, x0=[0.04, 0.06], xhat0=[0.04, 0.03], ts=ts, signal=signal)
    assert np.abs(run.x - run.xhat)[-1].max() < 1e-6


@pytest.mark.usefixtures("as_users_have_it")
def test_bad_arguments_are_named():
    plant = Duffing()
    with pytest.raises(ValueError, match=r"NormalChain.start: given shape \(3,\)"):
        NormalChain(plant, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"NormalChain.plant: given a plant with 2 outputs"):
        NormalChain(plants.FlexibleJoint(), [0.0] * 4)
    with pytest.raises(ValueError, match=r"normal_form.plant: given 2 outputs"):
        structure.normal_form(plants.FlexibleJoint(), states=([-1] * 4, [1] * 4))
    with pytest.raises(ValueError, match=r"normal_form.states: given a box in which det dPhi/dx has both signs"):
        structure.normal_form(plants.VanDerPolSeen(1.0, [[0.0, 1.0]]), states=([-1.0, -1.0], [1.0, 1.0]), count=16)
    with pytest.raises(ValueError, match=r"normal_slopes.states: given \[0.0, inf\] to"):
        structure.normal_slopes(NormalChain(plant, [0.0, 0.0]), states=([0.0, np.inf], [1.0, np.inf]))
