"""Time in `observe`: which estimate knows which sample, what happens to lost ones, and what is refused."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cases import DT, build

import jaxobs
from jaxobs import integrators, observers, plants
from jaxobs._module import float_leaves

T, J = 12, 5  # samples, and the one that is tampered with
RNG = np.random.default_rng(4)
TS = DT * np.arange(T)
YS = np.sin(2 * TS)[:, None] + 0.1 * RNG.normal(size=(T, 1))
US = RNG.normal(size=(T, 1))

# label of tests/cases.py -> whether the estimate at k already uses y_k
USES_NEWEST = {
    "CurrentLuenberger": True,
    "DiscreteTracker": True,
    "DiscreteTracker steady": True,
    "HighGain": False,
    "IntegralHighGain": False,
    "Sampled": False,
    "StepLuenberger": False,
    "Tracker": False,
}


def run(label, ys=YS, **options):
    observer = build(label)
    us = US if observer.m else None
    return jaxobs.observe(observer, TS, ys, us, xhat0=0.1 * jnp.arange(1.0, observer.n + 1), **options)


def tampered(k, value):
    ys = YS.copy()
    ys[k] = value
    return ys


def pendulum_loop(gamma=3.0):
    """z' = f(z, u) + L (y - z_1) by RK4 with u_k and y_k held, for the observer HighGain of tests/cases.py."""

    def flow(z, u, y):
        phi = 1.2 * np.sin(z[0]) + u * np.cos(z[0]) - 0.3 * z[1]
        return np.asarray([z[1] + 1.5 * gamma * (y - z[0]), phi + gamma**2 * (y - z[0])])

    z, path = np.asarray([0.1, 0.2]), []
    for (y,), (u,) in zip(YS, US, strict=True):
        path.append(z)
        k1 = flow(z, u, y)
        k2 = flow(z + DT / 2 * k1, u, y)
        k3 = flow(z + DT / 2 * k2, u, y)
        z = z + DT / 6 * (k1 + 2 * k2 + 2 * k3 + flow(z + DT * k3, u, y))
    return np.asarray(path)


def test_a_flow_observer_sees_held_samples():
    np.testing.assert_allclose(run("HighGain").xhat, pendulum_loop(), rtol=1e-12, atol=1e-14)
    own = observers.Sampled(build("HighGain"), integrators.RK4(), DT)
    assert (jaxobs.observe(own, TS, YS, US, xhat0=[0.1, 0.2]).xhat == run("HighGain").xhat).all()


def test_the_current_form_is_correct_then_predict():
    z, path = np.asarray([0.1, 0.2]), []
    for (y,) in YS:
        path.append(z + np.asarray([0.4, 0.9]) * (y - z[0]))
        z = np.asarray([[1, DT], [0, 1]]) @ path[-1]
    estimate = run("CurrentLuenberger")
    np.testing.assert_allclose(estimate.xhat, path, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(estimate.innovation[1:, 0], YS[1:, 0] - np.asarray(path)[:-1] @ [1, DT], atol=1e-14)


@pytest.mark.parametrize("label", USES_NEWEST)
def test_no_estimate_knows_the_future(label):
    before, after = run(label).xhat, run(label, tampered(J, 3.0)).xhat
    assert (before[:J] == after[:J]).all()
    assert np.any(before[J] != after[J]) == USES_NEWEST[label]
    assert (before[J + 2 :] != after[J + 2 :]).any()


@pytest.mark.parametrize("label", USES_NEWEST)
def test_a_lost_sample_counts_as_the_expected_one(label):
    lost = run(label, tampered([J, J + 1, T - 1], np.nan))
    assert not lost.valid[jnp.asarray([J, J + 1, T - 1])].any()
    assert (lost.valid.sum(), lost.diverged_at) == (T - 3, np.inf)
    assert (lost.innovation[~lost.valid] == 0).all()
    assert np.isfinite(lost.xhat).all()
    fed = run(label, np.asarray(lost.y))  # y holds the expectation where a sample was lost
    np.testing.assert_allclose(fed.xhat, lost.xhat, rtol=1e-12, atol=1e-13)
    nothing = run(label, np.full((T, 1), np.nan))
    assert (nothing.innovation == 0).all()
    assert np.isfinite(nothing.xhat).all()
    assert run(label, tampered(J, np.inf)).valid.sum() == T - 1


def test_the_innovation_may_be_held_instead():
    held = run("HighGain", tampered([J, J + 1], np.nan), hold_innovation=True)
    assert (held.innovation[J : J + 2] == held.innovation[J - 1]).all()
    assert held.innovation[J - 1] != 0
    assert (run("HighGain", tampered(0, np.nan), hold_innovation=True).innovation[0] == 0).all()
    plain = run("HighGain", hold_innovation=True)
    assert (plain.xhat == run("HighGain").xhat).all()


class TwoOutputs(plants.AbstractStateAffine):
    """x' = [[0, 1], [-1, 0]] x, y = x."""

    n = 2
    m = 0
    p = 2

    def a(self, u):
        return jnp.asarray([[0.0, 1.0], [-1.0, 0.0]])

    def b(self, u):
        return jnp.zeros(2)

    def c(self):
        return jnp.eye(2)


def test_outputs_are_lost_one_by_one():
    observer, ys = observers.Luenberger(TwoOutputs(), [[1.0, 0.2], [0.1, 2.0]]), np.hstack([YS, -YS])
    ys[J, 1] = np.nan
    estimate = jaxobs.observe(observer, TS, ys, xhat0=[0, 0])
    assert estimate.innovation[J, 1] == 0
    assert estimate.innovation[J, 0] == ys[J, 0] - estimate.xhat[J, 0]
    assert np.isfinite(estimate.xhat).all()


def test_a_diverging_lane_is_data_and_leaves_the_others_alone():
    observer = build("HighGain")

    def estimate(gamma):
        member = eqx.tree_at(lambda o: o.gamma, observer, gamma)
        return jaxobs.observe(member, TS, YS, US, xhat0=[0.1, 0.2], integrator=integrators.Euler())

    together = jax.jit(jax.vmap(estimate))(jnp.asarray([3.0, 1e40]))
    bad = ~np.isfinite(together.xhat[1]).all(axis=1)
    assert bad.any()
    assert not bad[0]
    assert together.diverged_at.tolist() == [np.inf, TS[np.argmax(bad)]]
    np.testing.assert_allclose(together.xhat[0], estimate(jnp.asarray(3.0)).xhat, rtol=1e-13, atol=1e-14)


def test_jit_vmap_and_grad():
    observer, ys = build("HighGain"), jnp.stack([jnp.asarray(YS), jnp.asarray(2 * YS)])

    def loss(observer, ys):
        return jnp.mean(jaxobs.observe(observer, TS, ys, US, xhat0=[0.1, 0.2]).xhat ** 2)

    lanes = jax.jit(jax.vmap(loss, in_axes=(None, 0)))(observer, ys)
    np.testing.assert_allclose(lanes, [loss(observer, y) for y in ys], rtol=1e-13)
    gradient, leaves = jax.grad(loss)(observer, YS), float_leaves(observer)
    structure, step = jax.tree.structure(observer), 6e-6
    for i, leaf in enumerate(leaves):
        for at in np.ndindex(leaf.shape):
            moved = [leaf.at[at].add(sign * step) for sign in (1, -1)]
            up, down = (loss(jax.tree.unflatten(structure, [*leaves[:i], m, *leaves[i + 1 :]]), YS) for m in moved)
            np.testing.assert_allclose(float_leaves(gradient)[i][at], (up - down) / (2 * step), rtol=1e-6, atol=1e-9)


def test_times_may_be_traced():
    traced = jax.jit(lambda ts: jaxobs.observe(build("HighGain"), ts, YS, US, xhat0=[0.1, 0.2]).xhat)(TS)
    np.testing.assert_allclose(traced, run("HighGain").xhat, rtol=1e-11)


def test_single_precision_stays_single():
    single = jaxobs.observe(jaxobs.astype(build("HighGain"), jnp.float32), TS, YS, US, xhat0=[0.1, 0.2])
    assert {leaf.dtype for leaf in float_leaves(single)} == {np.dtype(np.float32)}
    np.testing.assert_allclose(single.xhat, run("HighGain").xhat, rtol=0, atol=T * 20 * np.finfo(np.float32).eps)


def test_recorded_clocks_may_jitter():
    late = 1.7e9 + TS + 1e-4 * DT * RNG.uniform(-1, 1, T)  # seconds since 1970
    assert np.isfinite(jaxobs.observe(build("DiscreteTracker"), late, YS, xhat0=[0, 0]).xhat).all()
    single = jaxobs.astype(build("DiscreteTracker"), jnp.float32)
    with pytest.raises(ValueError, match=r"observe\.ts.*float32 tells apart. Subtract ts\[0\]"):
        jaxobs.observe(single, late, YS, xhat0=[0, 0])
    jaxobs.observe(single, late - late[0], YS, xhat0=[0, 0])
    jaxobs.observe(build("DiscreteTracker"), TS * 1.0009, YS, xhat0=[0, 0])


HG, DIGITAL = build("HighGain"), build("DiscreteTracker")
DOUBLED = np.where(np.arange(T) == 5, TS[4], TS)
REFUSED = [
    (HG, {"ts": np.delete(TS, 7)}, r"observe\.ts.*before row 7.*even spacing.*NaN rows"),
    (HG, {"ts": DOUBLED}, r"observe\.ts: given ts\[5\] = 0\.4 after ts\[4\] = 0\.4; expected increasing"),
    (HG, {"ts": TS[::-1]}, r"observe\.ts: given ts\[1\].*increasing"),
    (HG, {"ts": np.where(np.arange(T) == 3, np.nan, TS)}, r"observe\.ts: given ts\[3\] = nan"),
    (HG, {"ts": TS[:, None]}, r"observe\.ts: given shape \(12, 1\)"),
    (HG, {"ts": TS[:1]}, r"observe\.ts: given shape \(1,\).*T >= 2"),
    (DIGITAL, {"ts": TS * 1.002, "us": None}, r"observe\.ts.*DiscreteTracker\.dt = 0\.1 s"),
    (build("Sampled"), {"ts": TS * 1.002}, r"observe\.ts.*Sampled\.dt = 0\.1 s"),
    (HG, {"ys": YS.T}, r"observe\.ys: given shape \(1, 12\); expected \(12, 1\).*Transpose"),
    (HG, {"ys": YS[:-1]}, r"observe\.ys: given shape \(11, 1\)"),
    (HG, {"us": US[:-1]}, r"observe\.us: given shape \(11, 1\).*each input"),
    (HG, {"us": tampered(J, np.nan)}, r"observe\.us: given us\[5\]"),
    (HG, {"xhat0": [0, 0, 0]}, r"observe\.xhat0: given shape \(3,\); expected \(2,\)"),
    (HG, {"xhat0": [0, np.nan]}, r"observe\.xhat0.*finite"),
    (HG, {"us": None}, r"observe\.us: given None; expected \(12, 1\).*Give us \(T, m\)"),
    (HG, {"ys": YS + 1j}, r"observe\.ys: given dtype complex128; expected real numbers"),
    (HG, {"ts": np.datetime64("2026-01-01", "s") + np.arange(T)}, r"observe\.ts: given dtype datetime64.*seconds as floats"),
    ((HG, None), {}, r"observe\.observer: given tuple .*AbstractFlowObserver or AbstractStepObserver.*certificate"),
    (observers.HighGain, {}, r"observe\.observer: given the class HighGain"),
    (plants.Pendulum(), {}, r"observe\.observer: given Pendulum"),
    (
        HG,
        {"integrator": integrators.RK4},
        r"observe\.integrator: given the class RK4; expected an instance of AbstractIntegrator",
    ),
    (HG, {"integrator": "RK4"}, r"observe\.integrator: given str 'RK4'"),
    (DIGITAL, {"us": None, "integrator": integrators.RK4()}, r"observe\.integrator: given RK4; expected none"),
    (eqx.tree_at(lambda o: o.gamma, HG, jnp.asarray(-1.0)), {}, r"HighGain\.gamma: given -1\.0; expected a positive"),
]


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(("observer", "changed", "message"), REFUSED, ids=lambda v: v[:30] if isinstance(v, str) else "")
def test_refused(observer, changed, message):
    arguments = {"ts": TS, "ys": YS, "us": US, "xhat0": [0, 0]} | changed
    if len(np.atleast_1d(arguments["ts"])) == T - 1:
        arguments |= {"ys": YS[1:], "us": US[1:]}
    with pytest.raises(ValueError, match=message):
        jaxobs.observe(observer, **arguments)


def test_one_output_needs_no_second_axis():
    assert (run("HighGain", YS[:, 0]).xhat == run("HighGain").xhat).all()
