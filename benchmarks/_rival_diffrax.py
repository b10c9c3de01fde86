"""diffrax under vmap: classical RK4 as its Butcher tableau, step by step in a scan, as the held noise asks."""

import math
from collections.abc import Callable
from typing import ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from _job import ALPHAS, Job


class RK4(diffrax.AbstractERK):
    """The classical method of order 4; it has no error estimate, so only constant steps are of use."""

    tableau: ClassVar[diffrax.ButcherTableau] = diffrax.ButcherTableau(
        a_lower=(np.array([1 / 2]), np.array([0.0, 1 / 2]), np.array([0.0, 0.0, 1.0])),
        b_sol=np.array([1 / 6, 1 / 3, 1 / 3, 1 / 6]),
        b_error=np.zeros(4),
        c=np.array([1 / 2, 1 / 2, 1.0]),
    )
    interpolation_cls: ClassVar[Callable[..., diffrax.ThirdOrderHermitePolynomialInterpolation]] = (
        diffrax.ThirdOrderHermitePolynomialInterpolation.from_k
    )

    def order(self, terms):
        return 4


def pendulum_field(t, q, args):
    """Plant and observer together; args = (w, gamma)."""
    (x1, x2, z1, z2), (w, gamma) = q, args
    u, e = 0.5 * jnp.sin(t), x1 + w - z1
    c1, c2 = ALPHAS[0] * gamma, ALPHAS[1] * gamma**2
    return x2, jnp.sin(x1) + u * jnp.cos(x1), z2 + c1 * e, jnp.sin(z1) + u * jnp.cos(z1) + c2 * e


def chain_field(t, q, args):
    """The same for the chain of five."""
    w, gamma = args
    x, z = q[:5], q[5:]
    e = x[0] + w - z[0]
    observer = [shifted + math.comb(5, i) * gamma**i * e for i, shifted in enumerate((*z[1:], sum(map(jnp.sin, z)) / 5), 1)]
    return (*x[1:], sum(map(jnp.sin, x)) / 5, *observer)


FIELDS = {"pendulum": pendulum_field, "chain": chain_field}


def prepare(job: Job):
    real, dt, solver, term = job.dtype, job.dtype(job.study.dt), RK4(), diffrax.ODETerm(FIELDS[job.workload])
    n, h = len(job.study.x0), dt / job.dtype(job.study.substeps)
    ts = jnp.asarray(job.times(), real)
    gains = jnp.asarray(job.lane_gains(), real)
    keys = jax.random.split(jax.random.key(job.seed), job.lanes)

    def lane(gamma, key):
        start = tuple(jnp.asarray(v, real) for v in (*job.study.x0, *job.study.xhat0))
        w = job.sigma * jax.random.normal(key, ts.shape, real) if job.sigma else jnp.zeros_like(ts)

        def step(carry, sample):
            q, state, total = carry
            t, w, counts = sample
            errors = jnp.stack(q[n:]) - jnp.stack(q[:n])
            total = total + jnp.where(counts, errors**2, 0)

            def substep(i, carry):
                q, state = carry
                q, _, _, state, _ = solver.step(term, t + i * h, t + (i + 1) * h, q, (w, gamma), state, made_jump=False)
                return q, state

            q, state = (
                substep(0, (q, state))
                if job.study.substeps == 1
                else jax.lax.fori_loop(0, job.study.substeps, substep, (q, state))
            )
            return (q, state, total), None

        state = solver.init(term, ts[0], ts[0] + dt, start, (w[0], gamma))
        carry = (start, state, jnp.zeros(n, real))
        (_, _, total), _ = jax.lax.scan(step, carry, (ts, w, jnp.arange(job.steps) >= job.first))
        return jnp.sqrt(total / (job.steps - job.first))

    study = jax.jit(jax.vmap(lane, out_axes=1))
    return lambda: (np.asarray(study(gains, keys)), None)
