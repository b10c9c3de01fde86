"""The audit of a gain: exact counts against LAPACK, exact 2x2 decisions against two other criteria, switching, verdicts."""

import dataclasses
from fractions import Fraction

import flint
import numpy as np
import pytest
from oracles import switching as oracle

from jaxobs.certificates import (
    Corners,
    FrozenInstability,
    NoCommonQuadratic,
    StepCorners,
    SwitchingInstability,
    balls,
    exact,
    load,
    polynomial,
    routh,
)
from jaxobs.certificates.common_quadratic import common_quadratic, decrease
from jaxobs.designs import audit
from jaxobs.designs.polytope import Polytope
from jaxobs.designs.switching import worst_switching

RNG = np.random.default_rng(0)
ONE = [[1.0, 0.0]]
NONE = np.zeros((2, 1))


def polytope(a, b, c, lower, upper):
    return Polytope(*(np.array(x, float) for x in (a, b, c, lower, upper, ONE)))


def oscillator(damping, low, high):
    """x'' + damping x' + k x = 0 with k between low and high."""
    return polytope([[0, 1], [0, -damping]], [[0], [-1]], ONE, [low], [high])


def between(a, b):
    """The segment from A to B as a polytope with one parameter of any rank."""
    u, s, v = np.linalg.svd(b - a)
    return Polytope(a, u * s, v, np.zeros(len(a)), np.ones(len(a)), np.eye(1, len(a)), tied=(0,) * len(a))


def stable(scale=3.0):
    while True:
        a = RNG.normal(size=(2, 2)) * scale
        if np.max(np.linalg.eigvals(a).real) < -1e-3:
            return a


@pytest.mark.parametrize("n", range(1, 8))
@pytest.mark.parametrize("step", [False, True])
def test_count_equals_lapack(n, step):
    for k in range(25):  # integers meet the border and rows of zeros; normals do not
        matrix = RNG.integers(-2, 3, size=(n, n)) / (2.0 if step else 1.0) if k % 2 else RNG.normal(size=(n, n))
        assert tuple(routh.frozen(exact.matrix(matrix.tolist()), step=step)) == oracle.count(matrix, step, 1e-5)


@pytest.mark.parametrize(
    ("roots", "expected"),
    [
        ([1j, -1j, 1j, -1j, -1, 2], (1, 4, 1)),
        ([0, 0, 0], (0, 3, 0)),
        ([1, -1, 2, -2, 1j, -1j], (2, 2, 2)),
        ([3, 3, -3, -3, -1 + 1j, -1 - 1j], (4, 0, 2)),
        ([1 + 1j, 1 - 1j, -1 + 1j, -1 - 1j], (2, 0, 2)),
        ([-1, -2, 0], (2, 1, 0)),
    ],
)
def test_count_of_symmetric_and_border_roots(roots, expected):
    poly = [Fraction(round(a.real)) for a in np.poly(roots)]
    assert tuple(routh.half_planes(poly)) == expected


def test_count_in_the_disc_knows_both_ends_of_the_circle():
    assert tuple(routh.disc([1, 0, -1])) == (0, 2, 0)  # z = 1 and z = -1, which the bilinear map sends to infinity
    assert tuple(routh.disc([2, 3, 1])) == (1, 1, 0)  # -1/2, -1
    assert tuple(routh.disc([1, 2, 0])) == (1, 0, 1)  # 0, -2


def test_characteristic_polynomial_equals_flint():
    for n in range(1, 7):
        m = [[Fraction(int(a), int(b)) for a, b in zip(*pair, strict=True)] for pair in RNG.integers(1, 99, size=(n, 2, n))]
        theirs = flint.fmpq_mat(n, n, [flint.fmpq(x.numerator, x.denominator) for row in m for x in row]).charpoly()
        ours = routh.characteristic_polynomial(m)
        assert [(int(c.p), int(c.q)) for c in theirs.coeffs()[::-1]] == [(c.numerator, c.denominator) for c in ours]


def test_one_point_in_each_gap_between_roots():
    points = polynomial.between_real_roots([[1, -1], [1, 0, -1], [1, -2, 1], [1, -3], [1, 0, 1]])  # roots -1, 1, 3
    assert [sum(x > root for root in (-1, 1, 3)) for x in points] == [0, 1, 2, 3]
    assert len(polynomial.between_real_roots([[1, 0, 1]])) == 1
    assert polynomial.real_roots([1, -2, 1]) == 2
    assert polynomial.distinct_real_roots([1, -2, 1]) == 1


def test_pairs_are_decided_as_shorten_and_narendra_do():
    outcomes = set()
    for _ in range(25):
        a, b = stable(), stable()
        matrices = [exact.matrix(m.tolist()) for m in (a, b)]
        decision = common_quadratic(matrices)
        assert decision.exists == oracle.shorten_narendra(a, b)
        outcomes.add(decision.exists)
        if decision.exists:
            assert all(exact.is_positive_definite(decrease(m, decision.p)) for m in matrices)
            assert exact.is_positive_definite(decision.p)
        else:
            assert decision.blocking == (0, 1)
    assert outcomes == {True, False}


def test_discrete_pairs_are_decided_as_their_cayley_images():
    outcomes = set()
    for _ in range(15):
        a, b = (f / (np.max(np.abs(np.linalg.eigvals(f))) * RNG.uniform(1.02, 2)) for f in RNG.normal(size=(2, 2, 2)))
        matrices = [exact.matrix(m.tolist()) for m in (a, b)]
        decision = common_quadratic(matrices, step=True)
        assert decision.exists == oracle.shorten_narendra(oracle.cayley(a), oracle.cayley(b))
        outcomes.add(decision.exists)
        if decision.exists:
            assert all(exact.is_positive_definite(decrease(m, decision.p, step=True)) for m in matrices)
    assert outcomes == {True, False}


def turned(angle, k=6.0):
    """A matrix whose quadratic Lyapunov functions are long ellipses in one direction."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return turn @ np.array([[-1.0, k], [0.0, -1.0]]) @ turn.T


@pytest.mark.parametrize(("k", "exists"), [(1.99, True), (2.01, False), (2.3, False)])
def test_three_may_have_none_where_every_two_have_one(k, exists):
    """With P also its turns by 60 degrees would do, so their mean, a multiple of I: k < 2. For two of them k < 4/sqrt(3)."""
    matrices = [turned(angle, k) for angle in (0, np.pi / 3, 2 * np.pi / 3)]
    assert all(oracle.shorten_narendra(matrices[i], matrices[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    decision = common_quadratic([exact.matrix(m.tolist()) for m in matrices])
    assert decision.exists == exists
    assert decision.blocking == (() if exists else (0, 1, 2))


def test_a_common_p_of_four_is_found_and_an_unstable_matrix_is_named():
    matrices = [exact.matrix(turned(angle, 1.5).tolist()) for angle in (0, 0.4, 0.9, 1.4)]
    decision = common_quadratic(matrices)
    assert all(exact.is_positive_definite(decrease(m, decision.p)) for m in matrices)
    assert common_quadratic([matrices[0], exact.matrix([[1.0, 0.0], [0.0, -1.0]])]).blocking == (1,)
    # Proportional matrices have the same curve: no resultant.
    assert common_quadratic([matrices[0], exact.scale(Fraction(3), matrices[0])]).exists


def test_a_triangular_matrix_has_a_parabola():
    one, other = [[-1.0, 2.0], [0.0, -3.0]], [[-2.0, 0.0], [1.0, -1.0]]
    decision = common_quadratic([exact.matrix(one), exact.matrix(other)])
    assert decision.exists == oracle.shorten_narendra(np.array(one), np.array(other))


def test_exponential_encloses():
    for n, time in ((2, 0.7), (3, 5.0), (4, 40.0)):
        m = RNG.normal(size=(n, n)) - 2 * np.eye(n)
        ball = balls.exponential(exact.matrix(m.tolist()), Fraction(time))
        flint.ctx.prec = 700
        precise = (flint.arb_mat(n, n, m.reshape(-1).tolist()) * flint.arb(time)).exp()
        unit = flint.arb(2) ** -balls.BITS
        row_sums = [sum(abs(flint.arb(ball.middle[i][j]) * unit - precise[i, j]) for j in range(n)) for i in range(n)]
        assert all(total <= flint.arb(ball.radius) * unit for total in row_sums)
        assert ball.radius < 2**60  # of 2^512: 136 digits


def test_power_and_trace():
    ball = balls.enclose(exact.matrix([[0.5, 0.25], [0.0, 0.75]]))
    raised = balls.power(ball, 13)
    expected = np.linalg.matrix_power(np.array([[0.5, 0.25], [0.0, 0.75]]), 13)
    assert np.allclose(np.array(raised.middle, float) / 2.0**balls.BITS, expected, rtol=1e-14)
    assert not balls.trace_exceeds(balls.enclose(exact.identity(2)), 2)
    assert balls.trace_exceeds(balls.enclose(exact.scale(Fraction(101, 100), exact.identity(2))), 2)


def test_a_good_gain_is_certified():
    found = audit(oscillator(2.0, 0.5, 2.0), NONE)
    assert found.verdict == "certified"
    assert isinstance(found.certificate, Corners)
    assert found.certificate.verify()
    assert found.counterexample is found.obstruction is None
    assert found.switching.growth < 0
    assert all(point.count.is_stable for point in found.frozen)


def test_a_bad_corner_is_named_exactly():
    found = audit(polytope([[0, 1], [0, 0]], [[0], [1]], ONE, [-1.0], [2.0]), [[2.0], [1.5]])
    assert found.verdict == "unstable at corner 1 (exact)"
    assert found.counterexample.rho == (2.0,)
    assert found.counterexample.verify()
    assert found.certificate is None
    assert [point.count for point in found.frozen][:2] == [(2, 0, 0), (1, 0, 1)]


def test_an_eigenvalue_on_the_axis_is_marginal_and_not_unstable():
    found = audit(oscillator(0.0, 1.0, 2.0), NONE)
    assert found.verdict == "marginal at corner 0 (exact)"
    assert found.counterexample is None


def test_an_unstable_inside_between_stable_corners_is_found():
    a, b = np.array([[-1.0, 10.0], [0.0, -1.0]]), np.array([[-1.0, 0.0], [10.0, -1.0]])
    found = audit(between(a, b), NONE)
    assert found.verdict == "unstable at centre (exact)"
    assert found.frozen[0].count.is_stable
    assert found.frozen[1].count.is_stable


def test_two_stable_corners_unstable_under_switching():
    model = oscillator(0.02, 0.5, 2.0)
    found = audit(model, NONE)
    assert found.verdict == "unstable under switching (proved)"
    assert all(point.count.is_stable for point in found.frozen)
    assert isinstance(found.obstruction, NoCommonQuadratic)
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


def test_neither_proved_nor_disproved_is_said_as_such():
    a, b = np.array([[0.6, 0.6], [-0.6, 0.6]]), np.array([[0.5, 1.3], [0.0, 0.5]])
    found = audit(between(a, b), NONE, step=True)
    assert found.verdict == "not certified"
    assert found.obstruction.verify()
    assert "error grows" not in found.obstruction.claim
    assert 0.9 < found.switching.growth < 1
    assert found.counterexample is None


def test_discrete_gain_is_certified():
    found = audit(polytope([[0.5, 0.1], [0.0, 0.2]], [[0], [1]], ONE, [-0.1], [0.1]), NONE, step=True, search=False)
    assert found.verdict == "certified"
    assert isinstance(found.certificate, StepCorners)
    assert found.switching is None


def test_the_search_goes_beyond_pairs_and_beyond_its_start():
    # A cycle of three rotations of a long ellipse: three segments do better than any two.
    matrices = np.stack([turned(angle) for angle in (0, np.pi / 3, 2 * np.pi / 3)])
    best = worst_switching(matrices)
    pair = worst_switching(matrices[:2]).growth  # of any two, by symmetry
    assert set(best.word) == {0, 1, 2}
    assert best.growth > pair + 0.1
    assert np.isclose(best.growth, oracle.growth([matrices[k] for k in best.word], best.durations, step=False), rtol=1e-9)


def test_a_model_without_parameters_is_its_only_corner():
    model = Polytope(
        np.array([[0.0, 1.0], [-1.0, 0.5]]), np.zeros((2, 0)), np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.eye(1, 2)
    )
    assert audit(model, np.array([[2.0], [1.0]])).verdict == "certified"
    found = audit(model, NONE)
    assert found.verdict == "unstable at corner 0 (exact)"
    assert found.counterexample.verify()


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


def test_a_larger_rate_than_proved_is_not_certified():
    found = audit(oscillator(2.0, 0.5, 2.0), NONE, rate=5.0, search=False)
    assert found.verdict == "not certified"
    assert "decay rate" in found.reason
    assert found.obstruction is None


def test_prints_a_table():
    text = str(audit(oscillator(0.02, 0.5, 2.0), NONE))
    assert text.startswith("gain [[0.0], [0.0]]: unstable under switching (proved)")
    for part in ("corner 0", "corner 1", "centre", "worst inside", "(exact)", "none exists (exact): (0.5), (2)", "lower bound"):
        assert part in text


@pytest.mark.usefixtures("as_users_have_it")
def test_bad_gains_are_refused():
    with pytest.raises(ValueError, match=r"gain: given shape \(1, 2\).*transposed"):
        audit(oscillator(2.0, 0.5, 2.0), NONE.T)
    with pytest.raises(ValueError, match=r"audit\.gain: given .*nan.*finite"):
        audit(oscillator(2.0, 0.5, 2.0), [[np.nan], [0.0]])


def proofs():
    switching = audit(oscillator(0.02, 0.5, 2.0), NONE)
    corner = audit(polytope([[0, 1], [0, 0]], [[0], [1]], ONE, [-1.0], [2.0]), [[2.0], [1.5]])
    return corner.counterexample, switching.obstruction, switching.counterexample


def test_certificates_travel_and_do_not_hold_for_other_numbers(tmp_path):
    changes = ({"rho": (-1.0,)}, {"points": ((0.5,),)}, {"durations": (1e-3, 1e-3)})
    for k, (proof, change) in enumerate(zip(proofs(), changes, strict=True)):
        proof.to_json(tmp_path / f"{k}.json")
        again = load(tmp_path / f"{k}.json")
        assert again == proof
        assert again.verify()
        assert not dataclasses.replace(proof, **change).verify()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"rho": (3.0,)}, "does not lie within the bounds"),
        ({"rho": (1.0, 1.0)}, "does not lie within the bounds"),
        ({"step": 2}, "step = 2"),
        ({"gain": ((1.0,),)}, "gain is not of shape"),
        ({"a": ((float("nan"), 1.0), (0.0, 0.0))}, "not finite"),
        ({"tied": (0, 0)}, "2 ties for 1 channels"),
        ({"upper": ()}, "bounds are not finite numbers"),
    ],
)
def test_malformed_certificates_are_not_shown(change, why):
    proof = FrozenInstability(
        ((0.0, 1.0), (0.0, 0.0)), ((0.0,), (1.0,)), ((1.0, 0.0),), ((1.0, 0.0),), ((2.0,), (1.5,)), (-1.0,), (2.0,), (2.0,)
    )
    assert proof.verify()
    verdict = dataclasses.replace(proof, **change).verify()
    assert not verdict
    assert why in verdict.why


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"durations": (1.0,)}, "2 points, 1 durations"),
        ({"durations": (1.0, -1.0)}, "not a positive number"),
        ({"durations": (1.0, 1e12)}, "shorter segments"),
        ({"repeats": 10**9}, "1000000000 repeats"),
        ({"step": 1, "durations": (1.5, 1.0)}, "whole number of steps"),
    ],
)
def test_malformed_switchings_are_not_shown(change, why):
    proof = SwitchingInstability(
        ((0.0, 1.0), (0.0, -0.02)), ((0.0,), (-1.0,)), ((1.0, 0.0),), ((1.0, 0.0),), ((0.0,), (0.0,)), (0.5,), (2.0,),
        ((2.0,), (0.5,)), (1.11, 2.22), 8,
    )  # fmt: skip
    assert proof.verify()
    verdict = dataclasses.replace(proof, **change).verify()
    assert not verdict
    assert why in verdict.why
