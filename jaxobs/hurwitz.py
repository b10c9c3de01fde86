"""Monic Hurwitz polynomials in three charts: coefficients alphas, weights log q, poles.

    alpha(s) = s^n + alpha_1 s^{n-1} + ... + alpha_n,      alpha(s) alpha(-s) = (-1)^n [s^{2n} + sum_i (-1)^i q_i s^{2n-2i}]

so that, with alpha_0 = 1 and alpha_k = 0 outside 0..n (paper 000, the corrected (8); (10) asks for q_i > 0):

    q_i = alpha_i^2 + 2 sum_{j=1}^{min(i, n-i)} (-1)^j alpha_{i-j} alpha_{i+j},      i = 1..n.

Every q > 0 belongs to exactly one Hurwitz alpha, hence log q in R^n is a smooth chart, without constraints, of all alphas that
satisfy (10). Everything here is jittable, differentiable and safe in float32 (time is scaled so that alpha_n = 1).
"""

import math
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jaxobs._module import Numbers, Scalar, as_param, concrete, refuse

NEWTON_STEPS = 60  # more than n = 10 needs for q anywhere in 1e-3 .. 1e3


def binomial(n: int) -> Float[Array, " n"]:
    """The coefficients C(n, 1), ..., C(n, n) of (s + 1)^n."""
    return jnp.asarray([math.comb(n, k) for k in range(1, n + 1)], dtype=jnp.result_type(float))


@lru_cache
def _products(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices (left, right) into (alpha_0, ..., alpha_n, 0) and weights (n, terms) of the sum that makes q_i."""
    left, right = np.full((2, n, n // 2 + 1), n + 1)
    weight = np.zeros((n, n // 2 + 1))
    for i in range(1, n + 1):
        for j in range(min(i, n - i) + 1):
            left[i - 1, j], right[i - 1, j], weight[i - 1, j] = i - j, i + j, (1 if j == 0 else 2) * (-1) ** j
    return left, right, weight


def _padded(alphas: Float[Array, " n"]) -> Float[Array, " n+2"]:
    """(alpha_0 = 1, alpha_1, ..., alpha_n, 0)."""
    return jnp.concatenate([jnp.ones_like(alphas[:1]), alphas, jnp.zeros_like(alphas[:1])])


def q_from_alphas(alphas: Numbers) -> Float[Array, " n"]:
    """The weights q_i of the corrected (8); condition (10) holds when all are positive. Binomial alphas give q_i = C(n, i)."""
    a = _padded(as_param(alphas))
    left, right, weight = _products(a.shape[0] - 2)
    return jnp.sum(jnp.asarray(weight, a.dtype) * a[left] * a[right], axis=1)


def _q_jacobian(alphas: Float[Array, " n"]) -> Float[Array, "n n"]:
    """d q_i / d alpha_k = 2 (-1)^{k-i} alpha_{2i-k}."""
    n = alphas.shape[0]
    i, k = np.mgrid[1 : n + 1, 1 : n + 1]
    index = np.where((2 * i - k >= 0) & (2 * i - k <= n), 2 * i - k, n + 1)
    return jnp.asarray(2.0 * (-1.0) ** (k - i), alphas.dtype) * _padded(alphas)[index]


def _powers(base: Float[Array, ""], n: int) -> Float[Array, " n"]:
    """(base, base^2, ..., base^n)."""
    return base ** jnp.arange(1, n + 1, dtype=base.dtype)


@jax.custom_jvp
def _spectral_factor(q: Float[Array, " n"]) -> Float[Array, " n"]:
    """Newton's (Wilson's) iteration for the Hurwitz alpha with weights q, q_n = 1; NaN if it has not converged.

    It starts from (s + c)^n with c so large that no weight lies below its target, from where it descends monotonically.
    """
    n = q.shape[0]
    eps = jnp.finfo(q.dtype).eps
    order = jnp.arange(1, n + 1, dtype=q.dtype)
    choose = jnp.asarray([math.comb(n, i) for i in range(1, n + 1)], q.dtype)
    start = choose * _powers(jnp.max((q / choose) ** (1 / (2 * order))), n)

    def unfinished(state):
        step, _, change = state
        return (step < NEWTON_STEPS) & (change > 4 * eps)

    def newton(state):
        step, alphas, _ = state
        delta = jnp.linalg.solve(_q_jacobian(alphas), q - q_from_alphas(alphas))
        return step + 1, alphas + delta, jnp.max(jnp.abs(delta / alphas))

    _, alphas, _ = jax.lax.while_loop(unfinished, newton, (0, start, jnp.asarray(jnp.inf, q.dtype)))
    left, right, weight = _products(n)
    terms = jnp.asarray(weight, q.dtype) * _padded(alphas)[left] * _padded(alphas)[right]
    # Rounding spoils q_i by eps times its largest term, whatever q_i itself: that is the scale of an honest residual.
    miss = jnp.max(jnp.abs(jnp.sum(terms, axis=1) - q) / jnp.sum(jnp.abs(terms), axis=1))
    return jnp.where(miss < 64 * eps, alphas, jnp.nan)


@_spectral_factor.defjvp
def _(primals, tangents):
    # Implicit: q(alpha) = q, hence d alpha = J(alpha)^-1 dq; no derivative passes through the iteration.
    alphas = _spectral_factor(*primals)
    return alphas, jnp.linalg.solve(_q_jacobian(alphas), tangents[0])


def alphas_from_log_q(log_q: Numbers) -> Float[Array, " n"]:
    """The one Hurwitz polynomial with weights q = exp(log_q): the inverse of `q_from_alphas` on q > 0."""
    log_q = as_param(log_q)
    n = log_q.shape[0]
    log_scale = log_q[-1] / (2 * n)
    order = jnp.arange(1, n + 1, dtype=log_q.dtype)
    return jnp.exp(order * log_scale) * _spectral_factor(jnp.exp(log_q - 2 * order * log_scale))


def alphas_from_q(q: Numbers) -> Float[Array, " n"]:
    """The one Hurwitz polynomial with these weights. ValueError names the q_i that is not positive (condition (10))."""
    q = as_param(q)
    known = concrete(q)
    if known is not None and not np.all(known > 0):
        i = int(np.argmin(known > 0)) + 1
        raise refuse(
            "alphas_from_q", f"q_{i}", known[i - 1], "a positive number", "Condition (10) asks for it; work with log q."
        )
    return alphas_from_log_q(jnp.log(q))


def alphas_from_poles(poles: Numbers) -> Float[Array, " n"]:
    """The coefficients of prod_i (s - pole_i), for poles closed under conjugation."""
    given = jnp.asarray(poles)
    return jnp.real(jnp.poly(given if jnp.iscomplexobj(given) else as_param(given)))[1:]


def poles(alphas: Numbers) -> Complex[Array, " n"]:
    """The roots of s^n + alpha_1 s^{n-1} + ... + alpha_n (eigenvalues of the companion matrix, in scaled time)."""
    alphas = as_param(alphas)
    normal, scale = normalise(alphas)
    n = alphas.shape[0]
    companion = jnp.eye(n, k=1, dtype=alphas.dtype).at[:, 0].add(-normal)
    roots = jnp.linalg.eigvals(companion)
    return scale.astype(roots.dtype) * roots


def normalise(alphas: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """(alphas', g) with alphas_i = g^i alphas'_i and |alphas'_n| = 1: time in units of 1/g. g = 1 if alpha_n = 0."""
    n = alphas.shape[0]
    last = jnp.abs(alphas[-1])
    scale = jnp.where(last > 0, jnp.exp(jnp.log(jnp.where(last > 0, last, 1)) / n), 1).astype(alphas.dtype)
    return alphas * _powers(1 / scale, n), scale


def is_hurwitz(alphas: Numbers) -> bool:
    """Whether all roots of the concrete polynomial lie in the open left half plane (a float64 test, not a proof)."""
    return bool(np.all(np.roots(np.concatenate([[1.0], np.asarray(alphas, np.float64)])).real < 0))


def moved(alphas: Float[Array, " n"], by: Scalar) -> Float[Array, " n"]:
    """The coefficients of alpha(s + by), whose poles lie further left by that much: repeated synthetic division by s - by."""
    size = alphas.shape[0]
    coefficients = [jnp.ones_like(alphas[0]), *alphas]
    for last in range(size, 0, -1):
        for k in range(1, last + 1):
            coefficients[k] = coefficients[k] + by * coefficients[k - 1]
    return jnp.stack(coefficients[1:])
