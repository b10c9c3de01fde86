"""Roots counted exactly, by half-planes, disc and gaps: against LAPACK and FLINT."""

from fractions import Fraction

import flint
import numpy as np
import pytest
from oracles import switching as oracle

from jaxobs.certificates import exact, polynomial, routh

RNG = np.random.default_rng(0)


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


def test_roots_with_and_without_multiplicity():
    assert polynomial.real_roots([1, -2, 1]) == 2
    assert polynomial.distinct_real_roots([1, -2, 1]) == 1
