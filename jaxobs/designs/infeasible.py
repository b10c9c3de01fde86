"""Nothing could be proved."""


class Infeasible(ValueError):
    """No certificate of this kind exists for what was asked. It does not say that the observer is unstable.

    reason: a sentence; margin: how far from certified, negative unless floats are at their limits; change: what to try;
    smallest_gamma [1/s]: the infimum of the gains that would be certified, None where no gain is.
    """

    def __init__(self, reason: str, margin: float, change: str, smallest_gamma: float | None = None):
        super().__init__(reason, margin, change, smallest_gamma)  # all of them: an exception is rebuilt from its args
        self.reason, self.margin, self.change, self.smallest_gamma = reason, margin, change, smallest_gamma

    def __str__(self) -> str:
        return f"no certificate of this kind: {self.reason} (margin {self.margin:.6g}). {self.change}"
