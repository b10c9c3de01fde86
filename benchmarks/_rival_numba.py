"""numba: the loop over lanes is parallel (prange), the loop over time runs in registers; fastmath; numba's own generator."""

import math

import numpy as np
from _job import ALPHAS, Job


def prepare(job: Job):
    import numba

    real, h = job.dtype, job.dtype(job.study.dt)
    half, sixth, sigma = real(0.5) * h, h / real(6), job.sigma
    noisy, two = sigma > 0, real(2)
    a1, a2 = (real(a) for a in ALPHAS)
    start = np.asarray((*job.study.x0, *job.study.xhat0), real)
    us = (0.5 * np.sin(job.study.dt / 2 * np.arange(2 * job.steps + 1))).astype(real)
    gains, first, steps = job.lane_gains().astype(real), job.first, job.steps

    @numba.njit(fastmath=True, inline="always")
    def field(x1, x2, z1, z2, u, w, g1, g2):
        e = x1 + w - z1
        return x2, math.sin(x1) + u * math.cos(x1), z2 + g1 * e, math.sin(z1) + u * math.cos(z1) + g2 * e

    @numba.njit(parallel=True, fastmath=True)
    def study(gains, us, start, rmse):
        for lane in numba.prange(gains.shape[0]):
            g1, g2 = a1 * gains[lane], a2 * gains[lane] * gains[lane]
            x1, x2, z1, z2 = start[0], start[1], start[2], start[3]
            s1, s2, w = real(0), real(0), real(0)
            for k in range(steps):
                if noisy:
                    w = real(sigma * np.random.standard_normal())  # noqa: NPY002 (compiled by numba)
                if k >= first:
                    s1 += (z1 - x1) * (z1 - x1)
                    s2 += (z2 - x2) * (z2 - x2)
                u0, u1, u2 = us[2 * k], us[2 * k + 1], us[2 * k + 2]
                a, b, c, d = field(x1, x2, z1, z2, u0, w, g1, g2)
                e, f, g, i = field(x1 + half * a, x2 + half * b, z1 + half * c, z2 + half * d, u1, w, g1, g2)
                j, l, m, n = field(x1 + half * e, x2 + half * f, z1 + half * g, z2 + half * i, u1, w, g1, g2)
                o, p, q, r = field(x1 + h * j, x2 + h * l, z1 + h * m, z2 + h * n, u2, w, g1, g2)
                x1 += sixth * (a + two * (e + j) + o)
                x2 += sixth * (b + two * (f + l) + p)
                z1 += sixth * (c + two * (g + m) + q)
                z2 += sixth * (d + two * (i + n) + r)
            rmse[0, lane] = math.sqrt(s1 / (steps - first))
            rmse[1, lane] = math.sqrt(s2 / (steps - first))

    def run():
        rmse = np.empty((2, len(gains)), real)
        study(gains, us, start, rmse)
        return rmse, None

    return run
