"""Floors and filters by other means: whole information matrices, iterated covariances, quadrature in frequency."""

import numpy as np
import scipy.integrate
import scipy.linalg

from oracles.kalman import held, joseph


def iterated(a, c, q, r, dt, count, start):
    """P(k|k) of the sampled Kalman filter after so many samples, white process noise of intensity q."""
    f, w = held(a, root(q), dt)
    p = start
    for _ in range(count):
        p = joseph(np.zeros(len(a)), f @ p @ f.T + w, np.zeros(len(c)), np.zeros(len(c)), c, r)[1]
    return p


def root(q):
    """G with G G' = q >= 0."""
    values, vectors = np.linalg.eigh(q)
    return vectors * np.sqrt(np.maximum(values, 0))


def information(fs, hs, q, r, p0):
    """The inverse of the information of the whole path x_0, ..., x_K for Jacobians fs (N, K, n, n), hs (N, K + 1, p, n):

    expectations of the Hessian blocks over the N paths, and the last block of the inverse of the whole matrix.
    """
    n, steps = p0.shape[0], fs.shape[1]
    qi, ri = np.linalg.inv(q), np.linalg.inv(r)
    whole = np.zeros(((steps + 1) * n, (steps + 1) * n))
    whole[:n, :n] += np.linalg.inv(p0)
    for k in range(steps + 1):
        here = slice(k * n, (k + 1) * n)
        whole[here, here] += np.mean(np.swapaxes(hs[:, k], 1, 2) @ ri @ hs[:, k], axis=0)
        if k == steps:
            continue
        ahead = slice((k + 1) * n, (k + 2) * n)
        whole[here, here] += np.mean(np.swapaxes(fs[:, k], 1, 2) @ qi @ fs[:, k], axis=0)
        whole[here, ahead] -= np.mean(fs[:, k], axis=0).T @ qi
        whole[ahead, here] -= qi @ np.mean(fs[:, k], axis=0)
        whole[ahead, ahead] += qi
    return np.linalg.inv(whole)[-n:, -n:]


def held_noise(a, c, e, gain, dt, sigma, level):
    """The error covariance at the samples of xhat' = A xhat + L (C x + v_k - C xhat), v_k and the disturbance held over dt."""
    f, n = a - gain @ c, len(a)
    block = scipy.linalg.expm(np.block([[f, np.eye(n)], [np.zeros((n, 2 * n))]]) * dt)
    g = block[:n, n:] @ np.hstack([gain * sigma, e * level])
    return scipy.linalg.solve_discrete_lyapunov(block[:n, :n], g @ g.T)


def noise_bandwidth(response, last=np.inf):
    """int_0^last |T(w) / T(0)|^2 dw."""
    ratio = abs(response(1e-9)) ** 2
    return scipy.integrate.quad(lambda w: abs(response(w)) ** 2 / ratio, 0, last, limit=400)[0]
