"""Grids of observers, and what is computed over them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import build

import jaxobs
from jaxobs import Family, grid, noise, observers, over, signals
from jaxobs.plants import Pendulum

TS = np.linspace(0, 1, 11)
GAMMAS, AS = np.asarray([2.0, 3.0, 5.0, 8.0]), np.asarray([0.5, 1.2])
KEYS = jax.random.split(jax.random.key(0), 3)
OBSERVER = build("HighGain")


def loss(observer, key):
    """A pytree: the error at the end and the whole path of the estimate."""
    run = jaxobs.simulate(
        Pendulum(), observer, x0=[0.5, 0.0], xhat0=[0, 0], ts=TS, signal=signals.Sine(0.3, 2.0),
        noise=None if key is None else noise.Gaussian(0.1), key=key,
    )  # fmt: skip
    return {"error": jnp.abs(run.x[-1] - run.xhat[-1]), "path": run.xhat}


def replaced(**leaves):
    names = list(leaves)
    get = {"gamma": lambda o: o.gamma, "a": lambda o: o.model.a, "alphas": lambda o: o.alphas}
    return eqx.tree_at(lambda o: [get[n](o) for n in names], OBSERVER, [jnp.asarray(leaves[n]) for n in names])


def same(actual, desired):
    np.testing.assert_allclose(actual["error"], desired["error"], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(actual["path"], desired["path"], rtol=1e-12, atol=1e-14)


def stacked(rows):
    return jax.tree.map(lambda *leaves: np.stack(leaves), *rows)


@pytest.fixture(scope="module")
def table():
    return over(grid(OBSERVER, gamma=GAMMAS, **{"model.a": AS}), loss)(KEYS)


def test_a_full_grid_equals_the_loop(table):
    assert table["error"].shape == (4, 2, 3, 2)
    assert table["path"].shape == (4, 2, 3, 11, 2)
    loop = stacked([stacked([stacked([loss(replaced(gamma=g, a=a), k) for k in KEYS]) for a in AS]) for g in GAMMAS])
    same(table, loop)


@pytest.mark.parametrize("lanes", [1, 7])
def test_tiles_change_nothing(table, lanes):
    same(over(grid(OBSERVER, gamma=GAMMAS, **{"model.a": AS}), loss, lanes=lanes)(KEYS), table)


def test_without_keys_every_member_runs_once():
    result = over(grid(OBSERVER, gamma=GAMMAS), loss)()
    assert result["error"].shape == (4, 2)
    same(result, stacked([loss(replaced(gamma=g), None) for g in GAMMAS]))


def test_an_observer_alone_is_a_family_of_one():
    assert over(OBSERVER, loss)(KEYS)["error"].shape == (3, 2)
    same(over(OBSERVER, loss)(), loss(OBSERVER, None))


def test_a_leaf_with_an_axis_of_its_own():
    alphas = np.asarray([[1.5, 1.0], [2.0, 1.0], [3.0, 2.0]])
    family = grid(OBSERVER, alphas=alphas)
    assert family.shape == (3,)
    same(over(family, loss)(), stacked([loss(replaced(alphas=a), None) for a in alphas]))


def test_only_the_named_leaf_gets_an_axis():
    family = grid(OBSERVER, gamma=GAMMAS, **{"model.a": AS})
    assert (family.names, family.shape) == (("gamma", "model.a"), (4, 2))
    assert [jax.tree.leaves(axes) for axes in family.in_axes] == [[0], [0]]
    assert (family.in_axes[0].gamma, family.in_axes[1].model.a) == (0, 0)
    batched = eqx.tree_at(lambda o: o.gamma, OBSERVER, jnp.asarray(GAMMAS))
    gains = jax.vmap(lambda o: o.gain(), in_axes=(family.in_axes[0],))(batched)
    np.testing.assert_allclose(gains, [[1.5 * g, g**2] for g in GAMMAS], rtol=1e-15)


def test_a_member_is_an_observer():
    member = grid(OBSERVER, gamma=GAMMAS).member(jnp.asarray(7.0))
    assert eqx.tree_equal(member, replaced(gamma=7.0))


def test_values_take_the_precision_of_the_observer():
    family = grid(jaxobs.astype(OBSERVER, jnp.float32), gamma=GAMMAS)
    assert family.values[0].dtype == jnp.float32
    assert grid(OBSERVER, gamma=[2, 3]).values[0].dtype == jnp.float64


def test_a_lane_of_nan_leaves_the_others():
    def spoiled(observer, key):
        return jnp.where(observer.gamma == 3, jnp.nan, loss(observer, key)["error"])

    result, clean = over(grid(OBSERVER, gamma=GAMMAS), spoiled)(), over(grid(OBSERVER, gamma=GAMMAS), loss)()["error"]
    assert np.isnan(result[1]).all()
    keep = np.asarray([0, 2, 3])
    np.testing.assert_allclose(result[keep], clean[keep], rtol=1e-12)


def test_gradients_pass_through_a_grid():
    def total(observer):
        return jnp.sum(over(grid(observer, gamma=GAMMAS), lambda o, key: jnp.sum(o.gain()))())

    gradient = jax.grad(total)(OBSERVER)
    np.testing.assert_allclose(gradient.alphas, [GAMMAS.sum(), (GAMMAS**2).sum()], rtol=1e-14)
    assert gradient.gamma == 0


def test_values_may_be_traced():
    @jax.jit
    def gains(gammas):
        return over(grid(OBSERVER, gamma=gammas), lambda o, key: o.gain()[0])()

    np.testing.assert_allclose(gains(GAMMAS), 1.5 * GAMMAS, rtol=1e-15)


REFUSED = [
    ({"gamma": [2.0, -1.0]}, r"HighGain\.gamma: given -1\.0; expected a positive number"),
    ({"gamma": [2.0, np.nan]}, r"HighGain\.gamma: given nan"),
    ({"alphas": [[1.5, 1.0], [1.5, -1.0]]}, r"HighGain\.alphas.*root\(s\) 0\.5.*left half plane"),
    ({"gama": [2.0]}, r"grid\.gama.*one of model\.a, model\.b, alphas, gamma"),
    ({"model": [2.0]}, r"grid\.model.*one of model\.a, model\.b, alphas, gamma"),
    ({"gamma": 2.0}, r"grid\.gamma: given shape \(\); expected \(members,\)\. Give a list: gamma=\[2\.0\]"),
    ({"n": [2, 3]}, r"grid\.n: given 2, which fixes shapes.*Build one observer for each value"),
    ({"gamma": []}, r"grid\.gamma: given shape \(0,\)"),
    ({"alphas": [1.5, 1.0]}, r"grid\.alphas: given shape \(2,\)"),
    ({"alphas": [[1.5, 1.0, 1.0]]}, r"grid\.alphas: given shape \(1, 3\); expected \(members, 2\)"),
]


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(("axes", "message"), REFUSED, ids=lambda v: v if isinstance(v, str) else "")
def test_refused(axes, message):
    with pytest.raises(ValueError, match=message):
        grid(OBSERVER, **axes)


def test_a_static_field_is_no_axis():
    with pytest.raises(ValueError, match=r"grid\.q: given 2, which fixes shapes or structure"):
        grid(build("IntegralHighGain"), q=[0, 1])


@pytest.mark.parametrize("keys", [0, jax.random.key(0), jax.random.PRNGKey(0), [1, 2]], ids=["int", "key", "old key", "list"])
def test_keys_have_an_axis(keys):
    with pytest.raises(ValueError, match=r"over\.keys: given .*leading axis.*jax\.random\.split"):
        over(OBSERVER, loss)(keys)


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize("lanes", [0, 2.0, True])
def test_lanes_are_counted(lanes):
    with pytest.raises(ValueError, match=r"over\.lanes: given .*an integer >= 1"):
        over(OBSERVER, loss, lanes=lanes)


def test_parts_are_refused_by_the_name_of_their_class():
    with pytest.raises(ValueError, match=r"Discretised\.dt: given -0\.1"):
        grid(build("StepLuenberger"), **{"model.dt": [0.1, -0.1]})


def test_a_family_is_a_pytree():
    family = grid(OBSERVER, gamma=GAMMAS)
    again = jax.tree.unflatten(jax.tree.structure(family), jax.tree.leaves(family))
    assert isinstance(again, Family)
    assert eqx.tree_equal(again, family)


def test_parameters_in_a_dict_are_leaves_like_others():
    """plants.from_function keeps them so; the names of the keys are steps of the dotted name."""
    observer = observers.Luenberger(build("FlowFunction"), [[2.0], [1.0]])
    family = grid(observer, **{"model.parameters.bend": [0.0, 0.3, 1.0]})
    at = jnp.asarray([2.0, 0.5]), jnp.zeros(1)
    flows = over(family, lambda one, key: one.model.flow(jnp.zeros(()), *at)[0])()
    np.testing.assert_allclose(flows, [0.5, 0.5 + 0.3 * 8, 8.5])
    with pytest.raises(ValueError, match=r"grid\.model\.parameters\.soft: given no such number in Luenberger"):
        grid(observer, **{"model.parameters.soft": [1.0]})
