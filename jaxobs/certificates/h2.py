"""A guaranteed noise level beside a decay rate, each by a Lyapunov matrix of its own."""

import dataclasses
from typing import ClassVar

from jaxobs.certificates._model import AbstractUncertainError
from jaxobs.certificates.base import FloatMatrix


@dataclasses.dataclass(frozen=True)
class H2Level(AbstractUncertainError):
    """For e' = F(rho) e + process w - G(rho) noise v, F(rho) = a + sum_k rho_k b_k (c_k - inner_k output) - gain output,
    G(rho) = gain + b diag(rho) inner, w and v white of unit intensity: P proves the rate as in Corners, and, at all corners,

        Q > 0,  F'Q + Q F + E'E < 0,   tr(process'Q process) + tr(noise'G'Q G noise) <= level          or
        X > 0,  F X + X F' + process process' + G noise noise'G' < 0,   tr(E X E') <= level

    prove that the mean over time of |E e|^2 is at most `level`, for every rho(t) within the bounds.

    Proof. By Ito's rule d E[e'Q e]/dt <= level - E|E e|^2 along every path, however rho depends on e: the energy form, with Q.
    The covariance form, with X, needs a rho(t) that does not depend on the noise, since it takes F E[e e'] for E[F e e']: an
    assumption of the certificate. level is a variance: its root is the H2 norm.

    weight E (s, n), process (n, m), noise (p, k), q or x (n, n), the other (); taus, taus_q (r,): multipliers for P and Q in
    place of corners, as in Corners; else as there. Source: Boyd et al., Linear Matrix Inequalities in System and Control
    Theory, 1994, sections 6.2.1 and 6.2.2.
    """

    p: FloatMatrix
    rate: float
    weight: FloatMatrix
    process: FloatMatrix
    noise: FloatMatrix
    level: float
    q: FloatMatrix = ()
    x: FloatMatrix = ()
    taus_q: tuple[float, ...] = ()
    theorem: ClassVar[str] = "h2"
