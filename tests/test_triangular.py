"""Lemma 1 and theorem 1 of paper 003: gains, exact certificates against an oracle, refusals."""

import dataclasses
import re

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import triangular as oracle
from oracles.flint_certificates import judge

import jaxobs
from jaxobs import certificates, designs, plants, signals
from jaxobs.certificates import Corners
from jaxobs.designs.lemma1 import chain_model, constructed

MOTOR = plants.FieldMotor()
SLOPES = np.array([[2.0, 0, 0], [3.0, 1.0, 0], [0, 0, 0]])
COUPLINGS = [-3.0, -2.0], [-1.0, -2.0]  # of the motor, flux in [0.5, 1.5]


@pytest.fixture(scope="module")
def motor():
    return designs.triangular(MOTOR, slopes=SLOPES, couplings=COUPLINGS)


class Field(signals.AbstractSignal):
    m = 2

    def __call__(self, t):
        return jnp.stack([1 + 0.5 * jnp.sin(3 * t), jnp.cos(t)])


def judged(c):
    return judge(c.to_dict())


def theta_of(certificate, couplings=COUPLINGS):
    return certificate.gain[0][0] / designs.lemma1(*couplings).gain[0]


@pytest.mark.parametrize(("lower", "upper"), [([0.5], [2.0]), ([-3, 0.5], [-1, 1.0]), ([-2, -4], [-1, -2])])
def test_lemma_1_holds_inside_the_box_too(lower, upper):
    found = designs.lemma1(lower, upper)
    n = len(lower) + 1
    assert found.certificate.verify()
    assert found.certificate.gain == tuple((k,) for k in found.gain.tolist())  # of the gain as it is, in its own coordinates
    rng = np.random.default_rng(0)
    for _ in range(200):
        a = rng.uniform(lower, upper)
        m = np.diag(a, 1) - np.outer(found.gain, np.eye(1, n)[0])
        assert np.linalg.eigvalsh(m.T @ found.p + found.p @ m + 2 * found.certificate.rate * found.p)[-1] < 0


def test_signs_are_a_change_of_coordinates():
    plus, minus = designs.lemma1([1.0, 0.5], [2.0, 0.5]), designs.lemma1([-2.0, 0.5], [-1.0, 0.5])
    np.testing.assert_allclose(minus.gain, plus.gain * [1, -1, -1], rtol=1e-9)


@pytest.mark.parametrize(("n", "ratio"), [(2, 1.0), (2, 1e4), (3, 100.0), (4, 30.0), (5, 5.0)])
def test_the_construction_needs_no_solver(n, ratio):
    """The induction behind lemma 1, at ratios a'/a where the inequalities find nothing."""
    low, high = np.full(n - 1, ratio**-0.5), np.full(n - 1, ratio**0.5)
    gain, p = constructed(low, high, float(low.min(initial=1)))
    rate = float(low.min(initial=1))
    model = chain_model(low, high)
    fields = [tuple(map(tuple, m.tolist())) for m in (model.a, model.b, model.c, model.output)]
    a, b, c, output = fields
    rows = tuple(map(tuple, p.tolist()))
    column = tuple((float(k),) for k in gain)
    exact = certificates.Corners(a, b, c, tuple(low.tolist()), tuple(high.tolist()), output, column, rows, rate)
    assert exact.verify()
    none, ones = np.zeros((n, n)), np.ones((n, n))
    assert oracle.holds(low, high, none, gain, p, ones, 1.0, rate)
    assert not oracle.holds(low * 0.5, high, none, gain, p, ones, 1.0, 4 * rate)


def test_no_gain_exists_with_zero_inside():
    with pytest.raises(designs.Infeasible, match=re.escape("interval of a_2")) as error:
        designs.lemma1([1.0, -0.5], [2.0, 0.25])
    assert error.value.margin == -0.25
    assert "nothing is seen of x_3" in str(error.value)
    for edge in ([0.0], [1.0]), ([-1.0], [0.0]):
        with pytest.raises(designs.Infeasible, match="a_1"):
            designs.lemma1(*edge)


def test_theorem_1_for_the_motor(motor):
    observer, certificate = motor
    assert certificate.verify()
    assert judged(certificate)
    p = np.asarray(certificate.p)
    growth = oracle.worst_growth(*COUPLINGS, SLOPES, np.ravel(certificate.gain), p, np.random.default_rng(0))
    assert growth < 0
    ts = np.arange(0, 6, 0.002)
    run = jaxobs.simulate(MOTOR, observer, x0=[0.5, 3.0, -1.0], xhat0=np.zeros(3), ts=ts, signal=Field())
    e = np.asarray(run.x - run.xhat)
    v = np.einsum("ki,ij,kj->k", e, p, e)
    assert np.all(np.diff(v[v > 1e-18]) < 0)  # the certified function falls along the nonlinear simulation
    assert v[-1] < 1e-12 * v[0]


def test_rate_is_certified_and_costs_theta(motor):
    _, fast = designs.triangular(MOTOR, slopes=SLOPES, couplings=COUPLINGS, rate=2.0)
    assert fast.rate == 2.0
    assert theta_of(fast) > theta_of(motor[1])
    assert fast.verify().margins["decay_rate"] == 2.0
    assert judged(fast)


def test_a_chain_with_the_gain_of_the_paper():
    """(3) for the pendulum and K = (3, 2): theta from the free P of lemma 1 is below 5.7397 of condition (5), 000."""
    observer, certificate = designs.triangular(plants.Pendulum(), slopes=1.5, gain=[3.0, 2.0])
    theta = certificate.gain[0][0] / 3.0
    assert certificate.verify()
    assert judged(certificate)
    np.testing.assert_allclose(observer.gain[:, 0], [3 * theta, 2 * theta**2], rtol=1e-12)
    assert theta / 1.1 < 5.7397
    with pytest.raises(designs.Infeasible, match="is not certified"):
        designs.triangular(plants.Pendulum(), slopes=1.5, gain=[3.0, 2.0], theta=theta / 1.2)


def test_mutations_are_judged_like_the_oracle(motor):
    rng, counts = np.random.default_rng(3), {True: 0, False: 0}
    _, base = motor
    for _ in range(60):
        field = rng.choice(["rate", "gain", "slopes", "lower", "taus"])
        factor = float(1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-3, -0.5))
        if field == "rate":
            c = dataclasses.replace(base, rate=float(rng.uniform(0, 1)))
        elif field == "gain":
            c = dataclasses.replace(base, gain=tuple((g[0] * (factor if k == 0 else 1.0),) for k, g in enumerate(base.gain)))
        elif field == "slopes":
            lower, upper = ((*side[:2], *(x * factor for x in side[2:])) for side in (base.lower, base.upper))
            c = dataclasses.replace(base, lower=lower, upper=upper)
        elif field == "taus":
            c = dataclasses.replace(base, taus=tuple(x * factor for x in base.taus))
        else:
            c = dataclasses.replace(base, lower=(base.lower[0] * abs(factor), *base.lower[1:]))
        if c.lower[0] <= c.upper[0]:
            assert bool(c.verify()) == judged(c), c
            counts[bool(c.verify())] += 1
    assert min(counts.values()) > 3, counts


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"lower": (-1.0,)}, "lower: its size"),
        ({"lower": (0.0, -2.0, -2.0, -3.0, -1.0), "upper": (-1.0, -2.0, 2.0, 3.0, 1.0)}, "lower <= upper"),
        ({"taus": (0.0, 0.0, -1.0, 1.0, 1.0)}, "the multipliers >= 0"),
        ({"rate": float("nan")}, "rate: cannot convert NaN"),
        ({"p": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))}, "P > 0 fails"),
        ({"p": ((1.0,),)}, "p: its size"),
        ({"gain": ()}, "gain: its size"),
    ],
)
def test_malformed_claims_are_not_certified(motor, change, why):
    verdict = dataclasses.replace(motor[1], **change).verify()
    assert not verdict
    assert verdict.why.startswith("not certified")
    assert why in verdict.why


def test_the_file_tells_what_it_rests_on(motor, tmp_path):
    _, certificate = designs.triangular(MOTOR, slopes=SLOPES, couplings=COUPLINGS, origin="a data sheet")
    certificate.to_json(tmp_path / "c.json")
    again = certificates.load(tmp_path / "c.json")
    assert isinstance(again, Corners)
    assert again == certificate
    assert again.verify()
    assert "a data sheet" in " ".join(again.assumptions)
    assert repr(certificate.gain) in again.claim


class Plain(plants.AbstractTriangular):
    n, m = 2, 0

    def a(self, u):
        return jnp.ones((1,))

    def g(self, x, u):
        return jnp.stack([x[1] * 0, x[0]])


class Skipping(plants.AbstractTriangular):
    n, m = 3, 0

    def a(self, u):
        return jnp.ones((2,))

    def g(self, x, u):
        return jnp.stack([jnp.sin(x[2]), x[0], x[1]])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: designs.triangular(plants.Lorenz(), slopes=1.0), ("triangular.plant", "Lorenz", "lpv_lmi")),
        (lambda: designs.triangular(Skipping(), slopes=1.0), ("not triangular: dF_1/dx_3", "g_i of x_1, ..., x_i alone")),
        (lambda: designs.triangular(Plain(), slopes=1.0), ("triangular.couplings", "bounds of a_i(u)")),
        (lambda: designs.triangular(MOTOR, slopes=1.0, couplings=([1.0], [2.0])), ("triangular.couplings", "(2,)")),
        (lambda: designs.triangular(MOTOR, slopes=1.0, couplings=([2, 2], [1, 1])), ("couplings", "lowest <= highest")),
        (lambda: designs.triangular(MOTOR, slopes=np.ones((3, 3)), couplings=COUPLINGS), ("slopes", "lower triangular")),
        (lambda: designs.triangular(MOTOR, slopes=-1.0, couplings=COUPLINGS), ("slopes", ">= 0")),
        (lambda: designs.triangular(plants.Pendulum(), slopes=1.0, gain=[1.0]), ("triangular.gain", "(2,)")),
        (lambda: designs.triangular(plants.Pendulum(), slopes=1.0, theta=-1.0), ("triangular.theta", "positive")),
    ],
)
@pytest.mark.usefixtures("as_users_have_it")
def test_refused(call, words):
    with pytest.raises(ValueError, match="given") as error:
        call()
    assert all(word in str(error.value) for word in words), str(error.value)


def test_theta_too_small_says_what_would_do():
    with pytest.raises(designs.Infeasible, match="theta = 1 is not certified") as error:
        designs.triangular(plants.Pendulum(), slopes=1.5, theta=1.0)
    assert error.value.best is not None
    _, certificate = designs.triangular(plants.Pendulum(), slopes=1.5, theta=error.value.best)
    assert certificate.verify()
    with pytest.raises(designs.Infeasible, match="interval of a_1"):
        designs.triangular(MOTOR, slopes=SLOPES, couplings=([-3.0, -2.0], [1.0, -2.0]))
