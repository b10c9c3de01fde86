"""The error covariance of a chain observer with gain 1 under measurement noise, by SciPy's Lyapunov solvers."""

import numpy as np
import scipy.linalg


def system(alphas, q):
    """(F, b) of e' = F e + b w: F = A - alphas C; the noise enters with the gain (q = 0) or at the q-th integrator."""
    size = len(alphas)
    f = np.eye(size, k=1)
    f[:, 0] -= alphas
    b = np.asarray(alphas, float) if q == 0 else np.eye(size)[q - 1]
    return f, b


def white(alphas, q):
    """The covariance under white noise of unit intensity."""
    f, b = system(alphas, q)
    return scipy.linalg.solve_continuous_lyapunov(f, -np.outer(b, b))


def held(alphas, q, period):
    """The covariance under unit white samples held for `period`, at the sampling times, exactly, over the period."""
    f, b = system(alphas, q)
    size = len(b)
    block = np.zeros((size + 1, size + 1))
    block[:size, :size], block[:size, size] = f, b
    e = scipy.linalg.expm(block * period)
    g = e[:size, size]
    return scipy.linalg.solve_discrete_lyapunov(e[:size, :size], np.outer(g, g)) / period
