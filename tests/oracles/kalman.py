"""Kalman filters as written in the textbooks: full covariances, plain NumPy, exact discretisation or solve_ivp."""

import numpy as np
import scipy.linalg
from scipy.integrate import solve_ivp


def held(f, g, dt):
    """(e^{F dt}, int_0^dt e^{F s} G G' e^{F's} ds) by Van Loan's exponential."""
    n = len(f)
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -f, g @ g.T, f.T
    e = scipy.linalg.expm(block * dt)
    a = e[n:, n:].T
    return a, a @ e[:n, n:]


def joseph(xhat, p, y, h, c, r):
    """The measurement update, in the form that is symmetric by itself."""
    k = p @ c.T @ np.linalg.inv(c @ p @ c.T + r)
    keep = np.eye(len(p)) - k @ c
    return xhat + k @ (y - h), keep @ p @ keep.T + k @ r @ k.T


def linear(a, w, c, r, p, xhat, ys):
    """Estimates and covariances, each with its y in hand; a row of NaN is a lost sample, and known to be lost."""
    estimates, covariances = [], []
    for y in ys:
        if not np.any(np.isnan(y)):
            xhat, p = joseph(xhat, p, y, c @ xhat, c, r)
        estimates.append(xhat)
        covariances.append(p)
        xhat, p = a @ xhat, a @ p @ a.T + w
    return np.array(estimates), np.array(covariances)


def slope(function, x):
    """Central differences."""
    steps = 1e-6 * np.eye(len(x))
    return np.stack([(function(x + s) - function(x - s)) / 2e-6 for s in steps], axis=1)


def extended(flow, h, g, r, p, xhat, ys, dt):
    """The continuous-discrete extended filter: P' = F P + P F' + G G' by an adaptive solver, Jacobians by differences."""
    n = len(xhat)

    def both(t, z):
        x, p = z[:n], z[n:].reshape(n, n)
        f = slope(flow, x)
        return np.concatenate([flow(x), (f @ p + p @ f.T + g @ g.T).reshape(-1)])

    estimates, covariances = [], []
    for y in ys:
        xhat, p = joseph(xhat, p, y, h(xhat), slope(h, xhat), r)
        estimates.append(xhat)
        covariances.append(p)
        end = solve_ivp(both, (0, dt), np.concatenate([xhat, p.reshape(-1)]), rtol=1e-10, atol=1e-12).y[:, -1]
        xhat, p = end[:n], end[n:].reshape(n, n)
    return np.array(estimates), np.array(covariances)


def bucy(flow, h, g, r, p, xhat, x, ts):
    """Truth, estimate and P of the continuous extended filter without noise, on the grid ts, by an adaptive solver."""
    n = len(xhat)

    def all_of_it(t, z):
        x, xhat, p = z[:n], z[n : 2 * n], z[2 * n :].reshape(n, n)
        f, c = slope(flow, xhat), slope(h, xhat)
        k = p @ c.T @ np.linalg.inv(r)
        dp = f @ p + p @ f.T + g @ g.T - k @ r @ k.T
        return np.concatenate([flow(x), flow(xhat) + k @ (h(x) - h(xhat)), dp.reshape(-1)])

    start = np.concatenate([x, xhat, np.reshape(p, -1)])
    z = solve_ivp(all_of_it, (ts[0], ts[-1]), start, t_eval=ts, rtol=1e-10, atol=1e-12, method="DOP853").y.T
    return z[:, n : 2 * n], z[:, 2 * n :].reshape(-1, n, n)
