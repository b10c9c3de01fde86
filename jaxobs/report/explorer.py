"""A study as the numbers that a page lets its reader choose from: quantiles over the seeds on all axes."""

import math
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_hex

from jaxobs.plotting._datasets import Table as Values
from jaxobs.plotting._datasets import labels_of, numbers, table
from jaxobs.plotting.style import CYCLE, ORANGE, SEQUENTIAL
from jaxobs.report.charts import DASH, LAYOUT, SYMBOL
from jaxobs.report.page import Chart, Table, as_json

POINTS = 4000  # of the grid; longer axes are thinned evenly
AT_ONCE = 2**22  # numbers that are read together
QUANTILES = (0.05, 0.5, 0.95)
PATHS = ("x", "xhat", "diverged_at")
ROWS = 40  # of the table
WIDE = 16  # numbers of one run; a metric with more of them is left to the data set


class Explorer(NamedTuple):
    """The chart; a table of its points; sentences on what was left out; the runs that were computed, and that diverged."""

    chart: Chart
    points: Table
    notes: list[str]
    computed: int
    diverged: int


def explorer(ds: Any) -> Explorer:
    """What a page shows of the data set of a study."""
    shown, notes = thinned(ds)
    metrics: list[dict[str, Any]] = []
    for name in map(str, shown.data_vars):
        if name in PATHS:
            continue
        inner = [size for dim, size in shown[name].sizes.items() if dim in ("state", "output", "lag")]
        if len(inner) > 1 or math.prod(inner) > WIDE or {*shown[name].dims} - {*_lanes(shown), "state", "output", "lag"}:
            notes.append(f"{name} has many numbers a run and is left to the data set.")
            continue
        found = table(shown, "report", name)
        metrics.append(_metric(name, found))
        if endless := int(np.isinf(found.values).sum()):
            notes.append(f"{endless} of {found.values.size} values of {name} are infinite; an infinite quantile is a gap.")
    axes = _axes(shown)
    metrics.sort(key=lambda one: one["name"] != "rmse")
    across, lines = _first_view(axes)
    scale = [[k / 8, to_hex(mpl.colormaps[SEQUENTIAL](k / 8))] for k in range(9)]
    data = {
        "axes": axes, "metrics": metrics, "seeds": int(shown.sizes.get("seed", 1)), "across": across, "lines": lines,
        "colours": CYCLE, "dashes": DASH, "symbols": SYMBOL, "scale": scale, "mark": ORANGE, "layout": LAYOUT,
    }  # fmt: skip
    seeds = data["seeds"]
    words = f"Median over {seeds} seeds, with the band of 5 to 95 % of them." if seeds > 1 else "One run a point."
    chart = Chart(as_json(data), words + " The selectors choose what is shown.", kind="study")
    points, total = _medians(data), math.prod(len(axis["labels"]) for axis in axes)
    if total > ROWS:
        notes.append(f"The table has {ROWS} of {total} points, evenly chosen.")
    when = ds["diverged_at"].values  # of all runs, shown or not
    return Explorer(chart, points, notes, int((~np.isnan(when)).sum()), int(np.isfinite(when).sum()))


def _medians(data: dict[str, Any]) -> Table:
    """No more than ROWS points of the study, with the median and the band of each metric."""
    axes, several = data["axes"], data["seeds"] > 1
    sizes = [len(axis["labels"]) for axis in axes]
    points = list(np.ndindex(*sizes))
    few = np.unique(np.linspace(0, len(points) - 1, min(len(points), ROWS)).round().astype(int))
    columns = [(one, k) for one in data["metrics"] for k in range(len(one["parts"]))]
    header = [axis["name"] for axis in axes] or [""]
    header += [" of ".join(filter(None, [one["label"], one["parts"][k]])) + one["units"] for one, k in columns]
    rows = []
    for at in few.tolist():
        row = [axis["labels"][i] for axis, i in zip(axes, points[at], strict=True)] or ["all"]
        for one, k in columns:
            low, middle, high = (quantile[at * len(one["parts"]) + k] for quantile in one["quantiles"])
            band = f" [{low:.3g}, {high:.3g}]" if several and middle is not None else ""
            row.append("none" if middle is None else f"{middle:.4g}{band}")
        rows.append(row)
    return header, rows


def thinned(ds: Any) -> tuple[Any, list[str]]:
    """No more points and seeds than a page can hold, evenly along the axes; and what that leaves out."""
    notes, cut = [], {}
    sizes = {name: size for name, size in _lanes(ds).items() if name != "seed"}
    counts = dict(sizes)
    while math.prod(counts.values()) > POINTS:
        longest = max(counts, key=lambda name: counts[name])
        counts[longest] -= 1
    for name, count in counts.items():
        if count < sizes[name]:
            cut[name] = np.unique(np.linspace(0, sizes[name] - 1, count).round().astype(int))
            notes.append(f"Of {sizes[name]} values of {name} {len(cut[name])} are shown.")
    seeds = int(ds.sizes.get("seed", 1))
    if (most := max(2, AT_ONCE // max(1, math.prod(counts.values())))) < seeds:
        cut["seed"] = slice(most)
        notes.append(f"Of {seeds} seeds the first {most} are used.")
    kept = [name for name in ds.data_vars if name not in PATHS[:2] and "time" not in ds[name].dims]
    kept = [name for name in kept if ds[name].dtype.kind in "fiub"]
    return ds[kept].isel(cut).load(), notes


def _lanes(ds: Any) -> dict[str, int]:
    """The axes of the lanes, with the seed."""
    return {str(name): int(size) for name, size in ds["diverged_at"].sizes.items()}


def _axes(ds: Any) -> list[dict[str, Any]]:
    """Those with several members: name, labels, and values where they are numbers."""
    found = []
    for name, size in _lanes(ds).items():
        if name != "seed" and size > 1:
            values = numbers(ds, name)
            given = None if values is None else values.tolist()
            found.append({"name": name, "labels": labels_of(ds, name), "values": given})
    return found


def _first_view(axes: list[dict[str, Any]]) -> tuple[int, int]:
    """What is drawn along, and what makes the lines: the longest axis of numbers, then the one before it or else after it."""
    if not axes:
        return -1, -1
    across = max(range(len(axes)), key=lambda i: (axes[i]["values"] is not None, len(axes[i]["labels"]), i))
    others = [i for i in range(len(axes)) if i != across]
    return across, others[max(0, len([i for i in others if i < across]) - 1)] if others else -1


def _metric(name: str, found: Values) -> dict[str, Any]:
    units = {"x": "", "y": "", "": "", "1": ""}.get(found.units, f" [{found.units}]")
    flat = [[_short(v) for v in quantile.reshape(-1)] for quantile in found.quantiles(*QUANTILES)]
    label = {"rmse": "RMSE"}.get(name, name.replace("_", " "))
    return {"name": name, "label": label, "parts": list(found.words), "units": units, "quantiles": flat}


def _short(value: float) -> float | None:
    """Five digits are more than a screen shows."""
    return float(f"{value:.5g}") if math.isfinite(value) else None
