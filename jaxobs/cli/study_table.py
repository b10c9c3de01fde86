"""What a study found, for the screen: medians and quantiles over the seeds at the points of its axes, as plain data."""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

QUANTILES = (0.1, 0.5, 0.9)
WIDE = 8  # numbers of one run; a metric with more of them is left to the data set
AT_ONCE = 2**22  # lanes that are in memory together
PATHS = ("x", "xhat")  # trajectories


def summary(ds: Any, limit: int) -> dict[str, Any]:
    """axes: {name: size}; rows: at no more than `limit` points the runs, how many of them diverged, and of each metric the
    [10 %, 50 %, 90 %] quantiles of the rest; counts over all lanes; what is left out of the rows."""
    lanes = ds["diverged_at"]
    axes = {str(name): int(size) for name, size in lanes.sizes.items()}
    points = {name: size for name, size in axes.items() if name != "seed"}
    shown = _thinned(points, limit)
    sizes = {str(name): math.prod(ds[name].shape[len(axes) :]) for name in ds.data_vars if name not in ("diverged_at", *PATHS)}
    names = [name for name, size in sizes.items() if size <= WIDE]
    rows = [_row(ds, names, dict(zip(shown, at, strict=True))) for at in itertools.product(*shown.values())]
    diverged = missing = 0
    for block in _blocks(lanes):
        diverged, missing = diverged + int(np.isfinite(block).sum()), missing + int(np.isnan(block).sum())
    return {
        "axes": axes,
        "rows": rows,
        "lanes": lanes.size,
        "computed": lanes.size - missing,
        "diverged": diverged,
        "shown": {name: [len(chosen), points[name]] for name, chosen in shown.items() if len(chosen) < points[name]},
        "seeds_shown": min(axes.get("seed", 1), AT_ONCE),
        "units": {name: ds[name].attrs.get("units", "unknown") for name in names},
        "left_out": {name: size for name, size in sizes.items() if size > WIDE},
    }


def _row(ds: Any, names: list[str], at: dict[str, int]) -> dict[str, Any]:
    """One point of the axes."""
    here = ds[[*names, "diverged_at"]].isel(at)
    here = (here.isel(seed=slice(AT_ONCE)) if "seed" in here.dims else here.expand_dims("seed")).load()
    when = here["diverged_at"].values
    well = when == np.inf
    values = {}
    for name in names:
        array = here[name].transpose("seed", ...).values
        for place in np.ndindex(array.shape[1:]):
            label = f"{name}[{','.join(map(str, place))}]" if array[0].size > 1 else name
            values[label] = _quantiles(array[(well, *place)])
    return {
        "at": {name: _label(ds, name, i) for name, i in at.items()},
        "runs": int((~np.isnan(when)).sum()),
        "diverged": int(np.isfinite(when).sum()),
        "values": values,
    }


def _quantiles(runs: np.ndarray) -> list[float] | None:
    """Over the runs; between two of them on a straight line, unless one is infinite. None without any number."""
    runs = runs[~np.isnan(runs)]
    if runs.size == 0:
        return None
    return np.quantile(runs, QUANTILES, method="linear" if np.isfinite(runs).all() else "higher").tolist()


def _label(ds: Any, name: str, i: int) -> Any:
    return ds[name].values[i].item() if name in ds.coords else i


def _thinned(points: dict[str, int], limit: int) -> dict[str, list[int]]:
    """Which members of each axis are shown, the ends and evenly between: the longest axes give way first."""
    counts = dict(points)
    while math.prod(counts.values()) > max(limit, 1):
        longest = max(counts, key=lambda name: counts[name])
        counts[longest] -= 1
    return {name: np.unique(np.linspace(0, points[name] - 1, counts[name]).round().astype(int)).tolist() for name in counts}


def _blocks(lanes: Any) -> Iterator[np.ndarray]:
    """The whole array, never more than AT_ONCE of it in memory."""
    split = next((i for i in range(len(lanes.shape)) if math.prod(lanes.shape[i + 1 :]) <= AT_ONCE), 0)
    if not lanes.shape:
        yield lanes.values
        return
    step = max(1, AT_ONCE // math.prod(lanes.shape[split + 1 :]))
    for lead in np.ndindex(lanes.shape[:split]):
        for start in range(0, lanes.shape[split], step):
            yield lanes[(*lead, slice(start, start + step))].values
