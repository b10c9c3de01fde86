"""What is left of the error when the model is wrong and the measurement noisy, both by a bounded amount."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractUncertainError
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class Mismatch(AbstractUncertainError):
    """For e' = F(rho) e + disturbance d(t) - G(rho) v(t), G = gain + sum_k rho_k b_k inner_k, |d| <= size, |v| <= noise_size:

        [-(F'P + P F) - alpha P,  -P disturbance,  P G;   *,  beta I,  0;   *,  *,  gamma I] > 0 at all corners,    P > 0,
        beta size^2 + gamma noise_size^2 <= alpha,       [P, weight'; weight, bound^2 I] > 0

    imply |weight e(t)|^2 <= bound^2 (1 + e^{-alpha t} (e(0)'P e(0) - 1)): from any error |weight e| is at most `bound` in the
    end, and from e(0)'P e(0) <= 1 always.

    Proof. V = e'P e has V' <= -alpha V + beta |d|^2 + gamma |v|^2 <= -alpha (V - 1), and |weight e|^2 <= bound^2 V (Schur).

    d is what the model lacks: with x_n' = phi(x, u) and the observer's phi_model, d = phi - phi_model along the plant's
    trajectory, and the slopes are those of phi_model. disturbance (n, m), weight (s, n), p (n, n), alpha [1/s] > 0; else as in
    Corners. Source: Boyd et al., Linear Matrix Inequalities in System and Control Theory, 1994, section 6.1.3 (peak inputs).
    """

    p: FloatMatrix
    alpha: float
    beta: float
    gamma: float
    disturbance: FloatMatrix
    size: float
    noise_size: float
    weight: FloatMatrix
    bound: float
    theorem: ClassVar[str] = "mismatch"
