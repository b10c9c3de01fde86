"""Records that carry their own times: pandas Series and DataFrames, xarray DataArrays; known by what they offer."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from jaxobs._module import refuse


@runtime_checkable
class Indexed(Protocol):
    """A pandas Series, or DataFrame with one column a signal: the index is the time."""

    @property
    def index(self) -> Any: ...

    def to_numpy(self) -> Any: ...


@runtime_checkable
class Labelled(Protocol):
    """An xarray DataArray: the coordinate of its first dimension is the time."""

    @property
    def dims(self) -> Any: ...

    @property
    def coords(self) -> Any: ...

    def to_numpy(self) -> Any: ...


Series = Indexed | Labelled


def record(owner: str, field: str, ts: Any, given: Any) -> tuple[Any, Any]:
    """(times, numbers) of (ts, given); or of a record alone in the place of ts, where `given` is None.

    Beside `given`, a Series ts is a column of times: its own index is not looked at, but has to be that of `given`.
    """
    if given is not None:
        return ts.to_numpy() if isinstance(ts, Series) else ts, values(owner, field, given, ts)
    if isinstance(ts, Series):
        return times(owner, ts), ts.to_numpy()
    fix = "Give the samples, or a pandas Series, or an xarray DataArray, in the place of ts."
    raise refuse(owner, field, "None", "one sample for each time", fix)


def values(owner: str, field: str, given: Any, beside: Any) -> Any:
    """The numbers of a record; anything else as it is. ValueError if it is labelled otherwise than the record beside it."""
    if not isinstance(given, Series):
        return given
    if isinstance(beside, Series) and not _alike(_labels(given), _labels(beside)):
        fix = "Put both on one index first, e.g. by reindex."
        raise refuse(owner, field, "a record with another index than that of ts", "the same index", fix)
    return given.to_numpy()


def times(owner: str, series: Series) -> np.ndarray:
    """(T,): the times of a record in seconds, dates and durations from the first one on. ValueError if it has none."""
    found = _labels(series)
    if found is None or _counts_rows(series):
        fix = "Set it: series.index = seconds, or DataArray(values, dims='time', coords={'time': ts}); or give ts and samples."
        raise refuse(owner, "ts", "a record without times: its rows are only counted", "an index of times", fix)
    if found.dtype.kind in "mM":
        found = (found - found[:1]) / np.timedelta64(1, "s")
    if found.dtype.kind not in "iuf":
        fix = "Set it: series.index = seconds, or pandas.to_datetime(...)."
        raise refuse(owner, "ts", f"an index of {found.dtype}", "seconds, dates or durations", fix)
    return found.astype(np.float64)


def _labels(series: Series) -> np.ndarray | None:
    """What the rows are called; None for a DataArray that has no coordinate along them."""
    if isinstance(series, Indexed):
        index = series.index
        return np.asarray(index.tz_convert(None) if getattr(index, "tz", None) is not None else index)
    along = series.dims[0] if series.dims else None
    return np.asarray(series.coords[along]) if along in series.coords else None


def _alike(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    return one is other if one is None or other is None else np.array_equal(one, other)


def _counts_rows(series: Series) -> bool:
    """Whether the index is the one that pandas makes by itself: 0, 1, 2, ... without a name."""
    index = getattr(series, "index", None)
    return getattr(index, "start", None) == 0 and getattr(index, "step", None) == 1 and getattr(index, "name", "") is None
