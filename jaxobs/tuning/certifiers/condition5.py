"""Condition (5) of paper 000, or (44): a Lipschitz constant is all that is known, and the metric is that of the gain."""

import dataclasses
from fractions import Fraction
from typing import Any

import jax.numpy as jnp

from jaxobs import linalg
from jaxobs._module import require_instance
from jaxobs.certificates import Condition5, exact
from jaxobs.designs import Infeasible, riccati
from jaxobs.designs._chain_gain import require_positive
from jaxobs.observers import HighGain, IntegralHighGain
from jaxobs.tuning.certifiers.base import AbstractCertifier, Start


@dataclasses.dataclass(frozen=True, eq=False)
class ByCondition5(AbstractCertifier):
    """Decay at `rate` by lambda_min(P^-1/2 Q P^-1/2) - 2 rho sqrt((P^-1)_NN lambda_max(P)) > 2 rate, V = e'P^-1 e.

    lipschitz: rho of phi. For HighGain and IntegralHighGain, through alphas and gamma. No witnesses are searched: P is the
    solution of the chain Riccati equation. Source: paper 000, theorem 1, corollary 2.
    """

    lipschitz: float

    def __post_init__(self):
        require_positive("ByCondition5", "lipschitz", self.lipschitz, "It bounds the slope of phi.")

    def start(self, observer, rate):
        require_instance("ByCondition5", "observer", observer, HighGain | IntegralHighGain, "Other gains: Quadratic.")
        return Start((), (), float(self._rate(observer)))

    def barrier(self, observer: Any, fixed, free, rate):
        return -jnp.log((self._rate(observer) - rate) / observer.gamma)

    def prove(self, observer: Any, fixed, free, rate):
        plant, q = observer.model, getattr(observer, "q", 0)
        gamma = float(observer.gamma)
        certificate = riccati(plant, lipschitz=self.lipschitz, alphas=observer.alphas, gamma=gamma, q=q)[1]
        if not _decays(certificate, rate):
            reason = f"the witnesses of condition (5) prove less than the rate {rate:.6g} 1/s in exact arithmetic"
            raise Infeasible(reason, -0.0, "Ask for a little less.", best=float(self._rate(observer)))
        return certificate

    def _rate(self, observer):
        return linalg.condition5_rate(observer.alphas, observer.gamma, jnp.asarray(self.lipschitz, observer.gamma.dtype))


def _decays(certificate: Condition5, rate: float) -> bool:
    """mu - 2 rho sqrt((P^-1)_NN nu) >= 2 rate, in rational arithmetic; the certificate holds."""
    gamma = Fraction(certificate.gamma)
    alphas = [Fraction(a) * gamma**i for i, a in enumerate(certificate.alphas, start=1)]
    corner = exact.inverse_corner(exact.chain_riccati(alphas))
    left = Fraction(certificate.mu) - 2 * Fraction(rate)
    return left > 0 and left**2 >= 4 * Fraction(certificate.lipschitz) ** 2 * corner * Fraction(certificate.nu)
