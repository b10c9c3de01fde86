"""Lemmas 1 and 2, and the completion of the square (60): decided in exact arithmetic."""

from fractions import Fraction

import numpy as np

from jaxobs.certificates import exact
from jaxobs.papers.claims import Statement
from jaxobs.papers.p000.paper import PAPER


def _random(rng: np.random.Generator, rows: int, columns: int) -> exact.Matrix:
    return [[Fraction(int(k), 3) for k in row] for row in rng.integers(-4, 5, (rows, columns))]


def _symmetric(rng: np.random.Generator, n: int) -> exact.Matrix:
    x = _random(rng, n, n)
    return exact.add(x, exact.transpose(x))


@PAPER.claim("Lemma 1", "universal", printed="Q > 0, M + N'Q^-1 N < 0 iff [M, N'; N, -Q] < 0")
def _():
    """[M N'; N -Q] = T' diag(M + N'Q^-1 N, -Q) T with T = [I 0; -Q^-1 N, I], for any invertible Q."""
    rng, agree = np.random.default_rng(0), 0
    for _ in range(20):
        r = _random(rng, 2, 2)
        q = exact.add(exact.product(r, exact.transpose(r)), exact.identity(2))
        determinant = q[0][0] * q[1][1] - q[0][1] * q[1][0]
        inverse = exact.scale(1 / determinant, [[q[1][1], -q[0][1]], [-q[1][0], q[0][0]]])
        m, n = exact.subtract(_symmetric(rng, 2), exact.scale(Fraction(9), exact.identity(2))), _random(rng, 2, 2)
        schur = exact.add(m, exact.product(exact.transpose(n), exact.product(inverse, n)))
        t = exact.block(
            [
                [exact.identity(2), exact.zeros(2, 2)],
                [exact.scale(Fraction(-1), exact.product(inverse, n)), exact.identity(2)],
            ]
        )
        middle = exact.block([[schur, exact.zeros(2, 2)], [exact.zeros(2, 2), exact.scale(Fraction(-1), q)]])
        whole = exact.block([[m, exact.transpose(n)], [n, exact.scale(Fraction(-1), q)]])
        agree += whole == exact.product(exact.transpose(t), exact.product(middle, t))
    return Statement(
        agree == 20, f"{agree} of 20", f"the congruence that proves it, exactly, for {agree} of 20 rational matrices"
    )


@PAPER.claim("(1) Lemma 2", "universal", printed="gamma int w'M w >= (int w)' M (int w)")
def _():
    """For w(s) = sum_k w_k s^k: gap = sum_ij w_i' M w_j gamma^{i+j+2} K_ij, K_ij = 1/(i+j+1) - 1/((i+1)(j+1))."""
    size = 12
    k = [[Fraction(1, i + j + 1) - Fraction(1, (i + 1) * (j + 1)) for j in range(1, size)] for i in range(1, size)]
    degree = size - 1
    why = f"for polynomials of degree {degree} the gap is a quadratic form with the positive definite kernel K (x) M, exactly"
    return Statement(
        exact.is_positive_definite(k), f"degree {degree}", why + "; equality for constant w; polynomials are dense"
    )


@PAPER.claim("(60)", "universal", printed="Z1'Z2 + Z2'Z1 <= eps Z1'Z1 + Z2'Z2 / eps")
def _():
    """The right side minus the left is (sqrt(eps) Z1 - Z2 / sqrt(eps))' (the same)."""
    rng, agree = np.random.default_rng(1), 0
    for _ in range(20):
        one, two, eps = _random(rng, 2, 3), _random(rng, 2, 3), Fraction(int(rng.integers(1, 9)), 4)
        cross = exact.product(exact.transpose(one), two)
        left = exact.add(cross, exact.transpose(cross))
        squares = exact.add(
            exact.scale(eps, exact.product(exact.transpose(one), one)),
            exact.scale(1 / eps, exact.product(exact.transpose(two), two)),
        )
        root = exact.subtract(exact.scale(eps, one), two)
        agree += exact.subtract(squares, left) == exact.scale(1 / eps, exact.product(exact.transpose(root), root))
    return Statement(
        agree == 20, f"{agree} of 20", "the difference is a square; the matrices need be neither symmetric nor square"
    )
