"""Studies as arrays: a metric by the axes it was computed over, without the lanes that diverged."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.plotting._runs import is_dataset

INNER = ("state", "output", "lag")  # axes of one run's metric


@dataclasses.dataclass(frozen=True, eq=False)
class Table:
    """values (*axes, components, seeds), NaN where a lane diverged or is not computed; diverged (*axes,): how many did.

    axes: the names; words: of the components ("x1", ... or ""); units, as the study has them. Infinite values stay: a run
    that never settles is worse than all that do.
    """

    values: np.ndarray
    axes: tuple[str, ...]
    words: tuple[str, ...]
    units: str
    diverged: np.ndarray
    seeds: int

    def quantiles(self, *shares: float) -> np.ndarray:
        """(shares, *axes, components), over the seeds that have a number; NaN where none has."""
        empty = np.all(np.isnan(self.values), axis=-1)
        filled = np.where(empty[..., None], 0.0, self.values)
        with np.errstate(invalid="ignore"):  # between two infinities nothing is interpolated
            found = np.nanquantile(filled, shares, axis=-1)
        found = np.where(np.isnan(found), np.nanquantile(filled, shares, axis=-1, method="higher"), found)
        return np.where(empty, np.nan, found)

    @property
    def left_out(self) -> str:
        """What a picture does not show of the runs, in words; nothing where it shows all."""
        gone, endless = int(self.diverged.sum()), int(np.isinf(self.values).sum())
        words = [f"{gone} of {self.values[..., 0, :].size} runs diverged"] if gone else []
        return "; ".join([*words, *([f"{endless} of {self.values.size} values are infinite"] if endless else [])])


def points(ds: Any, owner: str, variable: str, without: tuple[str, ...]) -> list[str]:
    """The axes of a variable that a study ran over, those of one member left out."""
    if not is_dataset(ds):
        fix = "jaxobs.study returns one; jaxobs.studies.open_study opens a stored one."
        raise refuse(f"plotting.{owner}", "ds", type(ds).__name__, "the data set of a study", fix)
    if variable not in ds.data_vars:
        known = ", ".join(str(name) for name in ds.data_vars)
        fix = "Ask the study for it: metrics={...}, or save= for x and xhat."
        raise refuse(f"plotting.{owner}", "metric", repr(variable), f"one of {known}", fix)
    return [str(name) for name in ds[variable].dims if name not in without and ds.sizes[name] > 1]


def table(ds: Any, owner: str, metric: str, keep: tuple[str, ...] = ()) -> Table:
    """The metric on the axes of the study that have several members, and on `keep`, which may have one."""
    axes = points(ds, owner, metric, ("seed", *INNER))
    inner = [name for name in INNER if name in ds[metric].dims]
    others = [str(name) for name in ds[metric].dims if name not in ("seed", *inner, *axes, *keep)]
    if len(inner) > 1 or any(ds.sizes[name] > 1 for name in others) or "time" in ds[metric].dims:
        fix = "Reduce it first, e.g. with ds.isel(lag=0)."
        raise refuse(f"plotting.{owner}", "metric", f"{metric} on {ds[metric].dims}", "one number a state or an output", fix)
    axes += [name for name in keep if name in ds[metric].dims and name not in axes]
    drop = dict.fromkeys(others, 0)
    here, lanes = ds[metric].isel(drop), ds["diverged_at"].isel({k: v for k, v in drop.items() if k in ds["diverged_at"].dims})
    if "seed" not in here.dims:
        here, lanes = here.expand_dims("seed"), lanes.expand_dims("seed")
    values = here.transpose(*axes, *inner, "seed").values.astype(float)
    values = values if inner else values[..., None, :]
    when = lanes.transpose(*axes, "seed").values
    away = np.isfinite(when)
    letter = {"state": "x", "output": "y", "lag": "lag "}.get(inner[0], "") if inner else ""
    words = tuple(f"{letter}{i + 1}" for i in range(values.shape[-2])) if inner else ("",)
    values = np.where(away[..., None, :], np.nan, values)
    units = str(ds[metric].attrs.get("units", ""))
    return Table(values, tuple(axes), words, units, np.sum(away, axis=-1), values.shape[-1])


def numbers(ds: Any, name: str) -> np.ndarray | None:
    """The values along an axis, where they are numbers and not mere counts."""
    if name not in ds.coords or f"{name}_value" in ds.coords:
        return None
    values = np.asarray(ds[name].values)
    return values.astype(float) if np.issubdtype(values.dtype, np.number) else None


def labels_of(ds: Any, name: str) -> list[str]:
    """The members of an axis, no two alike: numbers in four digits or as many as tell them apart, vectors, names."""
    count = int(ds.sizes[name])
    for digits in (4, 6, 9, 17):
        found = [_label(ds, name, i, digits) for i in range(count)]
        if len(set(found)) == count:
            return found
    return [f"{label} #{i}" for i, label in enumerate(_label(ds, name, i, 4) for i in range(count))]


def _label(ds: Any, name: str, i: int, digits: int) -> str:
    vectors = f"{name}_value"
    if vectors in ds.coords and ds[vectors].ndim == 2:
        return "(" + ", ".join(f"{v:.{digits - 1}g}" for v in ds[vectors].values[i] if not np.isnan(v)) + ")"
    if name not in ds.coords:
        return str(i)
    value = ds[name].values[i]
    return f"{value:.{digits}g}" if isinstance(value, int | float | np.number) else str(value)


def spelled(ds: Any, name: str) -> bool:
    """Whether members go by a name of their own, which needs no "axis = " before it."""
    return name == "observer" or (name in ds.coords and ds[name].dtype.kind in "UO")


def unit(table: Table, metric: str, word: str) -> str:
    """What stands on an axis: the metric, of what, in which units ("x" are those of the state)."""
    units = {"x": "", "y": "", "": "", "1": ""}.get(table.units, f" [{table.units}]")
    names = {"rmse": "RMSE", "settling_time": "settling time", "noise_gain": "noise gain", "peak": "peak error"}
    return " of ".join(filter(None, [names.get(metric, metric.replace("_", " ")), word])) + units
