"""What q integrators are worth against white noise: the quietest alphas at equal speed, for three measures of speed.

The estimate x_i of a chain observer with gains alphas_k gamma^k has Var e_i = sigma^2 T_s gamma^{2i-1} c(alphas, q). Any c can
be had by a slower observer, so the comparison needs a measure of speed, and its answer depends on that measure.
"""

import math
from functools import lru_cache
from typing import Literal, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jaxtyping import Float

from jaxobs import hurwitz, linalg
from jaxobs._module import Numbers, Scalar, as_param, refuse, require_integer, require_positive

Measure = Literal["settling time", "squared error", "spectral abscissa"]
MEASURES: tuple[Measure, ...] = get_args(Measure)
DOUBLINGS, HORIZON = 10, 16.0  # 2^10 samples of the response, over so many time constants of the slowest pole
BAND = 0.05  # of its peak: what remains of a settled error
EDGE = 1e-4  # the search leaves the band this early: its optima touch the edge, where the settling time jumps
SEEDS = (0, 1)  # of the global search
LOWEST = 14.0  # how far log q may fall below the binomial one, times min(i, N - i)


_covariance = jax.jit(linalg.noise_covariance, static_argnums=1)


class Quietest(NamedTuple):
    """alphas (n + q,) with the reference's speed; c = Var e_i / (sigma^2 T_s gamma^{2i-1}); ratio = sqrt(c / c_reference)."""

    alphas: Float[np.ndarray, " N"]
    c: float
    ratio: float


def noise_constant(alphas: Numbers, q: int = 0, *, state: int = 2) -> Scalar:
    """c of Var e_i = sigma^2 T_s gamma^{2i-1} c for x_i, i = `state` (paper 000, (41); gamma T_s << 1, phi left out)."""
    place = q + state - 1
    return _covariance(as_param(alphas), q)[place, place]


def settling_time(alphas: Numbers, q: int = 0, *, state: int = 2, start: int = 2, band: float = BAND) -> Scalar:
    """The last time at which |e_i(t)| exceeds band * max |e_i|, from e(0) = the unit error of x_start; e' = (A - alphas C) e.

    The response is sampled by doubling, over 16 time constants of the slowest pole, and the crossing interpolated; infinite
    if it lies beyond.
    """
    a = as_param(alphas)
    size = a.shape[0]
    dt = HORIZON / 2**DOUBLINGS / speed("spectral abscissa", a)
    flow = jnp.eye(size, k=1, dtype=a.dtype).at[:, 0].add(-a)
    path = jnp.zeros((size, 1), a.dtype).at[q + start - 1, 0].set(1)
    step = linalg.expm(flow * dt)
    for _ in range(DOUBLINGS):
        path = jnp.concatenate([path, step @ path], axis=1)
        step = step @ step
    e = jnp.abs(path[q + state - 1])
    level = band * jnp.max(e)
    outside = e > level
    last = e.shape[0] - 1 - jnp.argmax(outside[::-1])
    after = jnp.minimum(last + 1, e.shape[0] - 1)
    crossing = last.astype(e.dtype) + (e[last] - level) / jnp.maximum(e[last] - e[after], jnp.finfo(e.dtype).tiny)
    return jnp.where(outside[-1], jnp.inf, dt * crossing)


def squared_error(alphas: Numbers, q: int = 0, *, state: int = 2, start: int = 2) -> Scalar:
    """Integral of e_i(t)^2 from e(0) = the unit error of x_start; e' = (A - alphas C) e.

    For n = 2 and i = start = 2 every linear observer, with any q, has c * (this)^3 >= 27/64: a Kalman filter for white noise on
    y and on x_2' has the least c + lambda * (this) = sqrt(2) lambda^{3/4}, for every lambda.
    """
    a = as_param(alphas)
    size = a.shape[0]
    flow = jnp.eye(size, k=1, dtype=a.dtype).at[:, 0].add(-a)
    unit = jnp.zeros_like(a).at[q + start - 1].set(1)
    return linalg.lyapunov(flow, jnp.outer(unit, unit))[q + state - 1, q + state - 1]


def speed(measure: Measure, alphas: Numbers, q: int = 0) -> Scalar:
    """1 / settling time of x_2, 1 / squared error of x_2, or -max Re of the poles: each is proportional to gamma."""
    if measure == "settling time":
        return 1 / settling_time(alphas, q)
    if measure == "squared error":
        return 1 / squared_error(alphas, q)
    if measure == "spectral abscissa":
        return -jnp.max(jnp.real(hurwitz.poles(as_param(alphas))))
    raise refuse("speed", "measure", repr(measure), "one of " + ", ".join(MEASURES), "Each scales with gamma.")


def quietest(measure: Measure, q: int, *, reference: Numbers = (3.0, 2.0), spread: float = 14.0) -> Quietest:
    """min c(alphas, q) over alphas that satisfy (10) and have the speed that `reference` (n = 2, q = 0) has.

    Global search over log q (differential evolution from several seeds, and the optimum for q - 1 with one more fast pole), the
    ends refined by Nelder-Mead; deterministic. `spread` bounds the poles: with alpha_N = 1, log q_i exceeds log C(N, i) by no
    more than spread * min(i, N - i), so that no pole exceeds about sqrt(N) exp(spread / 2). A minimum that is reached only in a
    limit (q_i -> 0, a pole at infinity) is approached to these bounds. At equal abscissa alpha(s) = beta(s + abscissa) with
    beta from log q, so that no eigenvalue is needed where poles meet. Needs float64.
    """
    require_integer("quietest", "q", q, 0, "It counts the integrators between innovation and injection.")
    if measure not in MEASURES:
        raise refuse("quietest", "measure", repr(measure), "one of " + ", ".join(MEASURES), "Each scales with gamma.")
    if jnp.result_type(float) != jnp.float64:
        raise refuse("quietest", "precision", "float32", "float64", "Set JAX_ENABLE_X64=1: gains spread over decades.")
    require_positive("quietest", "spread", spread, "It bounds log q, hence the fastest pole.")
    given = as_param(reference)
    if given.shape != (2,) or not hurwitz.is_hurwitz(given):
        raise refuse(
            "quietest", "reference", str(reference), "two coefficients of a Hurwitz polynomial", "Paper 000 has (3, 2)."
        )
    return _quietest(measure, q, tuple(float(a) for a in given), float(spread))


@lru_cache
def _quietest(measure: Measure, q: int, reference: tuple[float, ...], spread: float) -> Quietest:
    size = q + 2
    target, which = speed(measure, reference), jnp.asarray(MEASURES.index(measure))
    cost = _search(q)

    def many(columns):
        return np.asarray(cost(jnp.asarray(columns.T), which, target)[0])

    def one(v):
        return float(many(v[:, None])[0])

    places = np.minimum(np.arange(1, size + 1), size - np.arange(1, size + 1))
    box = [(-LOWEST * k, spread * k) for k in places[:-1]] + [(-2 * LOWEST, 0.0)]
    wishes = {"popsize": 8, "maxiter": 15 * size, "tol": 1e-7, "polish": False, "vectorized": True, "updating": "deferred"}
    starts = [scipy.optimize.differential_evolution(many, box, rng=seed, **wishes).x for seed in SEEDS]
    if q > 0:
        fast = math.exp(spread / 2) * float(speed("spectral abscissa", reference))
        longer = np.polymul([1.0, fast], [1.0, *_quietest(measure, q - 1, reference, spread).alphas])[1:]
        weights = hurwitz.q_from_alphas(hurwitz.normalise(jnp.asarray(longer))[0])
        v = np.append(np.log(np.asarray(weights) / np.asarray(hurwitz.binomial(size)))[:-1], -2 * LOWEST)
        starts.append(np.clip(np.nan_to_num(v), *np.asarray(box).T))
    options = {"xatol": 1e-7, "fatol": 1e-12, "maxiter": 50 * size}
    ends = [scipy.optimize.minimize(one, v, method="Nelder-Mead", bounds=box, options=options) for v in starts]
    best = min(ends, key=lambda end: end.fun).x
    alphas = np.asarray(cost(jnp.asarray(best)[None], which, target)[1][0])
    c = float(noise_constant(alphas, q))
    return Quietest(alphas, c, math.sqrt(c / float(noise_constant(reference))))


@lru_cache
def _search(q: int):
    """(candidates (S, n + q), measure, speed) -> (c (S,), alphas (S, n + q)): compiled once for each q."""
    size = q + 2
    centre = jnp.log(hurwitz.binomial(size))
    order = jnp.arange(1, size + 1, dtype=centre.dtype)

    def settled(beta, v, target):
        return beta * (target * settling_time(beta, q, band=BAND * (1 - EDGE))) ** order

    def squared(beta, v, target):
        return beta * (target * squared_error(beta, q)) ** order

    def shifted(beta, v, target):
        return hurwitz.moved(beta * jnp.exp(v[-1]) ** order, target)

    branches = [settled, squared, shifted]

    def one(v, which, target):
        beta = hurwitz.alphas_from_log_q(centre + v.at[-1].set(0))
        alphas = jax.lax.switch(which, branches, beta, v, target)
        c = noise_constant(alphas, q)
        return jnp.where(jnp.isfinite(c) & (c > 0), c, jnp.inf), alphas

    return jax.jit(jax.vmap(one, in_axes=(0, None, None)))
