"""NumPy, vectorised over lanes: a Python loop over time on arrays of lanes, in blocks of lanes that stay in cache."""

import numpy as np
from _job import ALPHAS, Job

BLOCK = 4096


def prepare(job: Job):
    gains = job.lane_gains().astype(job.dtype)
    return lambda: (np.concatenate([_block(job, gains[i : i + BLOCK], i) for i in range(0, job.lanes, BLOCK)], axis=1), None)


def _block(job: Job, gamma: np.ndarray, number: int) -> np.ndarray:
    real, h, rng = job.dtype, job.dtype(job.study.dt), np.random.default_rng((job.seed, number))
    half, third, sixth = real(0.5) * h, h / real(3), h / real(6)
    us = (0.5 * np.sin(job.study.dt / 2 * np.arange(2 * job.steps + 1))).astype(real)
    q = np.repeat(np.asarray((*job.study.x0, *job.study.xhat0), real)[:, None], len(gamma), axis=1)
    g1, g2, sigma = real(ALPHAS[0]) * gamma, real(ALPHAS[1]) * gamma**2, real(job.sigma)
    total, k = np.zeros((2, len(gamma)), real), np.empty((4, *q.shape), real)
    w = np.zeros(len(gamma), real)

    def field(q, u, out):
        e = q[0] + w - q[2]
        out[0] = q[1]
        out[1] = np.sin(q[0]) + u * np.cos(q[0])
        out[2] = q[3] + g1 * e
        out[3] = np.sin(q[2]) + u * np.cos(q[2]) + g2 * e

    for step in range(job.steps):
        if job.sigma:
            w = sigma * rng.standard_normal(len(gamma), real)
        if step >= job.first:
            total += (q[2:] - q[:2]) ** 2
        u0, u1, u2 = us[2 * step : 2 * step + 3]
        field(q, u0, k[0])
        field(q + half * k[0], u1, k[1])
        field(q + half * k[1], u1, k[2])
        field(q + h * k[2], u2, k[3])
        q += sixth * (k[0] + k[3]) + third * (k[1] + k[2])
    return np.sqrt(total / (job.steps - job.first))
