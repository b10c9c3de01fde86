"""Proofs that no common quadratic Lyapunov function exists, against other criteria; floors on the gain; undetectable points."""

import dataclasses

import numpy as np
import pytest
from oracles import switching as oracle
from switched_cases import NONE, between, turned

from jaxobs import designs
from jaxobs.certificates import GainFloor, NoGain, Undetectability, load
from jaxobs.designs import Infeasible, corner_lmi, no_gain
from jaxobs.designs._frame import frame
from jaxobs.designs.no_gain import refuted
from jaxobs.designs.polytope import Polytope

RNG = np.random.default_rng(0)


def chain(n, slope):
    """x_i' = x_{i+1}, x_n' = phi(x) with |dphi/dx_j| <= slope, y = x_1."""
    bound = np.full(n, float(slope))
    return Polytope(np.eye(n, k=1), np.tile(np.eye(n)[:, -1:], (1, n)), np.eye(n), -bound, bound, np.eye(1, n))


def decided(model, gain, **options):
    """What is proved of this gain: that one P does it, or that none does."""
    try:
        return corner_lmi.prove(model, gain, **options)
    except Infeasible as error:
        if error.certificate is None:
            raise
        return error.certificate


@pytest.mark.parametrize("step", [False, True])
def test_pairs_are_decided_as_shorten_and_narendra_do(step):
    """Without a gain at all, n = 2: of two matrices one P or its impossibility is proved, never both, never neither."""
    outcomes = set()
    for _ in range(20):
        pair = RNG.normal(size=(2, 2, 2))
        if step:
            pair = [f / (np.max(np.abs(np.linalg.eigvals(f))) * RNG.uniform(1.02, 2)) for f in pair]
            exists = oracle.shorten_narendra(*map(oracle.cayley, pair))
        else:
            pair = [f - (np.max(np.linalg.eigvals(f).real) + RNG.uniform(0.1, 1)) * np.eye(2) for f in pair]
            exists = oracle.shorten_narendra(*pair)
        found = decided(between(*pair), NONE, step=step)
        assert found.verify()
        assert isinstance(found, NoGain) == (not exists)
        outcomes.add(exists)
    assert outcomes == {True, False}


@pytest.mark.parametrize(("k", "exists"), [(1.99, True), (2.01, False)])
def test_three_may_have_none_where_every_two_have_one(k, exists):
    """With P also its turns by 60 degrees would do, so their mean, a multiple of I: k < 2. For two of them k < 4/sqrt(3)."""
    a, b, c = (turned(angle, k) for angle in (0, np.pi / 3, 2 * np.pi / 3))
    assert all(oracle.shorten_narendra(*pair) for pair in ((a, b), (b, c), (a, c)))
    eye = np.eye(2)
    model = Polytope(a, np.hstack([b - a, c - a]), np.vstack([eye, eye]), np.zeros(4), np.ones(4), eye[:1], tied=(0, 0, 1, 1))
    points = np.array([[0, 0, 0, 0], [1, 1, 0, 0], [0, 0, 1, 1]], float)  # A, B, C: not all corners of this box
    found = refuted(frame(model, gain=NONE), model, points, NONE, rate=0.0, radius=None)
    assert (found is None) == exists
    assert exists or len(found.points) == 3


def rotating(growth):
    """y = x_1, x_1' = x_2 + rho x_3, |rho| <= 1, and (x_2, x_3) turns and grows: undetectable at no constant rho."""
    a = np.array([[0, 1, 0], [0, growth, 1], [0, -1, growth]], float)
    return Polytope(a, np.eye(3)[:, :1], np.eye(3)[2:], -np.ones(1), np.ones(1), np.eye(1, 3))


def test_no_gain_at_all():
    """While (x_2, x_3) decays a gain is found and certified; where it grows fast, none has one P, whatever L."""
    for growth, exists in ((-0.05, True), (2.0, False)):
        model = rotating(growth)
        found = no_gain(model)
        assert (found is None) == exists
        if exists:
            assert corner_lmi.synthesise(model)[1].verify()
        else:
            assert found.gain == ()
            assert designs.undetectable(model) is None
            with pytest.raises(Infeasible, match="any gain within reach at all corners, and none exists") as caught:
                corner_lmi.synthesise(model)
            assert caught.value.certificate == found


def test_a_chain_has_a_gain_and_small_gains_have_none():
    model = chain(3, 0.3)
    assert no_gain(model) is None
    found = no_gain(model, radius=0.2)
    assert found.verify()
    assert not dataclasses.replace(found, radius=20.0).verify()
    for gain in RNG.normal(size=(5, 3, 1)):  # each of them, on its own
        assert isinstance(decided(model, gain * 0.2 / np.linalg.norm(gain)), NoGain)


def test_step_models_and_rates():
    a = np.array([[0.9, 0.1], [0.1, 0.5]])  # at rho = 0.05 an eigenvalue is 0.971
    model = Polytope(a, np.eye(2)[:, :1], np.eye(2)[:1], np.zeros(1), 0.05 * np.ones(1), np.eye(2)[1:])
    assert no_gain(model, NONE, rate=0.98, step=True) is None
    assert no_gain(model, NONE, rate=0.96, step=True).verify()
    apart = dataclasses.replace(model, a=np.diag([0.9, 0.5]))
    assert no_gain(apart, rate=0.94, step=True).verify()  # y = x_2 says nothing of x_1
    assert no_gain(apart, rate=0.96, step=True) is None
    assert no_gain(chain(2, 0.5), np.array([[3.0], [4.0]]), rate=5.0).verify()


def test_floors_of_the_gain_on_the_chain_of_paper_002():
    """Every gain that is stable at all frozen slopes exceeds slope (1 + slope)^{i-1}: in norm 0.687, 172 and 3.9e6."""
    for k_f, printed in ((1, 0.687), (10, 172), (100, 3.9e6)):
        model, slope = chain(5, k_f / 5), k_f / 5
        floor, certificate = designs.gain_floor(model)
        assert floor == pytest.approx(np.linalg.norm(slope * (1 + slope) ** np.arange(5)), rel=1e-9)
        assert floor == pytest.approx(printed, rel=0.01)
        assert certificate.verify()
        assert not dataclasses.replace(certificate, level=floor * (1 + 1e-6)).verify()
        assert not dataclasses.replace(certificate, weights=tuple(-w for w in certificate.weights)).verify()


def test_no_stable_gain_is_below_the_floor():
    """Two states: alpha_1 + rate > slope + rate, and the product: against a grid of gains."""
    model, rate = chain(2, 0.5), 0.3
    floor, certificate = designs.gain_floor(model, rate=rate)
    assert isinstance(certificate, GainFloor)
    grid = np.stack(np.meshgrid(np.linspace(0, 4, 161), np.linspace(0, 4, 161)), -1).reshape(-1, 2, 1)
    closed = model.corners()[:, None] - grid @ model.output
    fast = np.all(np.linalg.eigvals(closed).real.max(-1) < -rate, axis=0)
    least = np.min(np.linalg.norm(grid[fast], axis=(1, 2)))
    assert floor < least < floor + 0.3


def test_undetectable_points_are_certified(tmp_path):
    model = Polytope(np.diag([0.5, -1.0]), np.zeros((2, 0)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.eye(2)[1:])
    point = designs.undetectable(model)
    assert isinstance(point.certificate, Undetectability)
    point.certificate.to_json(tmp_path / "u.json")
    assert load(tmp_path / "u.json") == point.certificate
    assert dataclasses.replace(point.certificate, rate=-0.5).verify()  # Re s >= 0.5, an eigenvalue on the border
    assert not dataclasses.replace(point.certificate, rate=-0.5000001).verify()
    assert dataclasses.replace(point.certificate, step=1, rate=0.5).verify()
    assert not dataclasses.replace(point.certificate, step=1, rate=0.5000001).verify()
    seen = dataclasses.replace(point.certificate, output=((1.0, 0.0),))  # the mode at -1 is unseen now
    assert not seen.verify()
    assert dataclasses.replace(seen, rate=1.0).verify()
    with pytest.raises(Infeasible, match="none exists") as caught:
        corner_lmi.synthesise(model)
    assert caught.value.certificate.verify()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"points": ((3.0,), (1.0,))}, "the box containing point 0"),
        ({"multipliers": ((-1.0, 0.0), (0.0, 1.0)) * 2}, "X >= 0 at point 0"),
        ({"multipliers": ((0.0, 0.0), (0.0, 0.0)) * 2}, "some X not zero"),
        ({"multipliers": ((1.0, 0.0),)}, "one multiplier a point"),
        ({"gain": ((9.0,), (9.0,))}, "sum F X"),
        ({"gain": ()}, "sum X output' = 0"),
        ({"rate": -9.0}, "sum F X"),
    ],
)
def test_other_numbers_prove_nothing(change, why):
    a, b = np.array([[0.0, 1.0], [-1.0, -0.1]]), np.array([[0.0, 1.0], [-4.0, -0.1]])
    model = Polytope(a, np.eye(2)[:, 1:], (b - a)[1:], np.zeros(1), np.ones(1), np.eye(1, 2))
    found = no_gain(model, NONE)
    assert found.verify()
    verdict = dataclasses.replace(found, **change).verify()
    assert not verdict
    assert why in verdict.why


@pytest.mark.usefixtures("as_users_have_it")
def test_bad_requests_are_refused():
    model = chain(2, 1.0)
    with pytest.raises(ValueError, match="looks transposed"):
        no_gain(model, np.ones((1, 2)))
    with pytest.raises(ValueError, match=r"no_gain\.radius: given -1.0; expected a positive number"):
        no_gain(model, radius=-1.0)
    with pytest.raises(ValueError, match=r"no_gain\.radius: given 1.0, with a gain"):
        no_gain(model, np.ones((2, 1)), radius=1.0)
    with pytest.raises(ValueError, match=r"gain_floor\.model: given 2 outputs; expected one"):
        designs.gain_floor(dataclasses.replace(model, output=np.eye(2)))
