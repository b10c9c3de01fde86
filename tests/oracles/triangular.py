"""Theorem 1 of paper 003 decided by hand: the same inequality by Fractions and determinants, and simulated errors."""

import itertools
from fractions import Fraction

import numpy as np


def determinant(m):
    """By expansion along the first row: slow, and unlike elimination."""
    if len(m) == 1:
        return m[0][0]
    return sum((-1) ** j * m[0][j] * determinant([row[:j] + row[j + 1 :] for row in m[1:]]) for j in range(len(m)) if m[0][j])


def positive_definite(m):
    return all(determinant([row[:k] for row in m[:k]]) > 0 for k in range(1, len(m) + 1))


def holds(lower, upper, slopes, gain, p, weights, theta, rate):
    """Whether every corner satisfies -(M'P + P M) - 2 rate P - sum beta_ij (w_ij p_i p_i' + e_j e_j' / w_ij) > 0, P > 0."""
    n = len(gain)
    p = [[Fraction(x) for x in row] for row in p]
    t = Fraction(theta)
    if any(p[i][j] != p[j][i] for i in range(n) for j in range(n)) or not positive_definite(p):
        return False
    for corner in itertools.product(*zip(lower, upper, strict=True)):
        m = [[Fraction(0)] * n for _ in range(n)]
        for i in range(n):
            m[i][0] -= Fraction(gain[i]) / t**i
            if i < n - 1:
                m[i][i + 1] += t * Fraction(corner[i])
        total = [[-2 * Fraction(rate) * p[i][j] for j in range(n)] for i in range(n)]
        for i, j, k in itertools.product(range(n), repeat=3):
            total[i][j] -= m[k][i] * p[k][j] + p[i][k] * m[k][j]
        for i in range(n):
            for j in range(i + 1):
                beta, w = Fraction(slopes[i][j]) * t ** (j - i), Fraction(weights[i][j])
                for r, s in itertools.product(range(n), repeat=2):
                    total[r][s] -= beta * w * p[r][i] * p[s][i] + (beta / w if r == s == j else 0)
        if not positive_definite(total):
            return False
    return True


def worst_growth(lower, upper, slopes, gain, p, rng, count=4000):
    """max over random couplings and Jacobians within the bounds of the growth rate of e'P e, e = Delta eps; gain in e."""
    n, worst = len(gain), -np.inf
    for _ in range(count):
        a = np.where(rng.random(n - 1) < 0.5, lower, upper) if n > 1 else np.zeros(0)
        jacobian = np.tril(rng.choice([-1.0, 1.0], (n, n))) * slopes
        m = np.diag(a, 1) + jacobian - np.outer(gain, np.eye(1, n)[0])
        root = np.linalg.cholesky(p)
        scaled = root.T @ m @ np.linalg.inv(root.T)
        worst = max(worst, float(np.linalg.eigvalsh(scaled + scaled.T)[-1]))
    return worst
