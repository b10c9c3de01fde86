"""Gains of the fading-memory Lyapunov equation on an integrator chain, in closed form (paper 001, (4), (7), (33)-(34)).

All in scaled coordinates, where time is counted in 1/mu (1/(1 - sigma) samples in discrete time) and the steady H is the signed
Pascal matrix H_ij = (-1)^{i+j} C(i+j-2, i-1), or tends to it as sigma -> 1.
"""

import math
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Scalar
from jaxobs.linalg import pascal


def start_up_gain(
    steady: Float[Array, "N N"], start: Float[Array, "N N"], tau: Scalar, log_decay: Scalar
) -> Float[Array, " N"]:
    """H^-1 e_1 for H = steady + decay E' (start - steady) E, E = exp(-A tau), decay = exp(-log_decay): paper 001, (7).

    The root of the decay is taken into E, entry by entry in logarithms, so that nothing overflows however large tau.
    """
    size = steady.shape[0]
    lag = np.maximum(np.arange(size)[None, :] - np.arange(size)[:, None], 0)
    log_factorial = np.asarray([math.lgamma(r + 1) for r in range(size)])[lag]
    sign = np.triu((-1.0) ** lag)
    log_tau = jnp.log(jnp.maximum(tau, jnp.finfo(tau.dtype).tiny))
    exponent = jnp.asarray(lag, tau.dtype) * log_tau - jnp.asarray(log_factorial, tau.dtype) - log_decay / 2
    e = jnp.asarray(sign, tau.dtype) * jnp.exp(exponent)
    h = steady + e.T @ (start - steady) @ e
    d = jnp.sqrt(jnp.diagonal(h))
    factor = jnp.linalg.cholesky(h / (d[:, None] * d[None, :]))
    unit = jnp.zeros_like(d).at[0].set(1 / d[0])
    return jax.scipy.linalg.cho_solve((factor, True), unit) / d


def pascal_matrix(size: int, dtype) -> Float[Array, "N N"]:
    """((-1)^{i+j} C(i+j-2, i-1)), the steady H of the continuous tracker at mu = 1 (paper 001, (8))."""
    factor = pascal(size)
    return jnp.asarray(factor @ factor.T, dtype)


def sampled_matrix(size: int, sigma: Scalar) -> Float[Array, "N N"]:
    """g_ij = (1 - sigma)^{i+j-1} sum_k sigma^k (-k)^{i+j-2} / ((i-1)! (j-1)!), paper 001, (31)-(32) corrected.

    sum_k k^m sigma^k = sigma A_m(sigma) / (1 - sigma)^{m+1} with the Eulerian polynomials A_m: positive terms only.
    """
    moments = [jnp.ones_like(sigma)]
    for m in range(1, 2 * size - 1):
        coefficients = jnp.asarray(_eulerian(m)[::-1].copy(), sigma.dtype)
        moments.append(sigma * jnp.polyval(coefficients, sigma))
    i, j = np.mgrid[0:size, 0:size]
    factorial = np.asarray([math.factorial(r) for r in range(size)], float)
    weight = (-1.0) ** (i + j) / (factorial[i] * factorial[j])
    return jnp.asarray(weight, sigma.dtype) * jnp.stack(moments)[i + j]


def fading_memory_gain(size: int, decrement: Scalar, dt: Scalar) -> Float[Array, " N"]:
    """The steady gain delta H^-1 C' of the fading-memory polynomial filter, all poles at sigma = 1 - decrement:

        G_{i+1} = (i! / dt^i) sum_{j > i} C(N, j) (1 - sigma)^j s1(j, i+1) / (j - 1)!,    s1 the signed Stirling numbers.

    For N = 3 it is (34) of paper 001.
    """
    weight = np.zeros((size, size))
    stirling = _stirling(size)
    for i in range(size):
        for j in range(i + 1, size + 1):
            weight[i, j - 1] = math.factorial(i) * math.comb(size, j) * stirling[j][i + 1] / math.factorial(j - 1)
    powers = decrement ** jnp.arange(1, size + 1, dtype=decrement.dtype)
    return jnp.asarray(weight, decrement.dtype) @ powers / dt ** jnp.arange(size, dtype=dt.dtype)


@lru_cache
def _eulerian(m: int) -> np.ndarray:
    """The coefficients of A_m, constant term first."""
    row = np.ones(1)
    for k in range(2, m + 1):
        padded = np.concatenate([[0.0], row, [0.0]])
        r = np.arange(k)
        row = (r + 1) * padded[1 : k + 1] + (k - r) * padded[:k]
    return row


@lru_cache
def _stirling(size: int) -> list[list[int]]:
    """Signed Stirling numbers of the first kind s1(j, i), 0 <= i <= j <= size."""
    table = [[1] + [0] * size]
    for j in range(1, size + 1):
        table.append([0] + [table[-1][i - 1] - (j - 1) * table[-1][i] for i in range(1, size + 1)])
    return table
