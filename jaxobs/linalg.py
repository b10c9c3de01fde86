"""Linear algebra of integrator chains: the closed-form Riccati solution, condition (5), Lyapunov solves, phi-functions.

Gains of the kind gamma^i spread over many decades; everything is therefore computed at gamma = 1 (a tilde in the formulas)
and scaled by D = diag(gamma, ..., gamma^n). That is exact where an unscaled solve loses all digits (n = 5, gamma = 100).
"""

import math
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs import hurwitz
from jaxobs._module import Numbers, require_nonnegative


def shift(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """A x for the chain of integrators: (x_2, ..., x_n, 0), without a matrix."""
    return jnp.concatenate([x[1:], jnp.zeros_like(x[:1])])


@lru_cache
def _riccati_products(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices into (alpha_0, ..., alpha_n, 0) and signs, (n, n, n), of the sum that makes P~_ij."""
    left, right = np.full((2, n, n, n), n + 1)
    sign = np.zeros((n, n, n))
    for i in range(1, n + 1):
        for j in range(1, n + 1):
            for m in range(min(i, j)):
                if max(i, j) + m <= n:
                    left[i - 1, j - 1, m], right[i - 1, j - 1, m] = max(i, j) + m, min(i, j) - 1 - m
                    sign[i - 1, j - 1, m] = (-1) ** m
    return left, right, sign


def chain_riccati(alphas: Float[Array, " n"]) -> Float[Array, "n n"]:
    """P~ with A P~ + P~ A' - P~ C'C P~ + diag(q) = 0 and P~ C' = alphas; for i >= j (paper 000, (6), (18)-(21) in closed form)

        P~_ij = sum_{m=0}^{j-1} (-1)^m alpha_{i+m} alpha_{j-1-m}.

    At other gains P(gamma) = D P~ D / gamma with D = diag(gamma^i), (20). Positive definite when the alphas satisfy (10).
    """
    left, right, sign = _riccati_products(alphas.shape[0])
    a = jnp.concatenate([jnp.ones_like(alphas[:1]), alphas, jnp.zeros_like(alphas[:1])])
    return jnp.sum(jnp.asarray(sign, a.dtype) * a[left] * a[right], axis=-1)


def _gain_free_parts(alphas: Float[Array, " n"]) -> tuple[Array, Array, Array, Array]:
    """(P~, lambda_min(P~^-1/2 Q~ P~^-1/2), (P~^-1)_nn, whether q > 0), for alphas with alpha_n = 1."""
    q = hurwitz.q_from_alphas(alphas)
    valid = jnp.all(q > 0)
    q = jnp.where(valid, q, 1)
    p = jnp.where(valid, chain_riccati(alphas), jnp.eye(alphas.shape[0], dtype=alphas.dtype))
    # Q is diagonal: lambda_min(P^-1/2 Q P^-1/2) = 1 / lambda_max(Q^-1/2 P Q^-1/2), which needs no inverse of P.
    slowest = 1 / jnp.linalg.eigvalsh(p / jnp.sqrt(q[:, None] * q[None, :]))[-1]
    d = jnp.sqrt(jnp.diagonal(p))
    pivot = jnp.linalg.cholesky(p / (d[:, None] * d[None, :]))[-1, -1] * d[-1]
    return p, slowest, 1 / pivot**2, valid


def largest_lipschitz(alphas: Float[Array, " n"], gamma: Float[Array, ""]) -> Float[Array, ""]:
    """The supremum of the rho that condition (5) of paper 000 certifies, in the scaled form

        lambda_min(P^-1/2 Q P^-1/2) / (2 sqrt((P^-1)_nn lambda_max(P))) = gamma l~ / (2 sqrt((P~^-1)_nn lambda_max(S P~ S)))

    with l~ = lambda_min(P~^-1/2 Q~ P~^-1/2) and S = diag(gamma^{i-n}). Increasing in gamma; 0 where (10) fails (nothing is
    certified then, which does not mean that the observer is unstable).
    """
    normal, scale = hurwitz.normalise(alphas)
    g = gamma * scale
    n = alphas.shape[0]
    p, slowest, inverse_nn, valid = _gain_free_parts(normal)
    # S P~ S at the original alphas: entries of P~ there are scale^{i+j-1} times those at the normalised ones.
    s = gamma ** jnp.arange(1 - n, 1, dtype=alphas.dtype) * scale ** jnp.arange(1 - n, 1, dtype=alphas.dtype)
    largest = jnp.linalg.eigvalsh(s[:, None] * p * s[None, :])[-1]
    return jnp.where(valid, g * slowest / (2 * jnp.sqrt(inverse_nn * largest)), 0)


def condition5_margin(alphas: Float[Array, " n"], gamma: Float[Array, ""], lipschitz: Float[Array, ""]) -> Float[Array, ""]:
    """`largest_lipschitz` minus the Lipschitz constant: condition (5), or (44) for n + q alphas, holds when positive."""
    return largest_lipschitz(alphas, gamma) - lipschitz


def condition5_rate(alphas: Float[Array, " n"], gamma: Float[Array, ""], lipschitz: Float[Array, ""]) -> Float[Array, ""]:
    """The decay rate of |e| that condition (5) proves, negative where it does not hold; NaN where (10) fails:

    lambda_min(P^-1/2 Q P^-1/2) / 2 - rho sqrt((P^-1)_nn lambda_max(P)).
    """
    normal, scale = hurwitz.normalise(alphas)
    _, slowest, _, valid = _gain_free_parts(normal)
    return jnp.where(valid, gamma * scale * slowest / 2 * (1 - lipschitz / largest_lipschitz(alphas, gamma)), jnp.nan)


def smallest_gamma(alphas: Float[Array, " n"], lipschitz: Numbers) -> Float[Array, ""]:
    """The infimum of the gamma for which condition (5) holds (strictly above it); infinite where (10) fails,
    else 0 for lipschitz = 0.

    Bisection in log gamma between two bounds in closed form; the derivative is that of the implicit function.
    """
    require_nonnegative("smallest_gamma", "lipschitz", lipschitz, "It bounds the slope of phi.")
    lipschitz = jnp.asarray(lipschitz, alphas.dtype)
    fixed = jax.lax.stop_gradient(alphas)
    positive = lipschitz > 0
    rho = jax.lax.stop_gradient(jnp.where(positive, lipschitz, 1))
    normal, scale = hurwitz.normalise(fixed)
    p, slowest, inverse_nn, valid = _gain_free_parts(normal)
    unit = 2 * rho * jnp.sqrt(inverse_nn) / slowest / scale
    low = jnp.log(unit * jnp.sqrt(p[-1, -1]))  # lambda_max(S P~ S) >= P~_nn
    # For gamma * scale >= 1, lambda_max(S P~ S) <= lambda_max(P~).
    high = jnp.log(jnp.maximum(unit * jnp.sqrt(jnp.linalg.eigvalsh(p)[-1]), 1 / scale) * 1.001)

    def halve(_, bracket):
        low, high = bracket
        middle = (low + high) / 2
        enough = largest_lipschitz(fixed, jnp.exp(middle)) >= rho
        return jnp.where(enough, low, middle), jnp.where(enough, middle, high)

    low, high = jax.lax.fori_loop(0, 60, halve, (low, high))
    root = jnp.exp(high)
    slope = jax.grad(largest_lipschitz, argnums=1)(fixed, root)
    # One Newton step on the traced arguments: its value is the root's, its derivative the implicit one.
    residual = largest_lipschitz(alphas, root) - lipschitz
    step = (residual - jax.lax.stop_gradient(residual)) / jnp.where(valid, slope, 1)
    return jnp.where(valid, jnp.where(positive, root - step, jnp.where(lipschitz == 0, 0, jnp.nan)), jnp.inf)


def lyapunov(a: Float[Array, "n n"], q: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """X with a X + X a' + q = 0, by the Kronecker sum (n <= 10 or so; scale the problem first)."""
    n = a.shape[0]
    identity = jnp.eye(n, dtype=a.dtype)
    operator = jnp.kron(a, identity) + jnp.kron(identity, a)
    x = jnp.linalg.solve(operator, -q.reshape(-1)).reshape(n, n)
    return (x + x.T) / 2


def stein(a: Float[Array, "n n"], q: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """X with a X a' - X + q = 0, by the Kronecker product (n <= 10 or so; scale the problem first): `lyapunov` in steps."""
    n = a.shape[0]
    x = jnp.linalg.solve(jnp.eye(n * n, dtype=a.dtype) - jnp.kron(a, a), q.reshape(-1)).reshape(n, n)
    return (x + x.T) / 2


def noise_covariance(alphas: Float[Array, " N"], q: int = 0) -> Float[Array, "N N"]:
    """The covariance of the error of a chain observer with gain 1, under white measurement noise of unit intensity.

    X solves F X + X F' + b b' = 0, F = A - alphas C; b = alphas for q = 0, and the unit vector of the q-th integrator otherwise
    (paper 000, (41)). At gain gamma, and for noise of standard deviation sigma held over T_s << 1/gamma, the estimate x_i has
    Var e_i = sigma^2 T_s gamma^{2i-1} X_{q+i,q+i}; so alphas (3, 2) give 2/3 gamma^3 sigma^2 T_s for x_2.
    """
    size = alphas.shape[0]
    f = jnp.eye(size, k=1, dtype=alphas.dtype).at[:, 0].add(-alphas)
    b = alphas if q == 0 else jnp.zeros_like(alphas).at[q - 1].set(1)
    return lyapunov(f, jnp.outer(b, b))


def balance(a: Float[Array, "n n"]) -> Float[Array, " n"]:
    """Powers of two d such that diag(1/d) a diag(d) has rows and columns of like size (Osborne's iteration)."""
    n = a.shape[0]
    off = jnp.abs(a) * (1 - jnp.eye(n, dtype=a.dtype))

    def sweep(_, log_d):
        for i in range(n):
            scaled = off * jnp.exp2(log_d[None, :] - log_d[:, None])
            column, row = jnp.sum(scaled[:, i]), jnp.sum(scaled[i, :])
            change = 0.5 * jnp.log2(jnp.where((column > 0) & (row > 0), row / jnp.where(column > 0, column, 1), 1))
            log_d = log_d.at[i].add(jnp.round(change))
        return log_d

    log_d = jax.lax.fori_loop(0, 10, sweep, jnp.zeros((n,), a.dtype))
    return jnp.ldexp(jnp.ones_like(log_d), log_d.astype(jnp.int32))  # exp2 itself rounds


def triangularise(rows: Float[Array, "k n"]) -> Float[Array, "n n"]:
    """R upper triangular with a non-negative diagonal and R'R = rows'rows, for k >= n rows: the QR array step.

    Sums of squares are propagated as the rows of their roots, so nothing positive definite can be lost to rounding. Columns
    may differ by any factor (QR commutes with it). Differentiable where the columns are independent.
    """
    r = jnp.linalg.qr(rows, mode="r")
    return jnp.where(jnp.diagonal(r) < 0, -1, 1).astype(r.dtype)[:, None] * r


TAYLOR, SMALL, DOUBLINGS = 14, 0.5, 24  # the remainder SMALL^15 / 15! is below rounding; norms up to SMALL 2^DOUBLINGS


def phi_functions(a: Float[Array, "n n"], count: int) -> list[Float[Array, "n n"]]:
    """[phi_0, ..., phi_count] of a, phi_k(a) = sum_j a^j / (j + k)!: phi_0 = exp and phi_{k+1}(a) = (phi_k(a) - 1/k!) / a.

    The series at a / 2^s, then s times phi_k(2 z) = 2^-k (phi_0(z) phi_k(z) + sum_{1 <= j <= k} phi_j(z) / (k - j)!). Products
    only: many small linear solves at once stop each other in the threads of XLA. Singular a is no exception. The matrix is
    balanced first, so that gains gamma^i cost no digits. Source: Skaflestad and Wright, Appl. Numer. Math. 59 (2009), eq. (8).
    """
    d = balance(a)
    balanced, one = a * d[None, :] / d[:, None], jnp.eye(a.shape[0], dtype=a.dtype)
    norm = jnp.max(jnp.sum(jnp.abs(jax.lax.stop_gradient(balanced)), axis=0))
    doublings = jnp.clip(jnp.ceil(jnp.log2(norm / SMALL)), 0, DOUBLINGS)
    z = balanced / 2**doublings
    inverse = jnp.asarray([1 / math.factorial(j + count) for j in range(TAYLOR + 1)], a.dtype)
    last = jax.lax.fori_loop(0, TAYLOR, lambda i, p: z @ p + one * inverse[TAYLOR - 1 - i], one * inverse[TAYLOR])
    phi = [last]
    for k in range(count - 1, -1, -1):
        phi.insert(0, z @ phi[0] + one / float(math.factorial(k)))

    def double(i: Array, phi: list[Array]) -> list[Array]:
        twice = [phi[0] @ phi[0]]
        for k in range(1, count + 1):
            rest = sum((phi[j] / float(math.factorial(k - j)) for j in range(1, k + 1)), start=jnp.zeros_like(one))
            twice.append((phi[0] @ phi[k] + rest) / 2**k)
        return [jnp.where(i.astype(a.dtype) < doublings, new, old) for new, old in zip(twice, phi, strict=True)]

    phi = jax.lax.fori_loop(0, DOUBLINGS, double, phi)
    return [one * d[:, None] / d[None, :] for one in phi]


def expm(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """e^a, as phi_0."""
    return phi_functions(a, 0)[0]


def pascal(n: int) -> Float[np.ndarray, "n n"]:
    """The lower triangular L_ij = (-1)^{i+j} C(i-1, j-1), with L L' = ((-1)^{i+j} C(i+j-2, i-1)) and L^-1 = |L|."""
    return np.asarray([[(-1) ** (i + j) * math.comb(i, j) for j in range(n)] for i in range(n)], dtype=float)


def tracker_structure(n: int, q: int) -> tuple[Float[np.ndarray, "N N"], Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """(A~, s, B) of the tracker's state eta = (xi, xhat), N = n + q (paper 001, (3)-(4)): A~ = s A_N s, A_N the plain shift,
    s = (+1 on xi, -1 on xhat; all +1 if q = 0), and y enters through B, the q-th unit vector (zero if q = 0).
    """
    s = np.asarray([1.0] * q + [-1.0 if q else 1.0] * n)
    return s[:, None] * np.eye(n + q, k=1) * s[None, :], s, np.eye(n + q)[q - 1] * (q > 0)


def tracker_steady(n: int, q: int, mu: float = 1.0) -> Float[np.ndarray, "N N"]:
    """H_inf with -mu H - A~'H - H A~ + C~'C~ = 0 (paper 001, (8), (11)), in closed form:

        (H_inf)_ij = (-1)^{i+j} s_i s_j C(i+j-2, i-1) / mu^{i+j-1}.

    Its first column's inverse is the steady gain, H_inf^-1 C~' = (s_i C(N, i) mu^i).
    """
    factor, (_, s, _) = pascal(n + q), tracker_structure(n, q)
    order = np.arange(n + q)
    return np.outer(s, s) * (factor @ factor.T) / float(mu) ** (order[:, None] + order[None, :] + 1)
