"""Runs as xarray data sets: what `simulate`, `observe` and `differentiate` return, with named axes."""

from typing import Any

import numpy as np
import xarray as xr

from jaxobs._differentiate import Derivatives
from jaxobs._module import refuse, require_instance
from jaxobs._observe import Estimate
from jaxobs._simulate import Trajectory

DIMS = {
    "x": ("time", "state"),
    "xhat": ("time", "state"),
    "y": ("time", "output"),
    "valid": ("time", "output"),
    "innovation": ("time", "output"),
    "u": ("time", "input"),
}
FLAT = {"innovation": ("time",), "valid": ("time",), "xhat": ("time", "order")}  # of a single signal
LONG = {
    "x": "state",
    "xhat": "estimate",
    "y": "measurement",
    "valid": "whether the sample was there",
    "innovation": "measurement minus prediction",
    "u": "input",
    "diverged_at": "first time that is not finite",
}


def to_dataset(run: Trajectory | Estimate | Derivatives, *, time: Any = None, batch: tuple[str, ...] = ()) -> xr.Dataset:
    """The run with the axes `time` [s], `state`, `output` and `input` (`order` for derivatives), each counted from 0, as in
    the data sets of `jaxobs.study`.

    time: times to put in the place of run.ts, e.g. the dates of the record. batch: names of the leading axes that `vmap` added,
    all of the grid `ts` shared: ("seed",). Derivatives of inputs, u (T, m, r + 1), get the axis `derivative`.
    ValueError if the names do not fit the shapes.
    """
    fix = "Give what simulate, observe or differentiate returns."
    require_instance("to_dataset", "run", run, Trajectory | Estimate | Derivatives, fix)
    dims = DIMS | FLAT if isinstance(run, Derivatives) else DIMS
    lead = np.ndim(run.diverged_at)
    if lead != len(batch):
        fix = "One name for each axis that vmap added: batch=('seed',)."
        raise refuse("to_dataset", "batch", f"{len(batch)} names for {lead} leading axes", f"{lead} names", fix)
    found = {}
    for name, own in dims.items():
        if (value := getattr(run, name, None)) is None:
            continue
        axes = (*batch, *own, *(["derivative"] if np.ndim(value) > lead + len(own) else []))
        found[name] = xr.Variable(axes, np.asarray(value), {"long_name": LONG[name]})
    found["diverged_at"] = xr.Variable(batch, np.asarray(run.diverged_at), {"long_name": LONG["diverged_at"], "units": "s"})
    ts = np.asarray(run.ts).reshape(-1, np.shape(run.ts)[-1])[0]
    along = np.asarray(ts if time is None else time)
    if along.shape != ts.shape:
        raise refuse("to_dataset", "time", f"shape {along.shape}", f"{ts.shape}", "One for each sample of the run.")
    ds = xr.Dataset(found, {"time": ("time", along, {} if along.dtype.kind == "M" else {"units": "s"})})
    counts = {axis: np.arange(ds.sizes[axis]) for axis in ds.dims if axis not in ("time", *batch)}
    attrs = {"mu": float(run.mu)} if isinstance(run, Derivatives) and lead == 0 else {}
    return ds.assign_coords(counts).assign_attrs(attrs)
