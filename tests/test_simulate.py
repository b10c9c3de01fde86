"""Time in `simulate`: what a plant and an observer see of each other, noise, disturbance, divergence, precision."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
from cases import DT, build

import jaxobs
from jaxobs import integrators, metrics, noise, observers, plants, signals
from jaxobs._module import float_leaves
from jaxobs.noise import drawn

T = 12
TS = DT * np.arange(T)
KEY = jax.random.key(3)
PLANT, HG, DIGITAL = build("Pendulum"), build("HighGain"), build("DiscreteTracker")
SINE = signals.Sine(0.4, 3.0)
NOISE = noise.Gaussian(0.2)
TIGHT = integrators.Adaptive(rtol=1e-10, atol=1e-12)


def run(plant=PLANT, observer=HG, **options):
    defaults = {"x0": [0.5, -0.2], "xhat0": [0.0, 0.0], "ts": TS, "signal": SINE if plant.m else None, "key": KEY}
    return jaxobs.simulate(plant, observer, **defaults | {"noise": NOISE} | options)


def pendulum(t, x):
    return np.asarray([x[1], 1.2 * np.sin(x[0]) + 0.4 * np.sin(3 * t) * np.cos(x[0]) - 0.3 * x[1]])


def joint_loop(ts, w, valid=None, extra=()):
    """x' = f, z' = f(z) + L (x_1 + w_k - z_1) between the samples, u(t) and x(t) running on, only w_k held."""

    def flow(t, xz, w, valid):
        x, z = xz[:2], xz[2:]
        innovation = (x[0] + w - z[0]) if valid else 0
        return np.concatenate([pendulum(t, x), pendulum(t, z) + np.asarray([1.5 * 3, 9]) * innovation])

    path = [np.asarray([0.5, -0.2, 0, 0])]
    for k in range(len(ts) - 1):
        args = (w[k], True if valid is None else valid[k])
        path.append(scipy.integrate.solve_ivp(flow, ts[k : k + 2], path[-1], args=args, rtol=1e-11, atol=1e-13).y[:, -1])
    return np.asarray(path)


def test_a_flow_observer_sees_the_running_output_and_held_noise():
    lossy = noise.Sum((NOISE, noise.Dropout(0.3)))
    for source in (NOISE, lossy):
        made = run(noise=source, integrator=TIGHT)
        w, _ = drawn(source, jax.random.split(KEY)[0], jnp.asarray(TS), 1)
        assert (source is NOISE) == bool(made.valid.all())
        path = joint_loop(TS, np.asarray(w)[:, 0], np.asarray(made.valid)[:, 0])
        np.testing.assert_allclose(np.hstack([made.x, made.xhat]), path, atol=1e-8)
        np.testing.assert_allclose(made.y[made.valid], (path[:, :1] + w)[made.valid], atol=1e-8)
        assert (made.innovation[~made.valid] == 0).all()


def test_the_innovation_may_be_held_instead():
    made = run(noise=noise.Sum((NOISE, noise.Dropout(0.3))), hold_innovation=True)
    last = 0.0
    for innovation, valid in zip(made.innovation[:, 0], made.valid[:, 0], strict=True):
        last = innovation if valid else last
        assert innovation == last
    assert not made.valid.all()


def test_an_uneven_grid_is_walked_as_it_is():
    ts = np.cumsum(0.05 + 0.1 * np.random.default_rng(5).random(T))
    made = run(ts=ts, integrator=TIGHT)
    w, _ = drawn(NOISE, jax.random.split(KEY)[0], jnp.asarray(ts), 1)
    np.testing.assert_allclose(np.hstack([made.x, made.xhat]), joint_loop(ts, np.asarray(w)[:, 0]), atol=1e-8)


def test_the_exponential_method_agrees():
    made = run(integrator=integrators.Exponential(substeps=20))
    exact = run(integrator=TIGHT)
    np.testing.assert_allclose(made.xhat, exact.xhat, atol=1e-6)
    np.testing.assert_allclose(made.x, exact.x, atol=1e-6)


@pytest.mark.parametrize(("label", "hold"), [("Sampled", False), ("DiscreteTracker", True), ("CurrentLuenberger", False)])
def test_a_step_observer_sees_what_observe_sees(label, hold):
    made = run(observer=build(label), noise=noise.Sum((NOISE, noise.Dropout(0.3))), hold_innovation=hold)
    us = made.u if build(label).m else None
    ys = jnp.where(made.valid, made.y, jnp.nan)
    seen = jaxobs.observe(build(label), made.ts, ys, us, xhat0=[0, 0], hold_innovation=hold)
    np.testing.assert_allclose(made.xhat, seen.xhat, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(made.innovation, seen.innovation, rtol=1e-12, atol=1e-14)
    exact = scipy.integrate.solve_ivp(pendulum, (0, TS[-1]), [0.5, -0.2], t_eval=TS, rtol=1e-11, atol=1e-13).y.T
    np.testing.assert_allclose(made.x, exact, atol=2e-5)  # RK4 at dt = 0.1, u(t) running on inside the step


def test_a_step_plant_steps():
    plant = plants.Discretised(build("Lorenz"), integrators.Euler(), jnp.asarray(0.01))  # the Euler map of paper 004
    observer = observers.StepLuenberger(plant, jnp.asarray([[0.1], [0.3], [0.1]]))
    made = run(plant, observer, x0=[1, 2, 20], xhat0=[0, 0, 15], ts=0.01 * np.arange(T))

    def step(x):
        field = [10 * (x[1] - x[0]), 28 * x[0] - x[1] - x[0] * x[2], x[0] * x[1] - 2.5 * x[2]]
        return x + 0.01 * np.asarray(field)

    x, z = np.asarray([1.0, 2, 20]), np.asarray([0.0, 0, 15])
    for k in range(T):
        np.testing.assert_allclose(np.hstack([made.x[k], made.xhat[k]]), np.hstack([x, z]), rtol=1e-12)
        x, z = step(x), step(z) + np.asarray([0.1, 0.3, 0.1]) * (float(made.y[k, 0]) - z[1])


def test_disturbance_enters_through_its_matrix():
    """Under Euler, (x+ - x)/dt - f(x) is E d_k: for Lorenz nothing in x_1, independent numbers of variance sigma^2 below."""
    plant, count, sigma = build("Lorenz"), 3000, 2.0
    made = run(
        plant, build("Luenberger"), x0=[1, 2, 20], xhat0=[1, 2, 20], ts=0.01 * np.arange(count), noise=None,
        disturbance=noise.Gaussian(sigma), integrator=integrators.Euler(),
    )  # fmt: skip
    f = jax.vmap(lambda x: plant.flow(jnp.asarray(0.0), x, jnp.zeros(0)))(made.x[:-1])
    e_d = np.asarray(jnp.diff(made.x, axis=0) / 0.01 - f)
    np.testing.assert_allclose(e_d[:, 0], 0, atol=1e-10)
    covariance = e_d[:, 1:].T @ e_d[:, 1:] / (count - 1)
    assert np.all(np.abs(covariance - sigma**2 * np.eye(2)) < 5 * sigma**2 * np.sqrt([[2, 1], [1, 2]]) / np.sqrt(count))


def test_noise_and_disturbance_have_streams_of_their_own():
    options = {"plant": build("SampledChain"), "observer": build("DiscreteTracker steady"), "x0": [0] * 3, "xhat0": [0] * 3}
    neither = run(**options, noise=None)
    noisy, disturbed = run(**options), run(**options, noise=None, disturbance=NOISE)
    both = run(**options, disturbance=NOISE)
    assert (neither.x == noisy.x).all()
    assert (disturbed.x == both.x).all()
    np.testing.assert_allclose(both.y - both.x[:, :1], noisy.y - noisy.x[:, :1], atol=1e-14)
    w, d = noisy.y[:-1, 0], disturbed.x[1:, 2] - disturbed.x[:-1, 2]
    assert not np.isclose(w[:, None], d[None, :]).any()


def test_a_run_is_decided_by_its_key():
    assert (run().xhat == run().xhat).all()
    assert (run(key=jax.random.key(4)).y != run().y).any()
    assert (run(noise=None, key=None).xhat == run(noise=None).xhat).all()


def test_divergence_is_data():
    def lane(gamma):
        observer = eqx.tree_at(lambda o: o.gamma, HG, gamma)
        return run(observer=observer, integrator=integrators.Euler())

    together = jax.jit(jax.vmap(lane))(jnp.asarray([3.0, 1e40]))
    bad = ~np.isfinite(together.xhat[1]).all(axis=1)
    assert together.diverged_at.tolist() == [np.inf, TS[np.argmax(bad)]]
    assert np.argmax(bad) > 0
    assert np.isfinite(together.x).all()
    np.testing.assert_allclose(together.xhat[0], lane(jnp.asarray(3.0)).xhat, rtol=1e-12, atol=1e-14)


def test_gradients_equal_finite_differences():
    def loss(parts):
        plant, observer, signal, source, x0 = parts
        made = run(plant, observer, signal=signal, noise=source, x0=x0, xhat0=[0.1, 0.0])
        return jnp.mean((made.xhat - made.x) ** 2)

    loss, parts = eqx.filter_jit(loss), (PLANT, HG, SINE, NOISE, jnp.asarray([0.5, -0.2]))
    leaves, structure = jax.tree.flatten(parts)
    gradient, step = jax.tree.leaves(jax.jit(jax.grad(loss))(parts)), 6e-6
    for i, leaf in enumerate(leaves):
        for at in np.ndindex(leaf.shape):
            moved = [leaf.at[at].add(sign * step) for sign in (1, -1)]
            up, down = (loss(jax.tree.unflatten(structure, [*leaves[:i], m, *leaves[i + 1 :]])) for m in moved)
            np.testing.assert_allclose(gradient[i][at], (up - down) / (2 * step), rtol=1e-6, atol=1e-9)


def test_lanes_equal_the_loop():
    keys = jax.random.split(KEY, 3)
    together = jax.jit(jax.vmap(lambda key: run(key=key).xhat))(keys)
    np.testing.assert_allclose(together, [run(key=key).xhat for key in keys], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("plant", [PLANT, plants.IntegratorChain(2)], ids=["pendulum", "a plant without numbers"])
def test_single_precision_stays_single(plant):
    half = [jaxobs.astype(part, jnp.float32) for part in (plant, HG, SINE)]
    if plant.m == 0:
        half[1:] = [jaxobs.astype(observers.HighGain(plant, [1.5, 1.0], 3.0), jnp.float32), signals.Zero()]
    double = [jaxobs.astype(part, jnp.float64) for part in half]
    options = {"noise": NOISE, "disturbance": noise.Gaussian(0.3)}
    single, exact = (run(*parts[:2], signal=parts[2], **options) for parts in (half, double))
    assert {leaf.dtype for leaf in float_leaves(single)} == {np.dtype(np.float32)}
    for name in ("x", "xhat", "y", "innovation"):
        close = {"rtol": 0, "atol": T * 20 * np.finfo(np.float32).eps}
        np.testing.assert_allclose(getattr(single, name), getattr(exact, name), **close)


def test_score_is_the_metrics_of_the_run():
    wanted = {"rmse": metrics.RMSE(after=0.5), "peak": metrics.Peak(), "white": metrics.Whiteness(3)}
    source = noise.Sum((NOISE, noise.Dropout(0.3)))
    options = {"x0": [0.5, -0.2], "xhat0": [0, 0], "ts": TS, "signal": SINE, "key": KEY, "noise": source}
    scores = jaxobs.score(PLANT, HG, metrics=wanted, **options)
    for name, metric in wanted.items():
        expected = metrics.evaluate(metric, jaxobs.simulate(PLANT, HG, **options))
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-11), scores[name], expected)


STEP = {"plant": build("SampledChain"), "x0": [0] * 3, "signal": None}
HALF_HG, HALF_SINE = jaxobs.astype(HG, jnp.float32), jaxobs.astype(SINE, jnp.float32)
REFUSED = [
    (STEP, r"simulate\.observer: given the flow observer HighGain for a step plant.*Sampled\(observer, integrator, dt\)"),
    ({"x0": [0, 0, 0]}, r"simulate\.x0: given shape \(3,\); expected \(2,\)"),
    ({"xhat0": [[0, 0]]}, r"simulate\.xhat0: given shape \(1, 2\)"),
    ({"x0": [np.nan, 0]}, r"simulate\.x0.*finite"),
    ({"ts": TS[::-1]}, r"simulate\.ts.*increasing"),
    ({"observer": DIGITAL, "ts": TS * 1.002}, r"simulate\.ts.*DiscreteTracker\.dt = 0\.1 s"),
    ({"observer": build("Sampled"), "ts": TS * 1.002}, r"simulate\.ts.*Sampled\.dt = 0\.1 s"),
    ({"observer": DIGITAL, "ts": np.delete(TS, 7)}, r"simulate\.ts.*before row 7"),
    (STEP | {"observer": build("DiscreteTracker steady"), "ts": TS * 2, "xhat0": [0] * 3}, r"simulate\.ts.*0\.2 s apart"),
    ({"signal": signals.Zero(2)}, r"simulate\.signal: given m = 2 inputs; expected the plant's m = 1"),
    ({"signal": signals.Zero()}, r"simulate\.signal: given m = 0"),
    ({"plant": HG, "observer": PLANT}, r"simulate\.observer: given Pendulum"),
    (
        {"plant": plants.Pendulum, "signal": None},
        r"simulate\.plant: given the class Pendulum; .*AbstractFlowPlant or AbstractStep",
    ),
    ({"plant": DIGITAL}, r"simulate\.plant: given DiscreteTracker"),
    ({"observer": (HG, None)}, r"simulate\.observer: given tuple .*certificate"),
    ({"signal": 0.0}, r"simulate\.signal: given float 0\.0; expected an instance of AbstractSignal or None"),
    ({"noise": 0.1}, r"simulate\.noise: given float 0\.1"),
    ({"disturbance": noise.Gaussian}, r"simulate\.disturbance: given the class Gaussian"),
    ({"integrator": integrators.RK4}, r"simulate\.integrator: given the class RK4"),
    ({"integrator": "RK4"}, r"simulate\.integrator: given str 'RK4'"),
    (
        STEP | {"observer": build("DiscreteTracker steady"), "xhat0": [0] * 3, "integrator": integrators.RK4()},
        r"simulate\.integrator: given RK4; expected none for a step plant",
    ),
    ({"key": 0}, r"simulate\.key: given int of shape \(\); expected one PRNG key.*jax\.random\.key"),
    ({"key": jax.random.split(KEY)}, r"simulate\.key: given .* of shape \(2,\)"),
    ({"key": None}, r"simulate\.key: given None; expected a PRNG key"),
    ({"observer": HALF_HG}, r"simulate\.plant: given precision float64; expected the observer's float32.*astype"),
    ({"signal": HALF_SINE}, r"simulate\.signal: given precision float32; expected the observer's float64.*astype"),
    ({"plant": eqx.tree_at(lambda p: p.a, PLANT, jnp.full(2, 1.0))}, r"Pendulum\.a: given shape \(2,\)"),
    ({"plant": eqx.tree_at(lambda p: p.a, PLANT, jnp.asarray(np.nan))}, r"Pendulum\.a: given nan"),
]


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(("changed", "message"), REFUSED, ids=lambda v: v if isinstance(v, str) else "")
def test_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        run(**changed)


@pytest.mark.usefixtures("as_users_have_it")
@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ([metrics.RMSE()], r"score\.metrics: given list .*Mapping"),
        ({"rmse": metrics.RMSE}, r"score\.metrics\['rmse'\]: given the class RMSE; expected an instance of AbstractMetric"),
        ({"diverged_at": metrics.RMSE()}, r"score\.metrics: given the name 'diverged_at'"),
    ],
)
def test_scores_need_named_metrics(wanted, message):
    with pytest.raises(ValueError, match=message):
        jaxobs.score(PLANT, HG, metrics=wanted, x0=[0, 0], xhat0=[0, 0], ts=TS, signal=SINE)


def test_a_key_of_the_older_style_is_a_key():
    assert np.isfinite(run(key=jax.random.PRNGKey(0)).xhat).all()
