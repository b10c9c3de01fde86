"""Corollaries 1 and 2 of paper 000 as run-time checks on the innovation y - C xhat, usable under jit and over a Trajectory."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxobs import chain_bounds
from jaxobs._module import Scalar


class Budget(NamedTuple):
    """spent (T,): the integral of (C xhat - y)^2 so far, as a share of what corollary 1 grants. holds: whether it stays <= 1.
    broken_at [s]: the first time it does not, infinite if never."""

    spent: Float[Array, " T"]
    holds: Bool[Array, ""]
    broken_at: Scalar


class Envelope(NamedTuple):
    """limit (T,): what corollary 2 grants |y - xhat_1| at each time. holds, broken_at [s]: as in Budget."""

    limit: Float[Array, " T"]
    holds: Bool[Array, ""]
    broken_at: Scalar


def innovation_energy(ts: Float[Array, " T"], innovation: Float[Array, "T p"]) -> Float[Array, " T"]:
    """int_{t_1}^{t_k} |y - C xhat|^2 dt by the trapezoidal rule, for every sample k:

        E_1 = 0,      E_{k+1} = E_k + (t_{k+1} - t_k) (|r_k|^2 + |r_{k+1}|^2) / 2,      r = y - C xhat.

    ts (T,) [s], increasing; innovation (T, p) in the units of y. Returns (T,), in those units squared times s. Nothing is
    checked. Source: the second term of paper 000, (33).
    """
    square = jnp.sum(innovation**2, axis=1)
    pieces = jnp.diff(ts) * (square[1:] + square[:-1]) / 2
    return jnp.concatenate([jnp.zeros_like(square[:1]), jnp.cumsum(pieces)])


def budget(
    ts: Float[Array, " T"],
    innovation: Float[Array, "T p"],
    alphas: Float[Array, " n"],
    gamma: Scalar,
    reach: Float[Array, " n"],
) -> Budget:
    """Corollary 1 for the observer of theorem 1, without noise: under condition (5), at all times

        integral_0^t beta e'Q^-1 e + (C xhat - y)^2 dtau <= e(0)'P^-1 e(0).      (33)

    Only the second term can be seen; it alone may not exceed the right side, taken at the worst initial error |e_j(0)| <=
    reach_j. The integral is that of the samples: leave it room for the trapezoidal rule, and none for noise, which has no
    budget.

    ts (T,) [s], increasing, from the observer's start; innovation (T, 1) in the units of y; alphas (n,) with (10), gamma [1/s]
    with (5); reach (n,) in the units of the states. Jittable, so no values are checked. Source: paper 000, corollary 1, (33).
    """
    spent = innovation_energy(ts, innovation) / chain_bounds.initial_energy(alphas, gamma, reach)
    return Budget(spent, *_judged(ts, spent <= 1))


def envelope(
    ts: Float[Array, " T"],
    innovation: Float[Array, "T p"],
    alphas: Float[Array, " N"],
    gamma: Scalar,
    lipschitz: Scalar,
    reach: Float[Array, " n"],
    noise: Scalar,
) -> Envelope:
    """Corollary 2 for the q-integral observer (q = N - n; the bounded form) and |w| <= noise: under (44), with W =
    sqrt(e'Z^-1 e),

        W(t) <= e^{-C_1 t/2} W(0) + (1 - e^{-C_1 t/2}) 2 c noise / C_1,     |y - xhat_1| <= sqrt(Z_{q+1,q+1}) W(t) + noise,

    c = |Z^-1/2 B|, W(0) at the worst initial error |x_j - xhat_j| <= reach_j. Infinite, and never broken, where (44) fails.

    ts (T,) [s], increasing, from the observer's start; innovation (T, 1) and noise in the units of y; alphas (N,) with (10),
    gamma [1/s]; lipschitz: rho of phi; reach (n,) in the units of the states. Jittable, so no values are checked. Source: paper
    000, corollary 2, (44), (48).
    """
    q = alphas.shape[0] - reach.shape[0]
    rate = chain_bounds.decay_rate(alphas, gamma, lipschitz)
    safe = jnp.where(rate > 0, rate, 1)
    fading = jnp.exp(-safe / 2 * (ts - ts[0]))
    start = jnp.sqrt(chain_bounds.initial_energy(alphas, gamma, reach))
    pushed = 2 * chain_bounds.noise_injection(alphas, gamma, q) * noise / safe
    p, _ = chain_bounds.riccati_pair(alphas, gamma)
    limit = jnp.sqrt(p[q, q]) * (fading * start + (1 - fading) * pushed) + noise
    limit = jnp.where(rate > 0, limit, jnp.inf)
    return Envelope(limit, *_judged(ts, jnp.max(jnp.abs(innovation), axis=1) <= limit))


def _judged(ts: Float[Array, " T"], kept: Bool[Array, " T"]) -> tuple[Bool[Array, ""], Scalar]:
    return jnp.all(kept), jnp.where(jnp.all(kept), jnp.inf, ts[jnp.argmin(kept)])
