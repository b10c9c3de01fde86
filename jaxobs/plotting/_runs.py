"""What a picture of runs is drawn from: Trajectory, Estimate, a batch of them, or a data set that kept its trajectories."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from jaxobs._module import refuse


@dataclasses.dataclass(frozen=True, eq=False)
class Runs:
    """S runs of T samples; x is None where no truth is known, y, valid and innovation where they were not kept."""

    ts: Float[np.ndarray, " T"]
    x: Float[np.ndarray, "S T n"] | None
    xhat: Float[np.ndarray, "S T n"]
    y: Float[np.ndarray, "S T p"] | None = None
    valid: Bool[np.ndarray, "S T p"] | None = None
    innovation: Float[np.ndarray, "S T p"] | None = None

    @property
    def count(self) -> int:
        return self.xhat.shape[0]

    @property
    def n(self) -> int:
        return self.xhat.shape[2]

    @property
    def finite(self) -> Bool[np.ndarray, " S"]:
        """The runs whose estimates are all finite."""
        return np.all(np.isfinite(self.xhat), axis=(1, 2))

    def errors(self, owner: str) -> Float[np.ndarray, "S T n"]:
        """xhat - x."""
        if self.x is None:
            fix = "A record has no truth of its own: give x=, shape (T, n)."
            raise refuse(f"plotting.{owner}", "x", "None", "the true states", fix)
        return self.xhat - self.x


def is_dataset(value: Any) -> bool:
    """An xarray Dataset, told by what it has: only studies/ imports xarray."""
    return hasattr(value, "data_vars") and hasattr(value, "sizes")


def as_runs(owner: str, run: Any, x: Any = None) -> Runs:
    """The run, or the batch of runs along the leading axes, as NumPy arrays. x: the truth, where the run has none."""
    if is_dataset(run):
        return _of_dataset(owner, run)
    missing = [name for name in ("ts", "xhat") if not hasattr(run, name)]
    if missing or np.ndim(run.xhat) < 2:
        given = f"{type(run).__name__} without {missing[0]}" if missing else f"xhat of shape {np.shape(run.xhat)}"
        fix = "simulate, observe and differentiate return one; under jax.vmap they return a batch."
        raise refuse(f"plotting.{owner}", "run", given, "a Trajectory, an Estimate, or a data set with x and xhat", fix)
    xhat = np.asarray(run.xhat, float)
    steps, n = xhat.shape[-2:]
    ts = np.asarray(run.ts, float).reshape(-1, steps)
    if np.any(ts != ts[0]):
        raise refuse(f"plotting.{owner}", "run", "runs on several grids ts", "one grid", "Draw them one by one.")
    parts = {name: _stacked(getattr(run, name, None), steps) for name in ("y", "valid", "innovation")}
    truth = getattr(run, "x", None) if x is None else x
    if truth is not None and np.shape(truth)[-2:] != (steps, n):
        fix = "One row for each time of the run, one column for each state."
        raise refuse(f"plotting.{owner}", "x", f"shape {np.shape(truth)}", f"{(steps, n)}", fix)
    flat = xhat.reshape(-1, steps, n)
    whole = None if truth is None else np.broadcast_to(np.asarray(truth, float), xhat.shape).reshape(flat.shape)
    return Runs(ts[0], whole, flat, **parts)


def _stacked(array: Any, steps: int) -> Any:
    """(..., T, p) as (S, T, p); a signal (T,) has one column."""
    if array is None:
        return None
    values = np.asarray(array)
    values = values if values.dtype == bool else values.astype(float)
    return values.reshape(-1, steps, 1) if values.shape[-1] == steps and values.ndim == 1 else values.reshape(
        -1, *values.shape[-2:])  # fmt: skip


def _of_dataset(owner: str, ds: Any) -> Runs:
    if "xhat" not in ds.data_vars or "x" not in ds.data_vars:
        fix = "Keep them: jaxobs.study(..., save=1)."
        raise refuse(f"plotting.{owner}", "run", "a data set without x and xhat", "one that kept its trajectories", fix)
    others = [str(d) for d in ds["xhat"].dims if d not in ("seed", "time", "state") and ds.sizes[d] > 1]
    if others:
        one = ", ".join(f"{name}={ds[name].values[0]!r}" if name in ds.coords else f"{name}=0" for name in others)
        given = "a data set with the axes " + ", ".join(others)
        raise refuse(f"plotting.{owner}", "run", given, "no axis beside seed, time and state", f"Choose: ds.sel({one}).")
    arrays = {}
    for name in ("x", "xhat"):
        array = ds[name].transpose(..., "time", "state").values.astype(float)
        arrays[name] = array.reshape(-1, *array.shape[-2:])
    return Runs(np.asarray(ds["time"].values, float), **arrays)


def chosen(owner: str, field: str, states: Sequence[int] | int | None, n: int) -> list[int]:
    """Places of the states whose numbers, from 1, are given; all of them if none are."""
    if states is None:
        return list(range(n))
    numbers = [states] if isinstance(states, int | np.integer) else list(states)
    bad = [i for i in numbers if not isinstance(i, int | np.integer) or not 1 <= i <= n]
    if bad or not numbers:
        given = repr(bad[0]) if bad else "none"
        raise refuse(f"plotting.{owner}", field, given, f"numbers from 1 to {n}", "x1 is the first.")
    return [int(i) - 1 for i in numbers]


def labels(owner: str, names: Sequence[str] | None, n: int) -> list[str]:
    """What the axes of the states say: the names given, or x1, x2, ..."""
    if names is None:
        return [f"x{i + 1}" for i in range(n)]
    if isinstance(names, str) or len(names) != n:
        given = repr(names) if isinstance(names, str) else f"{len(names)} names"
        fix = 'With units, e.g. names=["angle [rad]", "rate [rad/s]"].'
        raise refuse(f"plotting.{owner}", "names", given, f"{n} names, one a state", fix)
    return [str(name) for name in names]
