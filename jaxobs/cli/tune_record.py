"""Cases on a recorded signal: the search on one block, the comparison on another one."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse
from jaxobs._observe import observe
from jaxobs.cli.tune_config import CaseConfig
from jaxobs.datasets import shank_walk
from jaxobs.demo.walk import LAST, TRAIN, resampled, rms, stride
from jaxobs.observers import DiscreteTracker
from jaxobs.tuning.objectives import Innovation, Recorded

GRID = np.geomspace(20.0, 400.0, 60)  # 1/s: rates of the trackers that a grid alone finds
TRACKERS = tuple((n, q) for n in (2, 3, 4) for q in (0, 1, 2))


@dataclasses.dataclass(frozen=True)
class RecordRow:
    """RMSE of one estimate on the block, its 95 % interval, and the same of rmse / (that of the first) - 1."""

    observer: str
    state: int
    rmse: float
    rmse_low: float
    rmse_high: float
    change: float
    change_low: float
    change_high: float
    floor: float | None = None


@dataclasses.dataclass(frozen=True)
class RecordComparison:
    """The rows, first observer first; `block` are the samples of the comparison, `stride` those of a resampled piece."""

    rows: tuple[RecordRow, ...]
    block: tuple[int, int]
    stride: int

    def row(self, observer: str, state: int | None = None) -> RecordRow:
        """The row of this observer."""
        return next(one for one in self.rows if one.observer == observer)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return dataclasses.asdict(self)

    def __str__(self) -> str:
        width = max(len(row.observer) for row in self.rows)
        lines = [f"{'observer':{width}}    RMSE            [95 %]  change          [95 %]"]
        for i, row in enumerate(self.rows):
            numbers = f"{row.rmse:.4f}  {f'[{row.rmse_low:.4f}, {row.rmse_high:.4f}]':>16}"
            change = (
                f"{100 * row.change:+.1f} %  {f'[{100 * row.change_low:+.1f}, {100 * row.change_high:+.1f}]':>14}" if i else ""
            )
            lines.append(f"{row.observer:{width}}  {numbers}  {change}".rstrip())
        first, last = self.block
        words = f"RMSE of x{self.rows[0].state} on the samples {first} to {last - 1}, which no search has seen; [95 %] by"
        return "\n".join([*lines, f"{words} circular blocks of {self.stride} samples, a stride, the same in every row."])


class RecordedCase:
    """The record of a config: its loss on the training block, its check on the other one."""

    def __init__(self, config: CaseConfig):
        assert config.record is not None
        self.asked, self.kind = config.record, config.objective.kind
        walk = shank_walk()
        self.ts, self.y, self.truth = walk.ts, walk.angle, walk.rate
        blocks = {"train": self.asked.train or (TRAIN.start, TRAIN.stop), "check": self.asked.check or (LAST.start, LAST.stop)}
        for name, block in blocks.items():
            if len(block) != 2 or not 0 <= block[0] < block[1] <= len(self.ts):
                expected = f"(start, stop) with 0 <= start < stop <= {len(self.ts)}"
                raise refuse("config", f"record.{name}", list(block), expected, "They are numbers of samples.")
        self.train, self.last = blocks["train"], blocks["check"]
        if self.train[1] > self.last[0] and self.last[1] > self.train[0]:
            fix = "The comparison is on samples that the search has not seen."
            raise refuse("config", "record.check", list(self.last), f"a block apart from {list(self.train)}", fix)
        self.state = self.asked.state
        self.dt = float((self.ts[-1] - self.ts[0]) / (len(self.ts) - 1))

    def loss(self) -> Any:
        """The objective on the training block."""
        stop = self.train[1]
        fields = {"ts": self.ts[:stop], "ys": self.y[:stop], "blocks": (self.train,)}

        def on(observer: Any, key: Any = None) -> Any:
            if self.kind == "innovation":
                return Innovation(**fields, xhat0=self.start(observer))(observer)
            more = {"reference": self.truth[:stop], "states": (self.state - 1,)}
            return Recorded(**fields, **more, xhat0=self.start(observer))(observer)

        return on

    def start(self, observer: Any) -> Any:
        """At the first sample, at rest."""
        return jnp.zeros(observer.n).at[0].set(float(self.y[0]))

    def estimate(self, observer: Any) -> np.ndarray:
        """The state in question, over the whole record."""
        return np.asarray(observe(observer, self.ts, self.y, xhat0=self.start(observer)).xhat[:, self.state - 1])

    def check(self, observers: Mapping[str, Any]) -> RecordComparison:
        """These observers, and the trackers that a grid of rates finds on the training block."""
        first, last = self.last
        estimates = {name: self.estimate(observer) for name, observer in observers.items()} | self.grids()
        errors = np.stack([one[first:last] - self.truth[first:last] for one in estimates.values()], axis=1)
        block = stride(self.truth[slice(*self.train)])
        drawn = resampled(errors, block)
        rows = []
        for i, name in enumerate(estimates):
            low, high = np.quantile(drawn[:, i], [0.025, 0.975])
            change = np.quantile(drawn[:, i] / drawn[:, 0] - 1, [0.025, 0.975])
            here, reference = rms(errors[:, i]), rms(errors[:, 0])
            numbers = (here, float(low), float(high), here / reference - 1, *map(float, change))
            rows.append(RecordRow(name, self.state, *numbers))
        return RecordComparison(tuple(rows), (first, last), block)

    def grids(self) -> dict[str, np.ndarray]:
        """The trackers, each with the rate that a grid finds best on the training block."""
        first, last = self.train
        best = {}
        for n, q in TRACKERS:
            for mu in GRID:
                estimate = self.estimate(DiscreteTracker(n, q, jnp.asarray(mu), jnp.asarray(self.dt)))
                error = rms((estimate - self.truth)[first:last])
                if error < best.get((n, q), (np.inf,))[0]:
                    best[n, q] = error, mu, estimate
        names = {(2, 0): "fading memory, n = 2"}
        return {
            f"grid: {names.get(at, f'tracker n = {at[0]}, q = {at[1]}')}, mu = {mu:.3g}": e for at, (_, mu, e) in best.items()
        }
