"""A common quadratic Lyapunov function of 2x2 matrices, decided exactly: against two other criteria."""

from fractions import Fraction

import numpy as np
import pytest
from oracles import switching as oracle
from switched_cases import turned

from jaxobs.certificates import exact
from jaxobs.certificates.common_quadratic import common_quadratic, decrease

RNG = np.random.default_rng(0)


def stable(scale=3.0):
    while True:
        a = RNG.normal(size=(2, 2)) * scale
        if np.max(np.linalg.eigvals(a).real) < -1e-3:
            return a


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
