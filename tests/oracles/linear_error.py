"""Linear error dynamics by SciPy and NumPy: covariances, impulse responses, frequency responses, a simulated path."""

import itertools

import numpy as np
import scipy.integrate
import scipy.linalg
import scipy.optimize


def white(f, b):
    """X with f X + X f' + b b' = 0."""
    return scipy.linalg.solve_continuous_lyapunov(f, -b @ b.T)


def steps(f, b):
    """X with X = f X f' + b b'."""
    return scipy.linalg.solve_discrete_lyapunov(f, b @ b.T)


def held_matrix(f, b, dt):
    """(e^{f dt}, int_0^dt e^{fs} ds b) from one exponential."""
    n, k = b.shape
    block = np.zeros((n + k, n + k))
    block[:n, :n], block[:n, n:] = f * dt, b * dt
    e = scipy.linalg.expm(block)
    return e[:n, :n], e[:n, n:]


def van_loan(f, w, dt):
    """int_0^dt e^{fs} w w' e^{f's} ds (Van Loan, IEEE Trans. Automatic Control 23 (1978))."""
    n = len(f)
    block = np.block([[-f, w @ w.T], [np.zeros((n, n)), f.T]]) * dt
    e = scipy.linalg.expm(block)
    return e[n:, n:].T @ e[:n, n:]


def sampled(f, b, w, dt):
    """The covariance at the sampling instants: unit samples held for dt through b, white noise through w."""
    phi, gamma = held_matrix(f, b, dt)
    return scipy.linalg.solve_discrete_lyapunov(phi, gamma @ gamma.T + van_loan(f, w, dt))


def simulated(phi, gamma, count, seed):
    """The sample covariance of x+ = phi x + gamma w, w unit normals."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(count, gamma.shape[1])) @ gamma.T
    x, total = np.zeros(len(phi)), np.zeros_like(phi)
    for k, one in enumerate(w):
        x = phi @ x + one
        if k >= count // 20:
            total += np.outer(x, x)
    return total / (count - count // 20)


def dense(f, b, h, end, count):
    """(ts, h e^{ft} b) on a uniform grid, by one exponential and products."""
    ts = np.linspace(0, end, count)
    step = scipy.linalg.expm(f * ts[1])
    x, path = np.asarray(b, float), []
    for _ in ts:
        path.append(h @ x)
        x = step @ x
    return ts, np.asarray(path)


def absolute_integral(f, b, h, end):
    """int |h e^{ft} b| dt between the roots of the integrand, each part by adaptive quadrature."""
    ts, path = dense(f, b, h, end, 20_001)

    def value(t):
        return float(h @ scipy.linalg.expm(f * t) @ b)

    crossings = np.flatnonzero(path[:-1] * path[1:] < 0)
    roots = [scipy.optimize.brentq(value, ts[k], ts[k + 1], xtol=1e-13) for k in crossings]
    edges = [0.0, *roots, end]
    integral = [scipy.integrate.quad(value, a, b, limit=200, epsabs=1e-13)[0] for a, b in itertools.pairwise(edges)]
    return float(np.sum(np.abs(integral)))


def edge(f, g, h):
    """The frequency [Hz] at which |h (j w - f)^-1 g|^2 is half of what it is at 0."""

    def level(w):
        return abs(h @ np.linalg.solve(1j * w * np.eye(len(f)) - f, g)) ** 2 / abs(h @ np.linalg.solve(-f, g)) ** 2 - 0.5

    grid = np.geomspace(1e-3, 1e4, 4_000)
    k = np.flatnonzero([level(w) > 0 for w in grid])[-1]
    return scipy.optimize.brentq(level, grid[k], grid[k + 1], xtol=1e-13) / (2 * np.pi)


def noise_bandwidth(f, g, h):
    """int |T(jw)|^2 dw / (2 pi |T(0)|^2) by quadrature over all frequencies."""

    def power(w):
        return abs(h @ np.linalg.solve(1j * w * np.eye(len(f)) - f, g)) ** 2

    return scipy.integrate.quad(power, 0, np.inf, limit=400, epsabs=1e-12)[0] / (2 * np.pi * power(0.0))
