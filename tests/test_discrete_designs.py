"""Observers of the Euler model: (62), (63), (65), tied and free, with and without integrators."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import norm_bounded as oracle

import jaxobs
from jaxobs import certificates, designs
from jaxobs.certificates import StepCorners
from jaxobs.designs import Infeasible, NormBounded
from jaxobs.integrators import Euler
from jaxobs.observers import IntegralHighGain, StepIntegral, StepLuenberger
from jaxobs.plants import Discretised, IntegratorChain, Lorenz, Pendulum, VanDerPol
from jaxobs.signals import Sine

RHO = 1.5
SLOPE = NormBounded.lipschitz(2, RHO, (1,))
PRINTED = {  # paper 000, section 4.1: dt -> (epsilon, X)
    0.01: (0.5671, ((1.5533, -0.1662), (-0.1662, 0.8352))),
    0.525: (0.3415, ((1.1685, -0.3414), (-0.3414, 0.3119))),
}
M, N = ((0.0, 0.0), (0.0, RHO**0.5)), ((RHO**0.5, 0.0), (0.0, 0.0))


def claimed(epsilon, x, dt):
    """(62) with L = X^-1 C', as a certificate on the Euler model."""
    gain = np.linalg.solve(np.array(x), [1.0, 0.0])
    left = tuple(tuple(np.nextafter(dt * v, np.inf).item() if v else 0.0 for v in row) for row in M)
    return StepCorners(
        a=((1.0, dt), (0.0, 1.0)), b=((), ()), c=(), lower=(), upper=(), output=((1.0, 0.0),),
        gain=tuple((float(v),) for v in gain), p=x, factor=1.0, left=left, right=N, tau=epsilon,
    )  # fmt: skip


def printed(at):
    return claimed(*PRINTED[at], at)


def final_error(plant, observer, dt, steps=1000):
    """The error after many steps on the Euler model that the certificate speaks of, relative to the largest seen."""
    ts = np.arange(steps) * dt
    start = np.ones(plant.n)
    run = jaxobs.simulate(
        Discretised(plant, Euler(), dt), observer, x0=start, xhat0=0 * start, ts=ts, signal=Sine(0.5, 1.0) if plant.m else None
    )
    error = np.linalg.norm(np.asarray(run.x - run.xhat), axis=1)
    return error[-1] / np.max(error)


def test_the_largest_period_of_65_is_the_closed_form():
    found = designs.euler_riccati_period(alphas=[3.0, 2.0], gamma=6.0, slope=SLOPE)
    assert found.dt == pytest.approx(43 / (2 * (144 + np.sqrt(8094))), rel=1e-7)
    assert found.dt <= found.refuted == pytest.approx(found.dt, rel=1e-7)


@pytest.mark.parametrize(
    ("alphas", "gamma", "q"), [((3.0, 2.0), 2.5, 0), ((3.0, 3.0, 1.0), 4.0, 1), ((4.0, 6.0, 4.0, 1.0), 6.0, 2)]
)
def test_the_largest_period_of_65_against_both_corners(alphas, gamma, q):
    found = designs.euler_riccati_period(alphas=alphas, gamma=gamma, slope=SLOPE, q=q)
    edge = oracle.riccati_period(alphas, gamma, RHO, q)
    assert found.dt == pytest.approx(edge, rel=1e-6)
    wishes = {"alphas": alphas, "gamma": gamma, "slope": SLOPE, "q": q}
    dt = edge * (1 - 1e-6)
    observer, c = designs.euler_riccati(Pendulum(), dt=dt, **wishes)
    assert c.verify()
    assert oracle.euler_model_holds(c)
    np.testing.assert_allclose(np.ravel(observer.gain), dt * np.array(alphas) * gamma ** np.arange(1.0, len(alphas) + 1))
    with pytest.raises(Infeasible, match=r"gamma dt = .* too large") as caught:
        designs.euler_riccati(Pendulum(), dt=edge * (1 + 1e-6), **wishes)
    assert caught.value.best == pytest.approx(edge, rel=1e-6)


def test_the_printed_tau_is_feasible_and_not_the_only_one():
    _, c = designs.euler_riccati(Pendulum(), alphas=[3.0, 2.0], gamma=6.0, dt=0.0915, slope=SLOPE)
    as_printed = [dataclasses.replace(c, tau=tau) for tau in (c.tau, 0.0347, 0.05)]
    assert [bool(one.verify()) for one in as_printed] == [True, True, False]
    assert [oracle.euler_model_holds(one) for one in as_printed] == [True, True, False]


@pytest.mark.parametrize("dt", PRINTED)
def test_both_printed_matrices_are_feasible(dt):
    assert printed(dt).verify()
    assert oracle.euler_model_holds(printed(dt))


def test_the_largest_period_of_62_tied():
    found = designs.euler_tied_period(slope=SLOPE)
    assert found.dt == pytest.approx(0.52863693, abs=1e-8)
    assert found.dt <= found.refuted == pytest.approx(found.dt, rel=1e-6)
    assert oracle.tied_margin(found.dt * (1 - 1e-3), RHO) > 0
    assert oracle.tied_margin(found.dt * (1 + 1e-3), RHO) < 0


def test_any_smaller_period_will_do():
    """X becomes (dt0 / dt) X, epsilon stays: the author's remark, for the printed solution at 0.525."""
    for dt in (0.4, 0.1, 0.01):
        ratio = 0.525 / dt
        x = tuple(tuple(ratio * entry for entry in row) for row in PRINTED[0.525][1])
        assert claimed(PRINTED[0.525][0], x, dt).verify()


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_largest_period_with_a_free_gain_is_the_closed_form(n):
    """det K at the two slopes differs by 2 rho dt^n for every gain, and both determinants lie in ]-1, 1[: dt < rho^(-1/n)."""
    found = designs.euler_free_period(slope=NormBounded.lipschitz(n, RHO, (1,)))
    assert found.dt == pytest.approx(RHO ** (-1 / n), rel=1e-6)
    assert found.dt <= found.refuted
    gain = np.random.default_rng(n).normal(size=(n, 1))
    closed = [np.eye(n) + found.dt * np.eye(n, k=1) - gain @ np.eye(1, n) for _ in range(2)]
    for k, sign in zip(closed, (1, -1), strict=True):
        k[-1, 0] += sign * found.dt * RHO
    assert abs(np.linalg.det(closed[0]) - np.linalg.det(closed[1])) == pytest.approx(2 * RHO * found.dt**n)


def test_the_augmented_periods_are_ordered():
    wishes = {"slope": SLOPE, "q": 1}
    tied, free = designs.euler_tied_period(**wishes).dt, designs.euler_free_period(**wishes).dt
    riccati = designs.euler_riccati_period(alphas=[3.0, 3.0, 1.0], gamma=4.0, **wishes).dt
    assert 0 < riccati < tied < free < 1 / np.sqrt(RHO)
    for design, edge in ((designs.euler_tied, tied), (designs.euler_free, free)):
        _, c = design(Pendulum(), dt=edge * (1 - 1e-4), **wishes)
        assert oracle.euler_model_holds(c)
        with pytest.raises(Infeasible) as caught:
            design(Pendulum(), dt=edge * 1.001, **wishes)
        assert caught.value.best == pytest.approx(edge, rel=1e-6)
        assert "unstable" not in str(caught.value)


@pytest.mark.parametrize("q", [0, 2])
@pytest.mark.parametrize(
    "design",
    [
        lambda plant, dt, **w: designs.euler_riccati(plant, alphas=jaxobs.hurwitz.binomial(2 + w["q"]), gamma=6.0, dt=dt, **w),
        designs.euler_tied,
        lambda plant, dt, **w: designs.euler_free(plant, dt=dt, unit=5 * dt, factor=0.9, **w),
    ],
    ids=["riccati", "tied", "free"],
)
def test_what_is_designed_converges_on_the_euler_model(design, q):
    dt = 0.02
    observer, c = design(Pendulum(), dt=dt, slope=SLOPE, q=q)
    assert isinstance(observer, StepIntegral if q else StepLuenberger)
    assert np.array_equal(np.ravel(observer.gain), np.ravel(c.gain))
    assert c.verify()
    assert oracle.euler_model_holds(c)
    assert final_error(Pendulum(), observer, dt) < 1e-6


@pytest.mark.parametrize("n", [1, 3, 4])
def test_chains_of_any_length_in_both_precisions(n):
    slope = NormBounded.lipschitz(n, 0.3)
    for dtype in (jnp.float64, jnp.float32):
        plant = jaxobs.astype(jaxobs.plants.SineChain(0.3, n), dtype)
        for design in (designs.euler_tied, designs.euler_free):
            observer, c = design(plant, dt=0.1, slope=slope, unit=0.4)
            assert observer.gain.dtype == dtype
            assert np.array_equal(np.ravel(np.asarray(observer.gain, float)), np.ravel(c.gain))
            assert oracle.euler_model_holds(c)


def test_a_longer_unit_is_quieter_and_a_factor_is_kept():
    gains = [np.linalg.norm(designs.euler_free(Pendulum(), dt=0.01, slope=SLOPE, unit=u)[1].gain) for u in (0.01, 0.1, 1.0)]
    assert gains[0] > gains[1] > gains[2]
    observer, c = designs.euler_tied(Pendulum(), dt=0.05, slope=SLOPE, factor=0.8)
    assert c.verify().margins == {"decay_factor": 0.8}
    assert final_error(Pendulum(), observer, 0.05, steps=100) < 100 * 0.8**99


def test_step_integral_is_euler_of_the_continuous_observer():
    plant, alphas, dt = VanDerPol(1.3), np.array([4.0, 6.0, 4.0, 1.0]), 0.02
    flow = IntegralHighGain(plant, alphas, 3.0, 2)
    step = StepIntegral(plant, dt * np.asarray(flow.gain()), dt, 2)
    z, y, u = jnp.asarray([0.1, -0.3, 0.7, 0.2]), jnp.asarray([0.4]), jnp.zeros(plant.m)
    k = jnp.asarray(5)
    np.testing.assert_allclose(step.step(k, z, u, y), z + dt * flow.flow(5 * dt, z, u, y), rtol=1e-14)


def test_step_integral_is_the_printed_form_with_integrals_of_y():
    """xi+ = xi + dt (xi_2, y), xihat+ = ... as printed in (37)-(40) after Euler, in plain NumPy; eps is xi - xihat."""
    dt, gain, q = 0.1, np.array([0.4, 0.3, 0.2, 0.1]), 2
    ys = np.random.default_rng(0).normal(size=30)
    xi, hat = np.zeros(2), np.zeros(4)  # hat = (xihat, xhat), xi(0) = xihat(0)
    observer = StepIntegral(IntegratorChain(2), gain, dt, q)
    z = observer.init(jnp.zeros(2))
    for k, y in enumerate(ys):
        injected = gain * (xi[0] - hat[0])
        hat = hat + dt * np.array([hat[1], hat[2], hat[3], 0.0]) + injected
        xi = xi + dt * np.array([xi[1], y])
        z = observer.step(jnp.asarray(k), z, jnp.zeros(0), jnp.asarray([y]))
        np.testing.assert_allclose(z[2:], hat[2:], atol=1e-12)
        np.testing.assert_allclose(z[:2], xi - hat[:2], atol=1e-12)


def test_step_integral_without_integrators_is_the_luenberger_observer():
    plant, dt, gain = Pendulum(), 0.05, np.array([0.4, 0.3])
    one = StepIntegral(plant, gain, dt, 0)
    other = StepLuenberger(Discretised(plant, Euler(), dt), gain[:, None])
    given = (jnp.asarray(3), jnp.asarray([0.3, -0.2]), jnp.asarray([0.5]), jnp.asarray([0.1]))
    np.testing.assert_allclose(one.step(*given), other.step(*given), rtol=1e-15)


def mutated(c, rng):
    """One number of the certificate changed a little, or a lot."""
    name = str(rng.choice(["gain", "p", "tau", "left", "factor"]))
    value = np.array(getattr(c, name), float)
    change = 1 + rng.choice([-1, 1], size=value.shape) * 10 ** rng.uniform(-4, 0) * (rng.random(value.shape) < 0.7)
    value = value * change
    value = (value + value.T) / 2 if name == "p" else value
    plain = {0: float, 1: lambda v: tuple(v.tolist()), 2: lambda v: tuple(map(tuple, v.tolist()))}[value.ndim](value)
    return dataclasses.replace(c, **{name: plain})


def test_mutated_certificates_are_accepted_exactly_when_true():
    rng, counts = np.random.default_rng(3), {True: 0, False: 0}
    seeds = [designs.euler_tied(Pendulum(), dt=0.5, slope=SLOPE)[1]]
    seeds += [
        designs.euler_riccati(Pendulum(), alphas=[3.0, 3.0, 1.0], gamma=4.0, dt=0.04, slope=SLOPE, q=1)[1],
        printed(0.525),
    ]
    for k in range(150):
        c = mutated(seeds[k % len(seeds)], rng)
        verdict = c.verify()
        assert verdict.holds == oracle.euler_model_holds(c), c
        assert verdict.why.startswith("holds" if verdict else "not certified")
        counts[verdict.holds] += 1
    assert min(counts.values()) > 20


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"gain": ((1.0,),)}, "gain: its size"),
        ({"gain": ((float("nan"),), (1.0,))}, "gain: cannot convert NaN"),
        ({"p": ((1.0, 0.0),)}, "p: its size"),
        ({"p": ((1.0, 0.0), (0.0,))}, "p: its size"),
        ({"p": ((1.0, 0.0), (0.0, -1.0))}, "P > 0 fails"),
        ({"left": ((1.0,),)}, "left: its size"),
        ({"tau": 0.0}, "the decrease of e'P e"),
        ({"tau": -1.0}, "the multipliers >= 0"),
        ({"factor": 1.5}, "0 < factor <= 1"),
        ({"a": ((1.0, 0.6), (0.0, 1.0))}, "the decrease of e'P e"),
    ],
)
def test_a_false_claim_is_refused_with_its_reason(changes, reason):
    verdict = dataclasses.replace(printed(0.525), **changes).verify()
    assert not verdict
    assert verdict.why.startswith("not certified")
    assert reason in verdict.why


def test_certificates_travel(tmp_path):
    _, c = designs.euler_tied(Pendulum(), dt=0.1, slope=SLOPE)
    c.to_json(tmp_path / "c.json")
    assert certificates.load(tmp_path / "c.json") == c
    assert "Euler model with dt = 0.1, not of the plant itself" in " ".join(c.assumptions)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: designs.euler_tied(Lorenz(), dt=0.1, slope=SLOPE), "chain form"),
        (lambda: designs.euler_tied(Pendulum(), dt=0.0, slope=SLOPE), r"euler_tied\.dt"),
        (lambda: designs.euler_tied(Pendulum(), dt=0.1, slope=SLOPE, q=-1), r"euler_tied\.q"),
        (lambda: designs.euler_free(Pendulum(), dt=0.1, slope=SLOPE, factor=1.5), r"euler_free\.factor"),
        (lambda: designs.euler_free(Pendulum(), dt=0.1, slope=SLOPE, unit=-1.0), r"euler_free\.unit"),
        (
            lambda: designs.euler_riccati(Pendulum(), alphas=[3.0], gamma=6.0, dt=0.1, slope=SLOPE),
            r"alphas: given shape \(1,\)",
        ),
        (lambda: designs.euler_riccati(Pendulum(), alphas=[3.0, -2.0], gamma=6.0, dt=0.1, slope=SLOPE), "Hurwitz"),
        (lambda: designs.euler_riccati(Pendulum(), alphas=[3.0, 2.0], gamma=-6.0, dt=0.1, slope=SLOPE), r"\.gamma"),
        (lambda: designs.euler_tied(Pendulum(), dt=0.1, slope=NormBounded.lipschitz(3, RHO)), "slope: given 3 states"),
        (lambda: designs.euler_tied(Pendulum(), dt=0.1, slope=NormBounded.lipschitz(2, RHO, (2,))), "changes with x_1"),
        (lambda: designs.euler_tied(Pendulum(1.0, 0.2), dt=0.1, slope=SLOPE), "changes with x_2"),
        (lambda: NormBounded.lipschitz(2, -1.0), "lipschitz"),
        (lambda: NormBounded.lipschitz(2, 1.0, (3,)), "states"),
        (lambda: NormBounded(np.ones((2, 1)), np.ones((1, 3))), "2 columns"),
        (lambda: NormBounded(np.ones(2), np.ones((1, 2))), "a matrix"),
        (lambda: StepIntegral(Pendulum(), [1.0, 2.0], 0.1, 1), r"gain: given shape \(2,\)"),
        (lambda: StepIntegral(Pendulum(), [1.0, 2.0], -0.1, 0), r"\.dt"),
    ],
)
def test_bad_input_is_named(as_users_have_it, call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_condition_10_is_needed_for_the_riccati_gain():
    with pytest.raises(Infeasible, match=r"\(10\)"):
        designs.euler_riccati(Pendulum(), alphas=[1.0, 2.0], gamma=6.0, dt=0.01, slope=SLOPE)


def test_a_gain_above_the_limit_warns_with_the_limit():
    with pytest.warns(designs.LargeGain, match=r"2\.88e\+06, above the limit of 1e\+06"):
        designs.riccati(Pendulum(), lipschitz=RHO, alphas=[3.0, 2.0], gamma=1200.0)
