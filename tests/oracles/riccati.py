"""Condition (5) of paper 000, literally: a Riccati solver, matrix square roots, bisection."""

import numpy as np
import scipy.linalg

from oracles.polynomial import weights


def chain(n):
    """(A, C) of the chain of n integrators with y = x_1."""
    return np.eye(n, k=1), np.eye(1, n)


def solve(alphas, gamma=1.0):
    """(P, Q) of A P + P A' - P C'C P + Q = 0, Q = diag(q_i gamma^{2i}); no closed form, no scaling."""
    n = len(alphas)
    a, c = chain(n)
    q = np.diag(weights(alphas) * gamma ** (2.0 * np.arange(1, n + 1)))
    return scipy.linalg.solve_continuous_are(a.T, c.T, q, np.eye(1)), q


def parts(alphas, gamma):
    """(lambda_min(P^-1/2 Q P^-1/2), 2 sqrt((P^-1)_nn lambda_max(P)))."""
    p, q = solve(alphas, gamma)
    root = scipy.linalg.inv(scipy.linalg.sqrtm(p))
    left = np.linalg.eigvalsh(root @ q @ root)[0]
    return left, 2 * np.sqrt(scipy.linalg.inv(p)[-1, -1] * np.linalg.eigvalsh(p)[-1])


def largest_lipschitz(alphas, gamma):
    left, right = parts(alphas, gamma)
    return left / right


def smallest_gamma(alphas, rho, low=1e-2, high=1e3):
    """The root of the increasing largest_lipschitz(gamma) = rho."""
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if largest_lipschitz(alphas, middle) >= rho else (middle, high)
    return high
