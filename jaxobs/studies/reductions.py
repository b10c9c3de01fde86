"""Sums and means over an axis of a data set, always in the same order."""

import numpy as np
import xarray as xr

from jaxobs._module import refuse, require_instance


def tree_sum(array: xr.DataArray, dim: str, *, skipna: bool = False) -> xr.DataArray:
    """(v_0 + v_1) + (v_2 + v_3), ... level by level, an odd last one carried up: sums of neighbours in a fixed binary tree.

    The result does not depend on how the values were computed or loaded, to the last bit, and its rounding error grows with
    log2 of their number. NaN (a lane that diverged, or is not computed) makes the sum NaN; skipna=True leaves such lanes out,
    and `array.notnull().sum(dim)` counts the others. Everything else over an axis is xarray's own: `array.quantile(0.95,
    "seed")`, `(array > 1).sum("seed")`, `np.isfinite(ds.diverged_at).sum("seed")` for the lanes that diverged.
    """
    values = _values(array, dim)
    if skipna:
        values = np.where(np.isnan(values), values.dtype.type(0), values)
    while values.shape[0] > 1:
        pairs = values.shape[0] // 2 * 2
        values = np.concatenate([values[0:pairs:2] + values[1:pairs:2], values[pairs:]])
    return _without(array, dim, np.asarray(values[0]))


def tree_mean(array: xr.DataArray, dim: str, *, skipna: bool = False) -> xr.DataArray:
    """tree_sum divided by the number of values; with skipna=True by that of the values which are not NaN."""
    values = _values(array, dim)
    count = np.asarray(np.sum(~np.isnan(values), axis=0)) if skipna else np.full(values.shape[1:], len(values))
    with np.errstate(invalid="ignore", divide="ignore"):  # 0 / 0 is NaN: no lane has a value
        return tree_sum(array, dim, skipna=skipna) / _without(array, dim, count.astype(values.dtype))


def _values(array: xr.DataArray, dim: str) -> np.ndarray:
    """The numbers with the axis first."""
    require_instance("tree_sum", "array", array, xr.DataArray, "Take one variable: tree_sum(ds.rmse, 'seed').")
    if dim not in array.dims:
        raise refuse("tree_sum", "dim", repr(dim), "one of " + ", ".join(map(str, array.dims)), "Name an axis of the variable.")
    return np.moveaxis(array.to_numpy(), array.dims.index(dim), 0)


def _without(array: xr.DataArray, dim: str, values: np.ndarray) -> xr.DataArray:
    """These numbers on the other axes of the array."""
    like = array.isel({dim: 0}, drop=True)
    return like.copy(data=values)
