"""Settling times, squared errors and least noise of linear observers: dense exponentials, quadrature, a Riccati solver."""

import numpy as np
import scipy.integrate
import scipy.linalg


def response(alphas, q, ts):
    """e_x2 at evenly spaced times, from e_x2(0) = 1, of e' = (A - alphas C) e."""
    size = len(alphas)
    flow = np.eye(size, k=1)
    flow[:, 0] -= alphas
    step = scipy.linalg.expm(flow * (ts[1] - ts[0]))
    e, path = np.eye(size)[q + 1], []
    for _ in ts:
        path.append(e[q + 1])
        e = step @ e
    return np.asarray(path)


def settling(alphas, q, band=0.05, end=40.0, count=40_001):
    """The last sample at which |e_x2| exceeds the band."""
    ts = np.linspace(0, end, count)
    path = np.abs(response(alphas, q, ts))
    return ts[np.flatnonzero(path > band * path.max())[-1]]


def squared(alphas, q, end=80.0, count=40_001):
    ts = np.linspace(0, end, count)
    return scipy.integrate.simpson(response(alphas, q, ts) ** 2, x=ts)


def least_cost(weight):
    """min over all linear observers of (noise variance of x_2) + weight * (squared error of x_2): a Kalman filter's P_22."""
    a, c = np.eye(2, k=1), np.eye(1, 2)
    return scipy.linalg.solve_continuous_are(a.T, c.T, np.diag([0.0, weight]), np.eye(1))[1, 1]
