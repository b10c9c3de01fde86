"""The continuous plant seen through samples, the innovation held between them: two certificates, the second far sharper."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractError
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class Sampled(AbstractError):
    """For e' = A(rho) e - G(rho) C e(t_k), t_k <= t < t_{k+1}, with 0 < t_{k+1} - t_k <= delta, C = output,

        A(rho) = a + sum_k rho_k b_k c_k',    G(rho) = gain + sum_k rho_k b_k inner_k,    F = A - G C:

    P > 0, W > 0, x = rate delta in [0, 1[ and, at all corners of lower <= rho <= upper,

        [-(F'P + P F) - 2 rate P,  -P G,  -delta F'C'W;   *,  kappa W,  -delta G'C'W;   *,  *,  W] > 0,
        kappa = (1 - x) pi^2 / 4 + x^2   (with 9.8696 < pi^2)

    imply |e(t)| <= sqrt(cond P) e^{-rate (t - t_0)} |e(t_0)| after the first sample t_0, whatever the intervals.

    Proof. v = C (e - e(t_k)) has e' = F e + G v. With c = m cot(m tau) - rate, m cot(m delta) = rate, tau = t - t_k,

        V = e'P e + delta^2 c(tau) v'W v,     c' + 2 rate c + c^2 = -(m^2 + rate^2),    2 c v'W v' <= c^2 v'W v + v''W v',

    V' + 2 rate V <= (the form of the matrix above, by its Schur complement) < 0 if delta^2 (m^2 + rate^2) >= kappa. That holds:
    with q = (m delta)^2, x = m delta cot(m delta) = 1 - 2 sum_j q / (j^2 pi^2 - q) is concave and falling in q, so q is concave
    in x, above its chord from (0, pi^2 / 4) to (1, 0). At t_k v = 0 and c v'W v -> 0; at t_{k+1} c >= 0, and V does not rise.
    For rate 0 this is Wirtinger's inequality, as Liu and Fridman use it, Automatica 48 (2012) 102-108.

    p (n, n), w (p, p), delta [s], rate [1/s] >= 0; else as in Corners.
    """

    p: FloatMatrix
    w: FloatMatrix
    delta: float
    rate: float
    theorem: ClassVar[str] = "sampled"


@dataclasses.dataclass(frozen=True)
class SampledTube(AbstractError):
    """For the error dynamics of Sampled, M(rho) = [F, G; C F, C G] of (e, v), v = C (e - e(t_k)), and a tube of ellipsoids

        Q(tau) = sum_i binom(K, i) (tau / delta)^i (1 - tau / delta)^{K-i} Q_i,    Q_0 = diag(start, 0):

        start > 0,    start - (Q_i)_ee > 0  (i = 1, ..., K),    and at all corners, for i = 0, ..., K,
        i (Q_i - Q_{i-1}) + (K - i) (Q_{i+1} - Q_i) - delta (M Q_i + Q_i M' + 2 rate Q_i) > 0

    imply |e(t)| <= sqrt(cond start) e^{-rate (t - t_0)} |e(t_0)| after the first sample t_0, for all intervals up to delta.

    Proof. The last matrices are the Bernstein coefficients of delta (Q' - M Q - Q M' - 2 rate Q), which is therefore positive
    on [0, delta]. With Phi the transition matrix of M along any rho(t), D = e^{-2 rate tau} Q - Phi Q_0 Phi' has D(0) = 0 and
    D' > M D + D M', so D >= 0. If e(t_k)' start^-1 e(t_k) <= 1, then z = (e, v) has z z' <= Q_0 at t_k, hence z z' <= Phi Q_0
    Phi' <= e^{-2 rate tau} Q(tau) after it, and e e' <= e^{-2 rate tau} start, since start exceeds the ee blocks: e' start^-1 e
    falls by e^{-2 rate tau}. For rate 0 the strict inequalities leave room for a positive one.

    start (n, n), tube (K (n + p), n + p): Q_1 to Q_K one below the other; else as in Sampled. Source: comparison of Lyapunov
    differential equations; the Bernstein form, Farouki, Computer Aided Geometric Design 29 (2012) 379-419.
    """

    start: FloatMatrix
    tube: FloatMatrix
    delta: float
    rate: float
    theorem: ClassVar[str] = "sampled-tube"
