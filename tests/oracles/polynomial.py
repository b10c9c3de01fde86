"""Weights and spectral factors of polynomials, by multiplication and by roots."""

import numpy as np


def weights(alphas):
    """q_1..q_n from alpha(s) alpha(-s) = (-1)^n [s^{2n} + sum_i (-1)^i q_i s^{2n-2i}]."""
    a = np.concatenate([[1.0], np.asarray(alphas, float)])
    n = len(a) - 1
    product = (-1) ** n * np.polymul(a, a * (-1.0) ** (n - np.arange(n + 1)))
    return (-1.0) ** np.arange(1, n + 1) * product[2::2]


def printed_weights(alphas):
    """Paper 000, (8), as printed: wrong from n = 4."""
    a = [1.0, *alphas]
    n = len(alphas)
    q = [a[1] ** 2 - 2 * a[2]]
    for i in range(2, n):
        q.append(a[i] ** 2 + 2 * sum((-1) ** (k + i - 1) * a[k + 1] * a[k - 1] for k in range(i, n)))
    return np.asarray([*q, a[n] ** 2])


def spectral_factor(q):
    """The Hurwitz alpha with weights q: the left half of the roots of s^{2n} + sum_i (-1)^i q_i s^{2n-2i}."""
    squares = np.roots(np.concatenate([[1.0], (-1.0) ** np.arange(1, len(q) + 1) * q]))
    return np.poly(-np.sqrt(squares.astype(complex))).real[1:]
