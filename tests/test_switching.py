"""Growth under switching: exact enclosures of exponentials, searches, proofs."""

import dataclasses
from fractions import Fraction

import flint
import numpy as np
import pytest
from oracles import switching as oracle
from switched_cases import NONE, between, oscillator, turned

from jaxobs.certificates import NoGain, SwitchingInstability, checker_more, exact
from jaxobs.designs import audit
from jaxobs.designs.polytope import Polytope
from jaxobs.designs.switching import worst_switching

RNG = np.random.default_rng(0)


def test_exponential_encloses():
    unit = flint.arb(2) ** -checker_more.UNIT
    for n, time in ((2, 0.7), (3, 5.0), (4, 40.0)):
        m = RNG.normal(size=(n, n)) - 2 * np.eye(n)
        rows, radius = checker_more.exponential(checker_more.M(exact.matrix(m.tolist())), Fraction(time))
        with flint.ctx.workprec(1400):
            precise = (flint.arb_mat(n, n, m.reshape(-1).tolist()) * flint.arb(time)).exp()
            row_sums = [sum(abs(flint.arb(rows[i][j]) * unit - precise[i, j]) for j in range(n)) for i in range(n)]
            assert all(total <= flint.arb(radius) * unit for total in row_sums)
        assert radius < 2**70  # of 2^1024: 287 digits


def test_power():
    rows, _ = checker_more.power(checker_more.ball(checker_more.M(exact.matrix([[0.5, 0.25], [0.0, 0.75]]))), 13)
    expected = np.linalg.matrix_power(np.array([[0.5, 0.25], [0.0, 0.75]]), 13)
    unit = Fraction(2) ** checker_more.UNIT
    assert np.allclose([[float(x / unit) for x in row] for row in rows], expected, rtol=1e-14)


def test_two_stable_corners_unstable_under_switching():
    model = oscillator(0.02, 0.5, 2.0)
    found = audit(model, NONE)
    assert found.verdict == "unstable under switching (proved)"
    assert all(point.count.is_stable for point in found.frozen)
    assert isinstance(found.obstruction, NoGain)
    assert found.obstruction.verify()
    proof = found.counterexample
    assert isinstance(proof, SwitchingInstability)
    rate = proof.verify().margins["growth_rate"]
    matrices = [model.at(np.array(rho)) for rho in proof.points]
    measured = oracle.growth(matrices, proof.durations, step=False)
    assert 0.9 * measured < rate <= measured * (1 + 1e-9)
    # The classical answer, the stiff spring while |x| falls and the soft one while it grows, wins most a turn, not a second.
    assert found.switching.growth > oracle.switched_at_the_axes(0.02, 0.5, 2.0)
    assert np.isclose(found.switching.growth, oracle.best_alternation(matrices), rtol=1e-3)


def test_two_stable_matrices_unstable_when_they_alternate_in_discrete_time():
    a, b = np.array([[0.6, 0.6], [-0.6, 0.6]]), np.array([[0.5, 2.0], [0.0, 0.5]])
    found = audit(between(a, b), NONE, step=True)
    assert found.verdict == "unstable under switching (proved)"
    proof = found.counterexample
    measured = oracle.growth([between(a, b).at(np.array(rho)) for rho in proof.points], proof.durations, step=True)
    assert np.isclose(found.switching.growth, measured, rtol=1e-9)
    assert measured > 1
    assert 0 < proof.verify().margins["growth_rate"] <= np.log(measured) * (1 + 1e-9)


def test_the_search_goes_beyond_pairs_and_beyond_its_start():
    # A cycle of three rotations of a long ellipse: three segments do better than any two.
    matrices = np.stack([turned(angle) for angle in (0, np.pi / 3, 2 * np.pi / 3)])
    best = worst_switching(matrices)
    pair = worst_switching(matrices[:2]).growth  # of any two, by symmetry
    assert set(best.word) == {0, 1, 2}
    assert best.growth > pair + 0.1
    assert np.isclose(best.growth, oracle.growth([matrices[k] for k in best.word], best.durations, step=False), rtol=1e-9)


def test_a_stiff_switching_is_proved_all_the_same():
    """A fast oscillation at 3,000 rad/s beside slow ones: raw coordinates would lose every digit."""
    a = [[0, 1, 0, 0], [-48.6, -1.25, 48.6, 0], [0, 0, 0, 1], [19.5, 0, -19.5, 0]]
    gain = np.array([[60.0, 1.0], [9e6, 80.0], [0.0, 0.0], [19.41, -0.9032]])
    model = Polytope(np.array(a, float), np.eye(4)[:, 3:], np.eye(1, 4, 2), np.array([-3.3]), np.array([3.3]), np.eye(2, 4))
    found = audit(model, gain)
    assert found.verdict == "unstable under switching (proved)"
    proof = found.counterexample
    matrices = [model.at(np.array(rho)) - gain @ model.output for rho in proof.points]
    measured = oracle.growth(matrices, proof.durations, step=False)
    assert 0.9 * measured < proof.verify().margins["growth_rate"] <= measured * (1 + 1e-6)


def test_a_constant_word_is_a_switching_too():
    best = worst_switching(np.stack([np.diag([-1.0, -3.0]), np.diag([-2.0, -4.0])]))
    assert np.isclose(best.growth, -1.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"durations": (1.0,)}, "durations: its size does not fit"),
        ({"durations": (1.0, -1.0)}, "time 1 > 0"),
        ({"durations": (1.0, 1e12)}, "|F| t <= 2^30 at point 1"),
        ({"repeats": 10**9}, "1 to 256 repeats"),
        ({"step": 1, "durations": (1.5, 1.0)}, "in steps whole"),
    ],
)
def test_malformed_switchings_are_not_shown(change, why):
    proof = SwitchingInstability(
        a=((0.0, 1.0), (0.0, -0.02)), b=((0.0,), (-1.0,)), c=((1.0, 0.0),), lower=(0.5,), upper=(2.0,), output=((1.0, 0.0),),
        gain=((0.0,), (0.0,)), points=((2.0,), (0.5,)), durations=(1.11, 2.22), repeats=8,
    )  # fmt: skip
    assert proof.verify()
    verdict = dataclasses.replace(proof, **change).verify()
    assert not verdict
    assert why in verdict.why


@pytest.mark.parametrize("step", [0, 1])
@pytest.mark.parametrize("entries", [(0.0, 1e-301, 1e300, 0.0), (1e308, 1.0, 1.0, 0.0), (1e300, 1e300, 1e300, 1e300)])
@pytest.mark.parametrize("time", [1.0, 1e308, 1e-300])
def test_numbers_of_any_size_get_a_verdict(entries, time, step):
    a = (entries[:2], entries[2:])
    proof = SwitchingInstability(
        a=a, b=((), ()), c=(), lower=(), upper=(), output=((1.0, 0.0),), gain=((0.0,), (0.0,)), points=((),) * 64,
        durations=(time,) * 64, repeats=256, step=step,
    )  # fmt: skip
    verdict = proof.verify()
    assert not verdict
    assert verdict.why.startswith("not certified")
