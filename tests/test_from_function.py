"""Plants from two functions, and linear ones: equal to the classes that say the same, and clear about what is wrong."""

import functools
import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

import jaxobs
from jaxobs import plants
from jaxobs.plants import from_function, from_step_function

pytestmark = pytest.mark.usefixtures("hardly_optimised")


def pendulum(x, u, c):
    return [x[1], c["a"] * jnp.sin(x[0]) + u[0] * jnp.cos(x[0])]


def angle(x, u, c):
    return x[0]


def spring(x, u):
    return jnp.stack([x[1], -x[0]])


def position(x, u):
    return x[:1]


def halved(x, u):
    return x / 2


def unstable(x, u):
    return [x[0] ** 2, 0]


def numpy_sine(x, u):
    return np.sin(x[0]), 1.0


def branching(x, u):
    return [x[1], 1.0] if x[0] > 0 else [x[1], -1.0]


def beyond(x, u):
    return [x[1], x[2]]


def three(x, u):
    return jnp.concatenate([x, x[:1]])


def complex_rate(x, u):
    return jax.lax.complex(x, x)


def only_x(x):
    return x


class Callable:
    def __call__(self, x, u):
        return x


def test_the_flow_is_that_of_the_class_and_its_parameters_are_leaves():
    plant, own = from_function(pendulum, angle, n=2, m=1, parameters={"a": 1.2}), plants.Pendulum(1.2)
    rng = np.random.default_rng(0)
    x, u, t = jnp.asarray(rng.normal(size=2)), jnp.asarray(rng.normal(size=1)), jnp.asarray(0.0)
    np.testing.assert_array_equal(plant.flow(t, x, u), own.flow(t, x, u))
    np.testing.assert_array_equal(plant.h(x, u), own.h(x, u))
    slope = jax.grad(lambda p: p.flow(t, x, u)[1])(plant).parameters["a"]
    np.testing.assert_allclose(slope, jnp.sin(x[0]), rtol=1e-15)
    assert eqx.tree_equal(pickle.loads(pickle.dumps(plant)), plant)
    assert (
        jaxobs.astype(plant, jnp.float32).flow(jnp.float32(0), x.astype(jnp.float32), u.astype(jnp.float32)).dtype
        == jnp.float32
    )


def test_a_run_equals_that_of_scipy():
    plant = from_function(spring, position, n=2)
    observer = jaxobs.observers.Luenberger(plant, jnp.asarray([[2.0], [1.0]]))
    ts = np.linspace(0, 2, 21)
    run = jaxobs.simulate(plant, observer, x0=[1.0, 0.0], xhat0=[0.0, 0.0], ts=ts, integrator=jaxobs.integrators.RK4(20))
    expected = scipy.integrate.solve_ivp(
        lambda t, z: [z[1], -z[0], z[3] + 2 * (z[0] - z[2]), -z[2] + z[0] - z[2]], (0, 2), [1, 0, 0, 0],
        t_eval=ts, rtol=1e-10, atol=1e-12,
    ).y.T  # fmt: skip
    np.testing.assert_allclose(np.hstack([run.x, run.xhat]), expected, atol=1e-8)


def test_lists_scalars_and_integers_are_taken_for_arrays():
    plant = from_function(unstable, position, n=2)
    found = plant.flow(jnp.asarray(0.0), jnp.asarray([3.0, 1.0]), jnp.zeros(0))
    np.testing.assert_array_equal(found, [9.0, 0.0])
    step = from_step_function(halved, position, n=2)
    np.testing.assert_array_equal(step.step(jnp.asarray(3), jnp.asarray([3.0, 1.0]), jnp.zeros(0)), [1.5, 0.5])


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: from_function(lambda x, u: x, position, n=2), ["from_function.f", "a lambda", "pickled"]),
        (lambda: from_function(spring, functools.partial(position), n=2), ["from_function.h", "partial", "parameters="]),
        (lambda: from_function(Callable(), position, n=2), ["from_function.f", "Callable", "imported by its name"]),
        (lambda: from_function(3, position, n=2), ["from_function.f: given 3", "a function"]),
        (lambda: from_function(only_x, position, n=2), ["only_x(x)", "f(x, u)", "m = 0"]),
        (lambda: from_function(spring, angle, n=2), ["from_function.h", "angle(x, u, c)", "h(x, u)"]),
        (lambda: from_function(three, position, n=2), ["three, which returns shape (3,)", "shape (2,), n = 2"]),
        (lambda: from_function(spring, spring, n=2), ["from_function.h", "shape (2,)", "p = 1"]),
        (lambda: from_function(numpy_sine, position, n=2), ["TracerArrayConversionError", "jax.numpy"]),
        (lambda: from_function(branching, position, n=2), ["TracerBoolConversionError", "jnp.where"]),
        (lambda: from_function(beyond, position, n=2), ["IndexError", "x[n - 1]"]),
        (lambda: from_function(complex_rate, position, n=2), ["complex128", "real numbers"]),
        (lambda: from_function(spring, position, n=0), ["from_function.n: given 0", "integer >= 1"]),
        (lambda: from_step_function(three, position, n=2), ["from_step_function.f", "shape (2,)"]),
        (lambda: from_function(pendulum, angle, n=2, m=1, parameters={"a": "x"}), ["given 'x'", "real numbers"]),
        (lambda: from_function(pendulum, angle, n=2, m=1, parameters={"a": np.nan}), ["parameters", "finite numbers"]),
        (lambda: plants.Linear([[1.0, 2.0]]), ["Linear.A", "shape (1, 2)", "square"]),
        (lambda: plants.Linear([[1.0]], [[1.0], [2.0]]), ["Linear.B", "shape (1, m)"]),
        (lambda: plants.LinearStep([[1.0]], None, [[1.0, 2.0]]), ["LinearStep.C", "shape (p, 1)"]),
    ],
)
@pytest.mark.usefixtures("as_users_have_it")
def test_what_is_wrong_is_named_with_the_remedy(build, says):
    with pytest.raises(ValueError, match=r"given .*; expected") as error:
        build()
    for part in says:
        assert part in str(error.value)


def test_a_function_inside_a_function_is_refused_with_the_reason():
    def local(x, u):
        return x

    with pytest.raises(ValueError, match=r"local, defined inside a function; .* pickled"):
        from_function(local, position, n=2)


def test_linear_plants_are_their_matrices():
    a, b, c = np.asarray([[0.0, 1.0], [-2.0, -0.3]]), np.asarray([[0.0], [1.5]]), np.asarray([[1.0, 0.2]])
    plant, t = plants.Linear(a, b, c), jnp.asarray(0.0)
    x, u = jnp.asarray([0.3, -1.1]), jnp.asarray([0.7])
    np.testing.assert_allclose(plant.flow(t, x, u), a @ x + b @ u, rtol=1e-15)
    np.testing.assert_allclose(plant.h(x, u), c @ x, rtol=1e-15)
    assert (plant.n, plant.m, plant.p) == (2, 1, 1)
    matrix, rest = plant.split(t, x, u)
    np.testing.assert_array_equal(matrix, a)
    np.testing.assert_allclose(rest, b @ u, rtol=1e-15)
    free = plants.Linear(a)
    assert (free.m, free.p) == (0, 2)
    np.testing.assert_allclose(free.flow(t, x, jnp.zeros(0)), a @ x, rtol=1e-15)


def test_a_linear_step_plant_is_its_matrices():
    a, b, c = np.asarray([[0.9, 0.1], [-0.2, 0.8]]), np.asarray([[0.0], [1.5]]), np.asarray([[1.0, 0.2]])
    plant, k, x, u = plants.LinearStep(a, b, c), jnp.asarray(0), jnp.asarray([0.3, -1.1]), jnp.asarray([0.7])
    np.testing.assert_allclose(plant.step(k, x, u), a @ x + b @ u, rtol=1e-15)
    np.testing.assert_allclose(plant.h(x, u), c @ x, rtol=1e-15)
    assert (plant.n, plant.m, plant.p) == (2, 1, 1)
