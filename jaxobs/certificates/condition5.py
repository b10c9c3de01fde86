"""Condition (5) of paper 000, and (44) for the q-integral observer: convergence from a Lipschitz constant."""

import dataclasses
import math
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import exact
from jaxobs.certificates.base import AbstractCertificate, Verdict

LARGEST = 10  # n + q: beyond it no gain is of practical size, and a hostile file could keep the check busy


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

    @property
    def claim(self) -> str:
        kind = "high-gain" if self.q == 0 else f"{self.q}-integral high-gain"
        return (
            f"the error of the {kind} observer with n = {self.n}, gamma = {self.gamma!r}, alphas = {self.alphas!r} "
            f"decays exponentially for every phi with Lipschitz constant {self.lipschitz!r}"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (
            "the plant is x_i' = x_{i+1}, x_n' = phi(x, u), y = x_1, and the observer has the same phi",
            f"phi is Lipschitz in x with the stored constant {self.lipschitz!r}, for every u that occurs (given, not proved)",
            "continuous time, without measurement noise; gains alphas_i gamma^i in real arithmetic",
        )

    def verify(self) -> Verdict:
        problem = self._malformed()
        if problem:
            return Verdict(False, {}, f"not certified: {problem}")
        alphas = [Fraction(a) for a in self.alphas]
        gamma, rho, mu, nu = (Fraction(x) for x in (self.gamma, self.lipschitz, self.mu, self.nu))
        size = len(alphas)
        weights = exact.chain_weights(alphas)
        p = [[gamma ** (i + j + 1) * x for j, x in enumerate(row)] for i, row in enumerate(exact.chain_riccati(alphas))]
        q = [gamma ** (2 * i + 2) * w for i, w in enumerate(weights)]
        for i, weight in enumerate(weights, start=1):
            if weight <= 0:
                return Verdict(False, {}, f"not certified: condition (10) fails, q_{i} = {_float(weight):.6g} is not positive")
        if not (exact.riccati_residual_is_zero(p, q) and exact.is_positive_definite(p)):
            return Verdict(False, {}, "not certified: P is not a positive definite solution of the Riccati equation")
        if not exact.is_positive_definite(exact.combine(Fraction(1), exact.diagonal(q), -mu, p)):
            return Verdict(False, {}, f"not certified: Q - mu P > 0 fails for mu = {self.mu:.9g}")
        if not exact.is_positive_definite(exact.combine(nu, exact.diagonal([Fraction(1)] * size), Fraction(-1), p)):
            return Verdict(False, {}, f"not certified: nu I - P > 0 fails for nu = {self.nu:.9g}")
        load = 4 * rho**2 * exact.inverse_corner(p) * nu
        # Square roots are for reading; the decision compares squares.
        margins = {"decay_rate_of_V": self.mu - _sqrt(load), "largest_lipschitz": _sqrt((rho * mu) ** 2 / load)}
        if not load < mu**2:
            return Verdict(False, margins, "not certified: 4 rho^2 (P^-1)_NN nu < mu^2 fails, the margin is not positive")
        name = "(5)" if self.q == 0 else "(44)"
        return Verdict(True, margins, f"condition {name} holds for the stored gain and Lipschitz constant, in exact arithmetic")

    def _malformed(self) -> str | None:
        if not (len(self.alphas) == self.n + self.q and self.n >= 1 and self.q >= 0):
            return f"{len(self.alphas)} alphas for n = {self.n}, q = {self.q}"
        if len(self.alphas) > LARGEST:
            return f"n + q = {len(self.alphas)} is more than {LARGEST}"
        if not all(math.isfinite(x) for x in (*self.alphas, self.gamma, self.lipschitz, self.mu, self.nu)):
            return "a stored number is not finite"
        if not (self.gamma > 0 and self.lipschitz > 0 and self.mu > 0 and self.nu > 0):
            return "gamma, the Lipschitz constant, mu and nu must be positive"
        return None


def _float(x: Fraction) -> float:
    """The nearest float, infinite beyond the largest one."""
    try:
        return float(x)
    except OverflowError:
        return math.inf if x > 0 else -math.inf


def _sqrt(x: Fraction) -> float:
    """The root of a positive rational of any size, as a float."""
    bits = (x.numerator.bit_length() - x.denominator.bit_length()) // 2
    return _float(Fraction(math.sqrt(x / Fraction(4) ** bits)) * Fraction(2) ** bits)
