"""Nothing could be proved."""

from typing import Any


class Infeasible(ValueError):
    """No certificate of this kind exists for what was asked. It does not say that the observer is unstable.

    reason: a sentence; margin: how far from certified, negative unless floats are at their limits; change: what to try;
    smallest_gamma [1/s]: the infimum of the gains that would be certified, None where no gain is. best: the largest feasible
    value of the quantity asked for (a rate, a period), None where there is none; tried: the relaxations attempted, in order.
    certificate: the exact proof that what was asked for does not exist (NoGain, Undetectability), None where there is no proof.
    """

    def __init__(
        self,
        reason: str,
        margin: float,
        change: str,
        smallest_gamma: float | None = None,
        best: float | None = None,
        tried: tuple[str, ...] = (),
        certificate: Any = None,
    ):
        super().__init__(reason, margin, change, smallest_gamma, best, tried, certificate)  # it is rebuilt from its args
        self.reason, self.margin, self.change, self.smallest_gamma = reason, margin, change, smallest_gamma
        self.best, self.tried, self.certificate = best, tried, certificate

    def __str__(self) -> str:
        tried = f" Tried: {'; '.join(self.tried)}." if self.tried else ""
        return f"no certificate of this kind: {self.reason} (margin {self.margin:.6g}).{tried} {self.change}"
