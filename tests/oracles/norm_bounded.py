"""Slopes M F N, |F| <= 1, by other routes: exact Schur complements, directions, polynomials, corners, simplex search."""

import flint
import numpy as np
import scipy.optimize

from oracles import riccati
from oracles.certificate import positive, rational


def _matrix(rows):
    return flint.fmpq_mat(len(rows), len(rows[0]), [rational(x) for row in rows for x in row])


def _closed(c):
    """(a - L output, M, N), exactly."""
    return _matrix(c.a) - _matrix(c.gain) * _matrix(c.output), _matrix(c.left), _matrix(c.right)


def _listed(matrix):
    return [[matrix[i, j] for j in range(matrix.ncols())] for i in range(matrix.nrows())]


def _positive(matrix):
    rows = _listed(matrix)
    return all(rows[i][j] == rows[j][i] for i in range(len(rows)) for j in range(i)) and positive(rows)


def s_lemma_holds(c):
    """S - tau N'N - P M M'P / tau > 0 with S = -(K'P + P K) - 2 rate P, for the floats of a certificate without channels."""
    k, m, n = _closed(c)
    p, tau = _matrix(c.p), rational(c.tau)
    if not (tau > 0 and rational(c.rate) >= 0 and _positive(p)):
        return False
    s = -1 * (k.transpose() * p + p * k) - p * (2 * rational(c.rate))
    return _positive(s - n.transpose() * n * tau - p * m * m.transpose() * p * (1 / tau))


def euler_model_holds(c):
    """f^2 P - tau N'N - K'P R^-1 P K > 0 with R = P - P M M'P / tau > 0, for the floats of a certificate without channels."""
    k, m, n = _closed(c)
    p, tau, factor = _matrix(c.p), rational(c.tau), rational(c.factor)
    if not (tau > 0 and 0 < factor <= 1 and _positive(p)):
        return False
    rest = p - p * m * m.transpose() * p * (1 / tau)
    if not _positive(rest):
        return False
    return _positive(p * (factor * factor) - n.transpose() * n * tau - k.transpose() * p * rest.inv() * p * k)


def bisect(holds, low, high):
    """The edge between low, where `holds` is false, and high, where it is true."""
    for _ in range(100):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high


def same_p_gamma(alphas, rho):
    """n = 2, all states in phi: 2 rho |(P^-1)_2. e| |e| < e'S e for every direction e, S = P^-1 Q P^-1 + C'C."""
    angles = np.linspace(0, np.pi, 40_001)
    e = np.stack([np.cos(angles), np.sin(angles)])

    def holds(gamma):
        p, q = riccati.solve(alphas, gamma)
        x = np.linalg.inv(p)
        s = x @ q @ x + np.diag([1.0, 0.0])
        scale = np.array([1.0, gamma])[:, None]  # directions that see both states
        d = e * scale
        return np.min(np.sum(d * (s @ d), axis=0) - 2 * rho * np.abs(x[1] @ d) * np.linalg.norm(d, axis=0)) > 0

    return bisect(holds, 0.1, 100.0)


def h_infinity(alphas, gamma, rows):
    """The largest |T(i w)| of T = rows of adj(s - K) e_N over det(s - K), K = A - alphas_i gamma^i C: the peak of a ratio of
    polynomials in w^2, by the roots of its derivative."""
    gain = np.asarray(alphas) * gamma ** np.arange(1.0, len(alphas) + 1)
    numerators = [np.concatenate([[1.0], gain[:i]]) for i in range(len(gain))]  # (s - K)^-1 e_N: the Horner polynomials of det

    def squared(coefficients):
        """|p(i w)|^2 as a polynomial in w^2, highest power first."""
        product = np.polymul(coefficients, coefficients * (-1.0) ** np.arange(len(coefficients) - 1, -1, -1))
        degree = len(coefficients) - 1
        return np.array([product[2 * k] * (-1.0) ** (degree - k) for k in range(degree + 1)])

    above = np.zeros(1)
    for row in rows:
        mixed = np.zeros(1)
        for weight, numerator in zip(row, numerators, strict=True):
            mixed = np.polyadd(mixed, weight * numerator)
        above = np.polyadd(above, squared(np.trim_zeros(mixed, "f")))
    below = squared(np.concatenate([[1.0], gain]))
    turning = np.roots(np.polysub(np.polymul(np.polyder(above), below), np.polymul(above, np.polyder(below))))
    places = [0.0, *(w.real for w in turning if abs(w.imag) < 1e-6 * abs(w) and w.real > 0)]
    return np.sqrt(max(np.polyval(above, w) / np.polyval(below, w) for w in places))


def free_p_gamma(alphas, rho, rows):
    """rho |T|_inf = 1."""
    return bisect(lambda gamma: rho * h_infinity(alphas, gamma, rows) < 1, 0.05, 100.0)


def riccati_period(alphas, gamma, rho, q=0):
    """(63) when x_1 alone enters phi: K'X K < X at both slopes +-rho (one scalar F: the S-lemma is exact), bisection in dt."""
    p, _ = riccati.solve(alphas, gamma)
    size = len(p)
    x, slope = np.linalg.inv(p), rho * np.eye(size)[:, -1:] @ np.eye(size)[q : q + 1]
    a = np.eye(size, k=1) - p[:, :1] @ np.eye(1, size)
    d = gamma ** np.arange(1.0, size + 1)

    def fails(dt):
        corners = (np.eye(size) + dt * (a + sign * slope) for sign in (-1, 1))
        return any(np.linalg.eigvalsh((x - k.T @ x @ k) * np.outer(d, d))[0] <= 0 for k in corners)

    return bisect(fails, 1e-6, 10.0)


def tied_margin(dt, rho, q=0):
    """sup over X of the smallest eigenvalue of [X, *; X K, X] at both slopes, X K = X (I + dt A +- dt rho E) - C'C: concave
    in X, climbed by a simplex search. n = 2, x_1 alone in phi; coordinates in which dt is 1."""
    size = 2 + q
    upper = np.triu_indices(size)

    def negative(entries):
        x = np.zeros((size, size))
        x[upper] = entries
        x = x + x.T - np.diag(np.diag(x))
        worst = np.inf
        for sign in (-1, 1):
            k = np.eye(size) + np.eye(size, k=1)
            k[-1, q] += sign * rho * dt**2
            xk = x @ k
            xk[0, 0] -= 1
            worst = min(worst, np.linalg.eigvalsh(np.block([[x, xk.T], [xk, x]]))[0])
        return -worst

    best = np.array([1.0, -0.5, 0.8])
    for scale in (0.3, 0.1, 0.03, 0.01, 0.003):
        simplex = np.concatenate([best[None], best + scale * np.eye(3)])
        options = {"initial_simplex": simplex, "xatol": 1e-12, "fatol": 1e-14, "maxiter": 4000}
        best = scipy.optimize.minimize(negative, best, method="Nelder-Mead", options=options).x
    return -negative(best)
