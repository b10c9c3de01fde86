"""What a search did, step by step."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclasses.dataclass(frozen=True, eq=False)
class History:
    """Of every start and step, before the step; `jaxobs.plotting.history` draws it.

    loss: the mean over the keys. barrier: the mean of -log of the eigenvalues that have to be positive, NaN where one is not,
    and without a certifier; weight (steps,): its weight. slope: the norm of the gradient of loss and barrier. good: whether the
    step counted; one that met a loss or gradient that is not finite, or left what is proved, was taken back. lane: the first
    key whose loss was not finite, -1 if there was none. theta: the parameters, by name, (starts, steps, ...). calls: how often
    loss and gradient were evaluated, over all starts and keys; seconds: of the search, compile included; compile_seconds: of
    that the first block, with its compilation.
    """

    loss: Float[np.ndarray, "starts steps"]
    barrier: Float[np.ndarray, "starts steps"]
    weight: Float[np.ndarray, " steps"]
    slope: Float[np.ndarray, "starts steps"]
    good: Bool[np.ndarray, "starts steps"]
    lane: Int[np.ndarray, "starts steps"]
    theta: dict[str, np.ndarray]
    calls: int
    seconds: float
    compile_seconds: float

    @property
    def best(self) -> Float[np.ndarray, "starts steps"]:
        """The least loss so far of each start, among the steps that counted."""
        return np.minimum.accumulate(np.where(self.good, self.loss, np.inf), axis=1)

    def refused(self) -> list[str]:
        """The steps that were taken back, a sentence for each start."""
        found = []
        for i, (good, lanes) in enumerate(zip(self.good, self.lane, strict=True)):
            if good.all():
                continue
            first = int(np.argmin(good))
            why = "left what is proved" if self.weight[first] > 0 else "its gradient was not finite"
            why = f"the loss of keys[{int(lanes[first])}] was not finite" if lanes[first] >= 0 else why
            found.append(f"start {i}: {int((~good).sum())} of {good.size} steps taken back, the first at step {first}: {why}")
        return found


def joined(parts: list[dict[str, Any]], **more: Any) -> History:
    """One History from those of the blocks of a search: arrays by field, along the steps."""
    last = {
        name: np.concatenate([part[name] for part in parts], axis=1) for name in parts[0] if name not in ("theta", "weight")
    }
    names = parts[0]["theta"]
    theta = {name: np.concatenate([part["theta"][name] for part in parts], axis=1) for name in names}
    return History(**last, theta=theta, weight=np.concatenate([part["weight"] for part in parts]), **more)
