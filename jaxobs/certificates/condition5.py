"""Condition (5) of paper 000, and (44) for the q-integral observer: convergence from a Lipschitz constant."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates.base import AbstractCertificate


@dataclasses.dataclass(frozen=True)
class Condition5(AbstractCertificate):
    """With N = n + q, P = D P~ D / gamma, D = diag(gamma^i), Q = diag(q_i gamma^{2i}) of the chain Riccati equation, witnesses

        mu, nu > 0:   q_i > 0,   P > 0,   Q - mu P > 0,   nu I - P > 0,   4 rho^2 (P^-1)_NN nu < mu^2

    imply condition (5) (or (44)), and V = e'P^-1 e decays at least at the rate mu - 2 rho sqrt((P^-1)_NN nu).

    alphas (n + q,), gamma [1/s], lipschitz rho, n states, q integrators. Source: paper 000, theorem 1 and corollary 2.
    """

    alphas: tuple[float, ...]
    gamma: float
    lipschitz: float
    n: int
    q: int
    mu: float
    nu: float
    theorem: ClassVar[str] = "condition5"
