"""Observers of the Euler model, for every phi with a norm-bounded slope: (62), (63) and their augmented forms."""

import dataclasses
import math
from fractions import Fraction
from typing import ClassVar

from jaxobs.certificates import _chain, exact
from jaxobs.certificates.base import AbstractCertificate, FloatMatrix, Verdict


@dataclasses.dataclass(frozen=True)
class EulerModel(AbstractCertificate):
    """For the Euler model x+ = x + dt (A x + B phi(x, u)), B dphi/dx = M F N with |F| <= 1, and xhat+ = the same + L (y -
    xhat_1): with K = I + dt A - L C,

        X > 0   and   [factor^2 X - epsilon N'N,  -K'X,  0;  -X K,  X,  -dt X M;  0,  -dt M'X,  epsilon I] > 0

    imply |e_k| <= sqrt(cond X) factor^k |e_0|, the error tending to zero also for factor = 1. With L = X^-1 C' and factor = 1
    this is (62); with X = P(gamma)^-1 / dt, epsilon = tau, L = dt P(gamma) C' it is (63) (paper 000). It says nothing about
    the plant that the Euler model replaces. Behind q integrators A and C are the augmented ones, M has q zero rows above, N q
    zero columns to the left.

    n states, q integrators, gain L (n + q,), dt [s], left M (n, r), right N (s, n), x (n + q, n + q), epsilon > 0, factor in
    ]0, 1]. origin: where the slopes come from, a sentence. Source: paper 000, (51)-(63), theorem 2.
    """

    n: int
    q: int
    gain: tuple[float, ...]
    dt: float
    left: FloatMatrix
    right: FloatMatrix
    x: FloatMatrix
    epsilon: float
    factor: float = 1.0
    origin: str = "given"
    theorem: ClassVar[str] = "euler-model"

    @property
    def claim(self) -> str:
        kind = "" if self.q == 0 else f" behind {self.q} integrators"
        how = "tends to zero" if self.factor == 1 else f"decays at least like {self.factor!r}^k"
        return (
            f"the error of the observer of the Euler model with n = {self.n}, dt = {self.dt!r} and L = {self.gain!r}{kind} "
            f"{how}, for every phi with B dphi/dx = M F N, |F| <= 1, M = {self.left!r}, N = {self.right!r}"
        )

    @property
    def assumptions(self) -> tuple[str, ...]:
        return (
            "the plant is the Euler model x+ = x + dt (A x + B phi(x, u)) of a chain, not the chain itself; y = x_1",
            "the observer has the same phi",
            f"the slopes of phi stay within the stored bound for all x and all u that occur (bounds: {self.origin!r})",
            "without measurement noise; gains in real arithmetic",
        )

    def verify(self) -> Verdict:
        size = self.n + self.q
        shapes = {"M": (self.left, self.n, None), "N": (self.right, None, self.n), "X": (self.x, size, size)}
        problem = _chain.malformed(self.n, self.q, self.gain, shapes)
        if problem is None and not (
            all(math.isfinite(v) and v > 0 for v in (self.dt, self.epsilon, self.factor)) and self.factor <= 1
        ):
            problem = "dt and epsilon must be positive, the factor in ]0, 1]"
        if problem:
            return Verdict(False, {}, f"not certified: {problem}")
        x, dt, epsilon = exact.matrix(self.x), Fraction(self.dt), Fraction(self.epsilon)
        if not exact.is_positive_definite(x):
            return Verdict(False, {}, "not certified: X > 0 fails")
        m, n = _chain.augmented(self.left, self.right, self.q)
        k = exact.combine(dt, _chain.shift(size), Fraction(-1), _chain.injection(self.gain))
        xk = exact.scale(Fraction(-1), exact.product(x, exact.add(exact.identity(size), k)))
        xm = exact.scale(-dt, exact.product(x, m))
        nn = exact.product(exact.transpose(n), n)
        first = exact.combine(Fraction(self.factor) ** 2, x, -epsilon, nn)
        r = len(m[0])
        whole = exact.block(
            [
                [first, exact.transpose(xk), exact.zeros(size, r)],
                [xk, x, xm],
                [exact.zeros(r, size), exact.transpose(xm), exact.scale(epsilon, exact.identity(r))],
            ]
        )
        try:
            exact.require_short(exact.work(exact.bits(whole), len(whole)))
        except exact.TooLong as error:
            return Verdict(False, {}, f"not certified: {error}")
        if not exact.is_positive_definite(whole):
            return Verdict(False, {}, "not certified: the matrix of (62) is not positive definite")
        return Verdict(True, {"decay_factor": self.factor}, "inequality (62) holds, in exact arithmetic")
