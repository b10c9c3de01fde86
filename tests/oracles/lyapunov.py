"""Paper 003 as written, by scipy: the equations of S, the observers (12) and (25), Gramians, the least squares behind them."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}


def observer_25(a, c, g, theta, s0, u, x0, xhat0, ts):
    """(x, xhat, S) at ts: x' = a(u) x + g(x, u), xhat by (25), S by its own equation, y = c x continuous."""
    n = len(x0)

    def field(t, z):
        x, xhat, s = z[:n], z[n : 2 * n], z[2 * n :].reshape(n, n)
        matrix = a(u(t))
        gain = np.linalg.inv(s) @ c.T
        ds = -theta * s - matrix.T @ s - s @ matrix + c.T @ c
        dxhat = matrix @ xhat + g(xhat, u(t)) - gain @ (c @ xhat - c @ x)
        return np.concatenate([matrix @ x + g(x, u(t)), dxhat, ds.ravel()])

    return _solve(field, x0, xhat0, s0, ts)


def observer_12(a, c, g, theta, gamma, s0, u, x0, xhat0, ts):
    """The same for (12): S' = -theta (gamma S + A'S + SA - C'C), gain Delta S^-1 C'."""
    n = len(x0)
    delta = np.diag(theta ** np.arange(1.0, n + 1))

    def field(t, z):
        x, xhat, s = z[:n], z[n : 2 * n], z[2 * n :].reshape(n, n)
        matrix = a(u(t))
        ds = -theta * (gamma * s + matrix.T @ s + s @ matrix - c.T @ c)
        dxhat = matrix @ xhat + g(xhat, u(t)) - delta @ np.linalg.inv(s) @ c.T @ (c @ xhat - c @ x)
        return np.concatenate([matrix @ x + g(x, u(t)), dxhat, ds.ravel()])

    return _solve(field, x0, xhat0, s0, ts)


def _solve(field, x0, xhat0, s0, ts):
    n = len(x0)
    start = np.concatenate([x0, xhat0, np.asarray(s0).ravel()])
    z = solve_ivp(field, (ts[0], ts[-1]), start, t_eval=ts, **TIGHT).y
    return z[:n].T, z[n : 2 * n].T, z[2 * n :].T.reshape(-1, n, n)


def gramian(a, c, u, begin, end, theta=0.0):
    """int_begin^end e^{-theta (end - s)} phi(s,end)'c'c phi(s,end) ds, by one equation that runs backwards from `end`."""
    n = c.shape[1]

    def field(age, z):
        phi = z[: n * n].reshape(n, n)
        row = c @ phi
        return np.concatenate([(-a(u(end - age)) @ phi).ravel(), np.exp(-theta * age) * (row.T @ row).ravel()])

    start = np.concatenate([np.eye(n).ravel(), np.zeros(n * n)])
    return solve_ivp(field, (0, end - begin), start, **TIGHT).y[n * n :, -1].reshape(n, n)


def fading_least_squares(a, b, c, theta, dt, s0, us, ys, xhat0):
    """xhat_k that minimises e^{-theta k dt} |x_0 - xhat0|^2_{S0} + sum_j e^{-theta (k - j) dt} |y_j - c x_j|^2 dt, by k.

    x_{j+1} = F_j x_j + f_j is exact for x' = a(u_j) x + b(u_j); solved for x_0 by lstsq, then carried to k."""
    n, out = len(xhat0), []
    maps, offsets = [np.eye(n)], [np.zeros(n)]
    for u in us[:-1]:
        block = np.zeros((n + 1, n + 1))
        block[:n, :n], block[:n, n] = a(u) * dt, b(u) * dt
        step = expm(block)
        maps.append(step[:n, :n] @ maps[-1])
        offsets.append(step[:n, :n] @ offsets[-1] + step[:n, n])
    root = np.linalg.cholesky(s0).T
    for k in range(len(ys)):
        rows, right = [np.exp(-theta * k * dt / 2) * root], [np.exp(-theta * k * dt / 2) * root @ xhat0]
        for j in range(k + 1):
            weight = np.exp(-theta * (k - j) * dt / 2) * np.sqrt(dt)
            rows.append(weight * c @ maps[j])
            right.append(weight * (ys[j] - c @ offsets[j]))
        first = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
        out.append(maps[k] @ first + offsets[k])
    return np.asarray(out)
