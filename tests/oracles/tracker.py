"""The trackers of paper 001 as written (with its errors corrected): H by its own equation, the filter by a plain loop."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm


def structure(n, q):
    """(A~, B, C~) of eta = (xi, xhat): xi_q' = y - xhat_1, the other rows shift."""
    size = n + q
    a = np.eye(size, k=1)
    if q:
        a[q - 1, q] = -1.0
    b = np.zeros(size)
    if q:
        b[q - 1] = 1.0
    return a, b, np.eye(1, size)


def continuous_h(n, q, mu, start, t):
    """H(t) from H' = -mu H - A~'H - H A~ + C~'C~, H(0) = start I."""
    a, _, c = structure(n, q)
    shape = a.shape

    def rate(_, h):
        h = h.reshape(shape)
        return (-mu * h - a.T @ h - h @ a + c.T @ c).ravel()

    done = solve_ivp(rate, (0, t), (start * np.eye(n + q)).ravel(), method="DOP853", rtol=1e-13, atol=1e-16)
    return done.y[:, -1].reshape(shape)


def discrete_h(n, q, mu, dt, start, count):
    """H_0, ..., H_{count-1} from H_{k+1} = sigma e^{-A~'dt} H_k e^{-A~ dt} + dt C~'C~, H_0 = start I + dt C~'C~."""
    a, _, c = structure(n, q)
    back, sigma = expm(-a * dt), np.exp(-mu * dt)
    h = [start * np.eye(n + q) + dt * c.T @ c]
    while len(h) < count:
        h.append(sigma * back.T @ h[-1] @ back + dt * c.T @ c)
    return h


def held_first_order(n, q, dt):
    """(F, B0, B1) of eta- = F eta + B0 y_{k-1} + B1 y_k: y a straight line between samples, by an augmented exponential."""
    a, b, _ = structure(n, q)
    size = n + q
    block = np.zeros((size + 2, size + 2))
    block[:size, :size], block[:size, size], block[size, size + 1] = a, b, 1 / dt
    e = expm(block * dt)
    return e[:size, :size], e[:size, size] - e[:size, size + 1], e[:size, size + 1]


def run(n, q, dt, gains, ys, xhat0):
    """xhat_k of the discrete tracker, sample by sample; gains[k] = dt H_k^-1 C~'."""
    f, b0, b1 = held_first_order(n, q, dt)
    eta, out = np.concatenate([np.zeros(q), xhat0]), []
    for k, y in enumerate(ys):
        ahead = eta if k == 0 else f @ eta + b0 * ys[k - 1] + b1 * y
        eta = ahead + gains[k] * ((y if q == 0 else 0.0) - ahead[0])
        out.append(eta[q:])
    return np.asarray(out)


def rk4(field, z, inputs, dt):
    """All states of z' = field(z, y) with y held over each step."""
    out = [z]
    for y in inputs[:-1]:
        k1 = field(z, y)
        k2 = field(z + dt / 2 * k1, y)
        k3 = field(z + dt / 2 * k2, y)
        k4 = field(z + dt * k3, y)
        z = z + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        out.append(z)
    return np.asarray(out)
