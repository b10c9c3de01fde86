"""What V = e'P(gamma)^-1 e of the chain Riccati equation proves: the constants of paper 000, (24) to (48), and (33), as
functions.

P = D P~ D / gamma with D = diag(gamma^i), P~ = `linalg.chain_riccati(alphas)`; N = n + q, alphas (N,), a polynomial with (10)
(the values mean nothing otherwise). For the q-integral observer P is the Z of (40). Everything is jittable and
differentiable.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs import hurwitz, linalg
from jaxobs._module import Scalar


def riccati_pair(alphas: Float[Array, " N"], gamma: Scalar) -> tuple[Float[Array, "N N"], Float[Array, "N N"]]:
    """(P(gamma), Q(gamma)) with A P + P A' - P C'C P + Q = 0, (6), unscaled."""
    d = gamma ** jnp.arange(1, alphas.shape[0] + 1, dtype=alphas.dtype)
    return linalg.chain_riccati(alphas) * d[:, None] * d[None, :] / gamma, jnp.diag(hurwitz.q_from_alphas(alphas) * d**2)


def diagonal_ratios(alphas: Float[Array, " N"]) -> Float[Array, " N"]:
    """c_ii of (27): P_ii = c_ii Q_ii / gamma, at every gamma."""
    return jnp.diagonal(linalg.chain_riccati(alphas)) / hurwitz.q_from_alphas(alphas)


def metric_rate(alphas: Float[Array, " N"]) -> Scalar:
    """l~ = lambda_min(P~^-1/2 Q~ P~^-1/2), without unit: the supremum of 1 / lambda_n in (28).

    Q >= gamma l~ P with equality somewhere; hence lambda_min(P^-1/2 Q P^-1/2) = gamma l~ exactly, which is (31). alphas (N,)
    with (10). Source: paper 000, (28), (31).
    """
    root = jnp.sqrt(hurwitz.q_from_alphas(alphas))
    return 1 / jnp.linalg.eigvalsh(linalg.chain_riccati(alphas) / (root[:, None] * root[None, :]))[-1]


def normalised_weight(alphas: Float[Array, " N"], gamma: Scalar) -> Float[Array, "N N"]:
    """P^-1/2 Q P^-1/2 with the symmetric root, the matrix of (29) and (30). Its eigenvalues are gamma times those at gamma =
    1; its eigenvectors turn with gamma."""
    p, q = riccati_pair(alphas, gamma)
    values, vectors = jnp.linalg.eigh(p)
    inverse_root = (vectors / jnp.sqrt(values)) @ vectors.T
    return inverse_root @ q @ inverse_root


def decay_rate(alphas: Float[Array, " N"], gamma: Scalar, lipschitz: Scalar) -> Scalar:
    """c_1 of (24), C_1 of (44): V' <= -c_1 V without noise, c_1 = gamma l~ - 2 rho sqrt((P^-1)_NN lambda_max(P))."""
    best = gamma * metric_rate(alphas)
    return best * (1 - lipschitz / linalg.largest_lipschitz(alphas, gamma))


def optimality_weight(alphas: Float[Array, " N"], gamma: Scalar, lipschitz: Scalar) -> Scalar:
    """beta of (33), the largest the proof gives: beta = c_1 gamma l~, from P^-1 >= gamma l~ Q^-1 (corollary 1)."""
    return decay_rate(alphas, gamma, lipschitz) * gamma * metric_rate(alphas)


def noise_injection(alphas: Float[Array, " N"], gamma: Scalar, q: int) -> Scalar:
    """How hard noise w pushes W = sqrt(V), W' <= -c_1/2 W + c |w|: for q > 0, exactly

        c = |Z^-1/2 B| = gamma^{1/2-q} sqrt((Z~^-1)_qq),

    where the printed C_2 gamma^{-q/2} of (48) is no bound in general; for q = 0, where w enters through the gain,
    c = |P^-1/2 P C'| = sqrt(alpha_1 gamma).
    """
    if q == 0:
        return jnp.sqrt(alphas[0] * gamma)
    inverse = jnp.linalg.inv(linalg.chain_riccati(alphas))
    return gamma ** jnp.asarray(0.5 - q, gamma.dtype) * jnp.sqrt(inverse[q - 1, q - 1])


def iss_gain(alphas: Float[Array, " N"], gamma: Scalar, lipschitz: Scalar, q: int) -> Float[Array, " n"]:
    """The gain behind (48) in the physical coordinates: limsup |x_j - xhat_j| <= g_j sup |w|, infinite where (44) fails, with

        g_j = sqrt(Z_{q+j,q+j}) 2 c / c_1,     c = |Z^-1/2 B|.

    g_j grows like gamma^{j-1} for every q: what (48) attenuates is a norm that shrinks with gamma.
    """
    p, _ = riccati_pair(alphas, gamma)
    rate = decay_rate(alphas, gamma, lipschitz)
    gains = jnp.sqrt(jnp.diagonal(p)[q:]) * 2 * noise_injection(alphas, gamma, q) / jnp.where(rate > 0, rate, 1)
    return jnp.where(rate > 0, gains, jnp.inf)


def growth(alphas: Float[Array, " N"], ratio: Scalar) -> Scalar:
    """Lemma 3 in one number: lambda_min(P_2^-1/2 P_1 P_2^-1/2) for gamma_1 = ratio gamma_2, above 1 exactly when P_1 > P_2.

    It depends on the ratio alone: P_1 >= growth P_2 reads R P~ R / ratio >= growth P~ with R = diag(ratio^i).
    """
    factor = jnp.linalg.cholesky(linalg.chain_riccati(alphas))
    powers = ratio ** jnp.arange(1, alphas.shape[0] + 1, dtype=alphas.dtype)
    left = jnp.linalg.solve(factor, powers[:, None] * factor)
    return jnp.linalg.eigvalsh(left @ left.T)[0] / ratio


def initial_energy(alphas: Float[Array, " N"], gamma: Scalar, reach: Float[Array, " n"]) -> Scalar:
    """max V(0) = e(0)'P^-1 e(0) over all initial errors |x_j - xhat_j| <= reach_j: V is convex, so at a corner of the box.

    All corners are tried. The errors of the q = N - n integrators are zero at the start (the bounded form starts its eps at 0).
    alphas (N,) with (10), gamma [1/s], reach (n,) in the units of the states. Source: the right side of paper 000, (33).
    """
    n, size = reach.shape[0], alphas.shape[0]
    signs = 1 - 2 * ((np.arange(2 ** (n - 1))[:, None] >> np.arange(n)[None, :]) & 1)
    corners = jnp.asarray(signs, reach.dtype) * reach
    padded = jnp.concatenate([jnp.zeros((corners.shape[0], size - n), reach.dtype), corners], axis=1)
    scaled = padded / gamma ** jnp.arange(1, size + 1, dtype=gamma.dtype)
    inverse = jnp.linalg.inv(linalg.chain_riccati(alphas))
    return gamma * jnp.max(jnp.einsum("ki,ij,kj->k", scaled, inverse, scaled))


def gauthier_metric(n: int, theta: Scalar) -> Float[Array, "n n"]:
    """S with -theta S - A'S - S A + C'C = 0 (Gauthier, Hammouri and Othman 1992): S_ij = (-1)^{i+j} C(i+j-2, i-1) /
    theta^{i+j-1}.

    Its gain S^-1 C' is alphas_i theta^i with binomial alphas, that of P(theta) C'; the metrics S and P^-1 differ.
    """
    factor = linalg.pascal(n)
    order = jnp.arange(n, dtype=theta.dtype)
    return jnp.asarray(factor @ factor.T, theta.dtype) / theta ** (order[:, None] + order[None, :] + 1)


def shannon_period(bandwidth: Scalar) -> Scalar:
    """pi / bandwidth: the longest sampling period [s] that keeps a state of this bandwidth [rad/s] (Shannon's theorem).

    The remark at the end of paper 000's example: a period that (62) or (65) allows has to pass this one as well.
    """
    return jnp.pi / bandwidth


def bandwidth(x: Float[Array, " T"], dt: Scalar, share: float = 0.99) -> Scalar:
    """The frequency [rad/s] below which a record has this share of its power about the mean, by its Hann-windowed spectrum:

        min {omega_k: sum_{j<=k} |X_j|^2 >= share sum_j |X_j|^2},      X = rfft(w (x - mean x)),   omega_k = 2 pi k / (T dt).

    x (T,), dt [s], share in ]0, 1]; none of them is checked. Source: paper 000 asks for a bandwidth (the remark on Shannon's
    theorem at the end of its example) and defines none: share and window are ours (the window: Harris, 1978).
    """
    count = x.shape[0]
    window = jnp.asarray(np.hanning(count), x.dtype)
    power = jnp.abs(jnp.fft.rfft((x - jnp.mean(x)) * window)) ** 2
    reached = jnp.cumsum(power) >= share * jnp.sum(power)
    return 2 * jnp.pi * jnp.argmax(reached).astype(x.dtype) / (count * dt)
