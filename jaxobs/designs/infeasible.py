"""Nothing could be proved."""


class Infeasible(ValueError):
    """No certificate of this kind exists for what was asked. It does not say that the observer is unstable.

    reason: a sentence; margin: how far from certified (negative); change: what to try.
    """

    def __init__(self, reason: str, margin: float, change: str):
        super().__init__(f"no certificate of this kind: {reason} (margin {margin:.6g}). {change}")
        self.reason, self.margin, self.change = reason, margin, change
