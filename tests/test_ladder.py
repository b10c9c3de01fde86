"""The ladder of certificates, the S-lemma and output injection."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from oracles import norm_bounded as oracle
from oracles import riccati

import jaxobs
from jaxobs import certificates, designs
from jaxobs.certificates import Condition5, Corners
from jaxobs.designs import Infeasible, NormBounded
from jaxobs.integrators import RK4
from jaxobs.observers import HighGain, IntegralHighGain, OutputInjection, Sampled
from jaxobs.plants import Pendulum, SineChain, VanDerPol
from jaxobs.signals import Sine

ALPHAS, RHO, SHARP = [3.0, 2.0], 1.5, math.sqrt(1.25)
EVERYWHERE, INSIDE = NormBounded.lipschitz(2, RHO), NormBounded.lipschitz(2, RHO, (1,))
KNOWN = {"lipschitz": RHO, "states": (1,), "slopes": [(-SHARP, SHARP), (0.0, 0.0)]}


@pytest.fixture(scope="module")
def rungs():
    return {rung.name: rung for rung in designs.ladder(Pendulum(), alphas=ALPHAS, **KNOWN)}


def test_the_smallest_gammas_of_the_pendulum_by_other_routes(rungs):
    expected = {
        "condition (5)": riccati.smallest_gamma(ALPHAS, RHO),
        "S-lemma, same P": oracle.same_p_gamma(ALPHAS, RHO),
        "S-lemma, free P": oracle.free_p_gamma(ALPHAS, RHO, np.eye(2)),
        "structure": math.sqrt(RHO / 2),  # |1/(s^2 + 3 g s + 2 g^2)| peaks at s = 0
        "box corners": math.sqrt(SHARP / 2),  # one slope: the two corners are that circle criterion
        "output injection": 0.0,
    }
    assert list(rungs) == list(expected)
    for name, gamma in expected.items():
        assert rungs[name].smallest_gamma == pytest.approx(gamma, rel=2e-7), name
    figures = [round(rung.smallest_gamma, 2) for rung in rungs.values()]
    assert figures == [5.74, 2.89, 2.27, 0.87, 0.75, 0.0]


def test_every_rung_has_its_exact_certificate(rungs):
    kinds = [Condition5, Corners, Corners, Corners, Corners, Corners]
    for rung, kind in zip(rungs.values(), kinds, strict=True):
        assert isinstance(rung.certificate, kind)
        assert rung.certificate.verify()
        assert rung.gamma == (pytest.approx(1.1 * rung.smallest_gamma) if rung.smallest_gamma else 1.0)
        if kind is Corners and rung.certificate.left:
            assert oracle.s_lemma_holds(rung.certificate)


def test_at_one_gamma_the_certificates_are_those_of_the_upper_rungs():
    certified = [rung.certificate is not None for rung in designs.ladder(Pendulum(), alphas=ALPHAS, gamma=2.5, **KNOWN)]
    assert certified == [False, False, True, True, True, True]


def test_a_rung_says_what_it_needs():
    missing = {
        rung.name: rung.needs for rung in designs.ladder(Pendulum(), alphas=ALPHAS, lipschitz=RHO) if not rung.certificate
    }
    assert list(missing) == ["structure", "box corners", "output injection"]
    assert "which states" in missing["structure"]
    assert "slope" in missing["box corners"]


def test_behind_integrators_and_without_condition_10():
    q2 = designs.ladder(Pendulum(), alphas=[4.0, 6.0, 4.0, 1.0], q=2, **KNOWN)
    rows = np.eye(4)[2:]
    assert q2[0].name == "condition (44)"
    assert q2[0].smallest_gamma == pytest.approx(39.625098, rel=1e-7)
    assert q2[2].smallest_gamma == pytest.approx(oracle.free_p_gamma([4.0, 6.0, 4.0, 1.0], RHO, rows), rel=1e-7)
    assert q2[3].smallest_gamma == pytest.approx(3.0)  # |(s^2 + 4 s + 6)/(s + 1)^4| = 6 at s = 0: 6 rho = gamma^2
    assert all(rung.certificate.verify() for rung in q2[:5])
    assert q2[5].certificate is None
    resonant = designs.ladder(Pendulum(), alphas=[1.0, 2.0], **KNOWN)
    assert [rung.smallest_gamma is None for rung in resonant] == [True, True, False, False, False, False]
    peak = oracle.free_p_gamma([1.0, 2.0], RHO, np.eye(2)[:1])
    assert resonant[3].smallest_gamma == pytest.approx(peak, rel=1e-7)


def test_corners_of_a_longer_chain():
    """Slopes of both signs along every state, n = 3: the edge is that of the frozen corner (+, +, +), so nothing is lost."""
    alphas, slopes = [3.0, 3.0, 1.0], [(-0.2, 0.2)] * 3
    rung = designs.ladder(SineChain(0.6, 3), alphas=alphas, lipschitz=0.35, slopes=slopes)[4]
    assert rung.certificate.verify()
    assert rung.smallest_gamma < oracle.free_p_gamma(alphas, 0.2 * math.sqrt(3), np.eye(3))  # the box lies inside that ball
    for factor, stable in ((1 - 1e-6, False), (1 + 1e-6, True)):
        frozen = np.eye(3, k=1) - np.outer(alphas * (factor * rung.smallest_gamma) ** np.arange(1.0, 4), np.eye(3)[0])
        frozen[-1] += 0.2
        assert (np.max(np.linalg.eigvals(frozen).real) < 0) == stable


@pytest.mark.parametrize("q", [0, 1])
def test_the_s_lemma_designs(q):
    alphas = jaxobs.hurwitz.binomial(2 + q)
    for slope in (EVERYWHERE, INSIDE):
        free, c = designs.s_lemma(Pendulum(), alphas=alphas, slope=slope, q=q, rate=0.3)
        same, d = designs.s_lemma_riccati(Pendulum(), alphas=alphas, slope=slope, q=q, rate=0.3)
        assert isinstance(free, IntegralHighGain if q else HighGain)
        assert float(free.gamma) <= float(same.gamma) * (1 + 1e-9)
        for one, observer in ((c, free), (d, same)):
            assert one.verify().margins == {"decay_rate": 0.3}
            assert oracle.s_lemma_holds(one)
            assert np.array_equal(np.asarray(observer.gain(), float), np.ravel(one.gain))
            edge = float(observer.gamma) / 1.1
            design = designs.s_lemma if one is c else designs.s_lemma_riccati
            with pytest.raises(Infeasible, match="S-lemma") as caught:
                design(Pendulum(), alphas=alphas, slope=slope, q=q, rate=0.3, gamma=edge * (1 - 1e-6))
            assert caught.value.smallest_gamma == pytest.approx(edge, rel=1e-9)
            assert design(Pendulum(), alphas=alphas, slope=slope, q=q, rate=0.3, gamma=edge * (1 + 1e-6))[1].verify()


def test_the_s_lemma_in_single_precision():
    observer, c = designs.s_lemma(jaxobs.astype(Pendulum(), jnp.float32), alphas=ALPHAS, slope=INSIDE)
    assert observer.gamma.dtype == jnp.float32
    assert np.array_equal(np.asarray(observer.gain(), float), np.ravel(c.gain))
    assert oracle.s_lemma_holds(c)


def test_the_error_decays_at_the_certified_rate():
    observer, c = designs.s_lemma(Pendulum(), alphas=ALPHAS, slope=EVERYWHERE, rate=1.0)
    ts = np.linspace(0, 6, 601)
    run = jaxobs.simulate(
        Pendulum(), observer, x0=[1.0, 0.0], xhat0=[0.0, 0.0], ts=ts, signal=Sine(0.5, 1.0), integrator=RK4(4)
    )
    e, x = np.asarray(run.x - run.xhat), np.array(c.p)
    v = np.sqrt(np.einsum("ti,ij,tj->t", e, x, e))
    assert np.all(v <= v[0] * np.exp(-1.0 * ts) * (1 + 1e-6) + 1e-9)


def test_mutated_certificates_are_accepted_exactly_when_true():
    rng, counts = np.random.default_rng(4), {True: 0, False: 0}
    seeds = [designs.s_lemma(Pendulum(), alphas=ALPHAS, slope=s, gamma=g)[1] for s, g in ((EVERYWHERE, 2.4), (INSIDE, 1.0))]
    seeds.append(designs.s_lemma_riccati(Pendulum(), alphas=[3.0, 3.0, 1.0], slope=INSIDE, q=1, rate=0.1)[1])
    for k in range(120):
        c = seeds[k % 3]
        name = str(rng.choice(["gain", "p", "tau", "right"]))
        value = np.array(getattr(c, name), float)
        value = value * (1 + rng.choice([-1, 1], size=value.shape) * 10 ** rng.uniform(-4, 0.3))
        value = (value + value.T) / 2 if name == "p" else value
        plain = {0: float, 1: lambda v: tuple(v.tolist()), 2: lambda v: tuple(map(tuple, v.tolist()))}[value.ndim](value)
        c = dataclasses.replace(c, **{name: plain})
        assert c.verify().holds == oracle.s_lemma_holds(c), c
        counts[c.verify().holds] += 1
    assert min(counts.values()) > 20


def test_certificates_travel_and_false_ones_are_refused(tmp_path, rungs):
    for name, changes, reason in (
        ("structure", {"tau": -1.0}, "the multipliers >= 0"),
        ("structure", {"rate": 5.0}, "the decrease of e'P e"),
        ("structure", {"right": ((9.0, 0.0),)}, "the decrease of e'P e"),
        ("structure", {"gain": ((1.0,), (2.0,), (3.0,))}, "gain: its size"),
        ("output injection", {"gain": ((-1.0,), (2.0,))}, "the decrease of e'P e"),
        ("output injection", {"p": ((1.0, 0.0), (0.0, -1.0))}, "P > 0 fails"),
        ("output injection", {"rate": 2.0}, "the decrease of e'P e"),
        ("output injection", {"rate": -1.0}, "rate >= 0"),
    ):
        c = rungs[name].certificate
        c.to_json(tmp_path / "c.json")
        assert certificates.load(tmp_path / "c.json") == c
        verdict = dataclasses.replace(c, **changes).verify()
        assert not verdict
        assert reason in verdict.why
        assert verdict.why.startswith("not certified")


def test_with_output_injection_the_error_is_exactly_linear():
    plant, gain = Pendulum(1.2), jnp.asarray([[0.3], [0.02]])  # a tiny gain: no Lipschitz condition would allow it
    observer = OutputInjection(plant, gain)
    k = np.eye(2, k=1) - np.asarray(gain) @ np.eye(1, 2)
    rng = np.random.default_rng(0)
    for _ in range(5):
        x, z, u = jnp.asarray(rng.normal(size=2)), jnp.asarray(rng.normal(size=2)), jnp.asarray(rng.normal(size=1))
        t = jnp.asarray(0.0)
        np.testing.assert_allclose(plant.flow(t, x, u) - observer.flow(t, z, u, x[:1]), k @ np.asarray(x - z), atol=1e-14)
        a, b = observer.split(t, z, u, x[:1])
        np.testing.assert_allclose(a @ z + b, observer.flow(t, z, u, x[:1]), atol=1e-14)
    ts = np.linspace(0, 20, 41)
    run = jaxobs.simulate(plant, observer, x0=[1.0, 0.0], xhat0=[0.0, 0.0], ts=ts, signal=Sine(0.5, 1.0), integrator=RK4(40))
    expected = np.stack([scipy.linalg.expm(k * t) @ [1.0, 0.0] for t in ts])
    np.testing.assert_allclose(run.x - run.xhat, expected, atol=1e-6)


def test_output_injection_keeps_the_other_states_in_phi_and_runs_sampled():
    plant = VanDerPol(1.3)
    observer = OutputInjection(plant, jnp.asarray([[8.0], [30.0]]))
    x, z, y = jnp.asarray([0.4, -0.3]), jnp.asarray([0.1, 0.5]), jnp.asarray([0.4])
    t, u = jnp.asarray(0.0), jnp.zeros(plant.m)
    mixed = jnp.asarray([0.4, 0.5])
    expected = jnp.stack([z[1], plant.phi(mixed, u)]) + jnp.asarray([8.0, 30.0]) * (x[0] - z[0])
    np.testing.assert_allclose(observer.flow(t, z, u, y), expected, rtol=1e-14)
    ts = np.arange(400) * 0.01
    run = jaxobs.simulate(plant, Sampled(observer, RK4(), 0.01), x0=[1.0, 0.0], xhat0=[0.0, 0.0], ts=ts)
    error = np.linalg.norm(np.asarray(run.x - run.xhat), axis=1)
    assert error[-1] < 0.1 * error[0]  # what is left is the delay of the held samples


@pytest.mark.parametrize(
    ("wishes", "words"),
    [
        ({"lipschitz": -1.0}, r"ladder\.lipschitz"),
        ({"alphas": [3.0, 2.0, 1.0]}, r"ladder\.alphas: given shape \(3,\)"),
        ({"alphas": [3.0, -2.0]}, "Hurwitz"),
        ({"gamma": 0.0}, r"ladder\.gamma"),
        ({"q": -1}, r"ladder\.q"),
        ({"states": (2,)}, "changes with x_1"),
        ({"states": (0,)}, "states"),
        ({"slopes": [(-1.0, 1.0)]}, "2 pairs"),
        ({"slopes": [(1.0, -1.0), (0.0, 0.0)]}, "lower <= upper"),
        ({"slopes": [(0.0, 0.0), (-1.0, 1.0)]}, "phi changes with x_1"),
    ],
)
def test_bad_input_is_named(as_users_have_it, wishes, words):
    with pytest.raises(ValueError, match=words):
        designs.ladder(Pendulum(), **({"alphas": ALPHAS} | KNOWN | wishes))
