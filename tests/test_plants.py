"""Every plant against its printed equations, in plain NumPy at random points."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from cases import build

from jaxobs import plants

RNG = np.random.default_rng(1)
SIN, COS = np.sin, np.cos


def lorenz(x):
    return np.asarray([10 * (x[1] - x[0]), 28 * x[0] - x[1] - x[0] * x[2], x[0] * x[1] - 2.5 * x[2]])


def joint(x, u):
    d = x[2] - x[0]
    torque = 1.1 * d + 0.9 * d**3
    return [x[1], (torque - 0.4 * x[1] + 0.6 * u[0]) / 0.7, x[3], -(torque + 0.8 * 9.8 * 0.5 * SIN(x[2])) / 1.3]


def rossler(x, u):
    return [-x[1] - x[2], x[0] + 0.3 * x[1], 0.2 + x[2] * (x[0] - 5)]


def saturated(x, u):
    s = np.minimum(np.maximum(x, [-0.5, -0.4, 0.0]), [0.6, 0.5, 0.8])
    return lorenz(x) + np.asarray([0, x[0] * x[2] - s[0] * s[2], s[0] * s[1] - x[0] * x[1]])


def leg(x):
    torque = x[2] + 9 * SIN(x[0] + 0.2) + 0.4 * x[1]
    return np.asarray([x[1], x[2], -9 * COS(x[0] + 0.2) * x[1] - 0.4 * x[2] - 0.6 * torque])


def pendulum(x, u):
    return np.asarray([x[1], 1.2 * SIN(x[0]) + u[0] * COS(x[0]) - 0.3 * x[1]])


def learned(x):
    hidden = np.tanh(np.asarray([[0.5, -0.2], [0.1, 0.9]]) @ ((x - [0.2, 0]) / [1, 2]) + [0.1, -0.3])
    phi = 2 * hidden[0] - hidden[1]
    return np.asarray([x[0] + 0.1 * x[1] + 0.005 * phi, x[1] + 0.1 * phi])


def tones(x):
    def turn(d, frequency, decay):
        w = 2 * np.pi * frequency * 0.1
        return np.exp(-decay * 0.1) * np.asarray([[COS(w), -SIN(w)], [SIN(w), COS(w)]]) @ d

    return np.concatenate([[x[0] + 0.1 * x[1], x[1]], turn(x[2:4], 2.0, 0.1), turn(x[4:6], 0.7, 0.0)])


def first(x):
    return x[:1]


# The right-hand side and the output of each plant, at the parameters of tests/cases.py.
def motor(x, u):
    friction = 0.2 * np.tanh(x[1] / 0.6) + 0.1 * x[1]
    return [(u[1] - x[0] - 1.1 * u[0] * x[1]) / 0.4, (1.1 * u[0] * x[0] - friction - x[2]) / 0.5, 0]


def hovercraft(x, u):
    drag = -0.7 * x[2:4] / np.sqrt(1 + x[2] ** 2 + x[3] ** 2)
    thrust = u[0] * x[4] * np.asarray([np.cos(u[1]), np.sin(u[1])])
    return [*x[2:4], *(thrust + drag), 0]


def swing(x, u):
    return np.asarray([x[1] + 0.3 * x[0] ** 3, -SIN(x[0]) + u[0] * x[1]])


def swing_normal(z, u):
    """z = (x1, x2 + 0.3 x1^3)."""
    return [z[1], -SIN(z[0]) + u[0] * (z[1] - 0.3 * z[0] ** 3) + 0.9 * z[0] ** 2 * z[1]]


def linear(x, u):
    return [x[1], -2 * x[0] - 0.3 * x[1] + 1.5 * u[0]]


def lienard(x, u):
    return [x[1] + 1.3 * (x[0] - x[0] ** 3 / 3), -x[0]]


def duffing(x, u):
    return [x[1], -1.1 * x[0] - 0.7 * x[0] ** 3]


EQUATIONS = {
    "BlockTriangularOf": (hovercraft, lambda x: x[:2]),
    "ChainOf": (pendulum, first),
    "FlowFunction": (swing, first),
    "Linear": (linear, lambda x: x[:1] + 0.2 * x[1:]),
    "LinearStep": (lambda x, u: [0.9 * x[0] + 0.1 * x[1], -0.2 * x[0] + 0.8 * x[1] + 0.1 * u[0]], first),
    "LipschitzOf": (duffing, lambda x: x[:1] + x[1:]),
    # z = (x1, x1') of Lienard's plane is van der Pol's.
    "NormalChain": (lambda z, u: [z[1], 1.3 * (1 - z[0] ** 2) * z[1] - z[0]], first),
    "NormalTriangular": (swing_normal, first),
    "StateAffineOf": (linear, lambda x: x),
    "StepFunction": (lambda x, u: x + 0.1 * swing(x, u), first),
    "TriangularOf": (lienard, first),
    "Discretised": (lambda x, u: x + 0.1 * pendulum(x, u), first),
    "Duffing": (duffing, lambda x: x[:1] + x[1:]),
    "FieldMotor": (motor, first),
    "FlexibleJoint": (joint, lambda x: x[1::-1]),
    "ForcedDuffing": (lambda x, u: [x[1], u[0] - 0.3 * x[1] - x[0] ** 3], lambda x: 0.2 * x[:1] + x[1:]),
    "GatedChain": (lambda x, u: [u[0] * x[1], 0], first),
    "Hovercraft": (hovercraft, lambda x: x[:2]),
    "IntegratorChain": (lambda x, u: [x[1], x[2], 0], first),
    "LearnedField": (lambda x, u: learned(x), first),
    "Lienard": (lienard, first),
    "Lorenz": (lambda x, u: lorenz(x), lambda x: x[1:2]),
    "Pendulum": (pendulum, first),
    "Rossler": (rossler, lambda x: np.asarray([x[1], 0.5 * x[0] + x[2]])),
    "SampledChain": (lambda x, u: scipy.linalg.expm(0.1 * np.eye(3, k=1)) @ x, first),
    "Saturated": (saturated, lambda x: x[1:2]),
    "SineChain": (lambda x, u: [x[1], x[2], 0.3 * np.sum(SIN(x))], first),
    "SwingingLeg": (lambda x, u: leg(x), first),
    "VanDerPol": (lambda x, u: [x[1], 1.3 * (1 - x[0] ** 2) * x[1] - x[0]], first),
    "VanDerPolSeen": (lambda x, u: [x[1], 1.3 * (1 - x[0] ** 2) * x[1] - x[0]], lambda x: x[1:]),
    "WithTones": (lambda x, u: tones(x), lambda x: x[:1] + x[2] + x[4]),
}
# How a disturbance enters: by default it moves the last state alone.
MATRICES = {
    **dict.fromkeys(["FlowFunction", "Linear", "LinearStep", "NormalTriangular"], np.eye(2)),
    **dict.fromkeys(["StateAffineOf", "StepFunction", "TriangularOf"], np.eye(2)),
    "BlockTriangularOf": np.eye(5),
    "FieldMotor": np.eye(3),
    "Hovercraft": np.eye(5),
    "Discretised": [[0], [0.1]],
    "FlexibleJoint": [[0, 0], [0.9 / 0.7, 0], [0, 0], [-0.9 / 1.3, -0.8 * 9.8 * 0.5 / 1.3]],
    "ForcedDuffing": [[0], [-1]],
    "Lorenz": [[0, 0], [-1, 0], [0, 1]],
    "Saturated": [[0, 0], [-1, 0], [0, 1]],
    "VanDerPolSeen": [[0], [-1.3]],
    "GatedChain": np.eye(2),
    "Lienard": np.eye(2),
    "WithTones": [[0], [1], [0], [0], [0], [0]],
}


def moved(plant, x, u):
    if isinstance(plant, plants.AbstractFlowPlant):
        return plant.flow(jnp.asarray(0.7), x, u)
    return plant.step(jnp.asarray(7), x, u)


@pytest.mark.parametrize("label", EQUATIONS)
def test_equations(label):
    plant = build(label)
    rhs, output = EQUATIONS[label]
    xs, us = RNG.normal(size=(20, plant.n)), RNG.normal(size=(20, plant.m))
    now, seen = jax.jit(jax.vmap(lambda x, u: (moved(plant, x, u), plant.h(x, u))))(xs, us)
    np.testing.assert_allclose(now, [rhs(x, u) for x, u in zip(xs, us, strict=True)], rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(seen, [output(x) for x in xs], rtol=1e-15)
    last = np.eye(plant.n)[:, -1:]
    np.testing.assert_allclose(plant.disturbance_matrix(), MATRICES.get(label, last), rtol=1e-15)


def test_every_plant_is_compared():
    concrete = {name for name, cls in vars(plants).items() if isinstance(cls, type) and not name.startswith("Abstract")}
    assert concrete == set(EQUATIONS)


def test_defaults_are_those_of_the_papers():
    lorenz, pendulum, sines = plants.Lorenz(), plants.Pendulum(), plants.SineChain()
    assert (lorenz.sigma, lorenz.rho, lorenz.beta) == (10, 28, 8 / 3)
    assert (pendulum.a, pendulum.b, plants.Duffing().a, plants.Duffing().b) == (1, 0, 1, 1)
    assert (sines.n, sines.k_f) == (5, 1)


def test_energy_of_duffing_is_constant():
    plant = build("Duffing")

    def energy(x):
        return x[1] ** 2 / 2 + plant.a * x[0] ** 2 / 2 + plant.b * x[0] ** 4 / 4

    def rate(x):
        return jax.grad(energy)(x) @ plant.flow(jnp.asarray(0.0), x, jnp.zeros(0))

    np.testing.assert_allclose(jax.vmap(rate)(RNG.normal(size=(20, 2))), 0, atol=1e-14)


@pytest.mark.parametrize(("a", "b", "most"), [(1.0, 0.0, 0.5), (1.2, 0.3, 2.0)])
def test_lipschitz_constant_of_the_pendulum(a, b, most):
    plant = plants.Pendulum(a, b)
    x, z = RNG.uniform(-4, 4, (2, 20000, 2))
    u = RNG.uniform(-most, most, (20000, 1))
    phi = jax.jit(jax.vmap(plant.phi))
    rho = np.sqrt(a**2 + most**2 + b**2)
    assert np.max(np.abs(phi(x, u) - phi(z, u)) / np.linalg.norm(x - z, axis=1)) <= rho
    slopes = np.linalg.norm(jax.jit(jax.vmap(jax.grad(plant.phi)))(x, np.sign(u) * most), axis=1)
    assert 0.999 * rho < np.max(slopes) <= rho * (1 + 1e-15)


def test_lienard_is_van_der_pol_in_other_coordinates():
    """T(x) = (x1, x2 + mu (x1 - x1^3/3)) carries one flow into the other: T'(x) f_lienard(x) = f_vanderpol(T(x))."""
    lienard, oscillator = build("Lienard"), build("VanDerPol")
    t, u = jnp.asarray(0.0), jnp.zeros(0)

    def change(x):
        return jnp.stack([x[0], x[1] + lienard.mu * (x[0] - x[0] ** 3 / 3)])

    def both(x):
        return jax.jvp(change, (x,), (lienard.flow(t, x, u),))[1], oscillator.flow(t, change(x), u)

    np.testing.assert_allclose(*jax.vmap(both)(RNG.normal(size=(20, 2))), rtol=1e-13, atol=1e-13)


def test_leg_is_a_pendulum_with_a_fading_torque():
    """theta'' = -a sin(theta - rest) - b theta' + v, v' = -c v, seen in the coordinates (theta, theta', theta'')."""
    plant = build("SwingingLeg")
    a, b, c, rest = (float(v) for v in (plant.a, plant.b, plant.c, plant.rest))

    def acceleration(angle, rate, torque):
        return -a * SIN(angle - rest) - b * rate + torque

    def own(t, s):
        return [s[1], acceleration(*s), -c * s[2]]

    flow = jax.jit(lambda t, x: plant.flow(t, x, jnp.zeros(0)))
    ts = np.linspace(0, 3, 31)
    options = {"t_eval": ts, "rtol": 1e-11, "atol": 1e-12}
    theta, rate, torque = scipy.integrate.solve_ivp(own, (0, 3), [0.4, -1.0, 5.0], **options).y
    expected = np.stack([theta, rate, acceleration(theta, rate, torque)])
    chain = scipy.integrate.solve_ivp(lambda t, x: np.asarray(flow(t, x)), (0, 3), expected[:, 0], **options).y
    np.testing.assert_allclose(chain, expected, atol=1e-8)
