"""An observer over recorded samples: no plant needed."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxobs._loop import Sample, as_state, begin, check_period, divergence_time, require_parts, tick, time_grid
from jaxobs._module import Module, Numbers, Scalar, check, concrete, dtype_of, is_real, refuse
from jaxobs._series import Series, record, values
from jaxobs.integrators import RK4, AbstractIntegrator, ProgressMeter, metered_scan
from jaxobs.observers import AbstractFlowObserver, AbstractStepObserver, Observer, Sampled


class Estimate(Module):
    """What an observer made of a record. xhat[k] uses y[k]; innovation[k] = y[k] - predicted, zero where not valid[k].

    diverged_at [s] is the first time at which xhat is not finite, infinity if it always is.
    """

    ts: Float[Array, " T"]
    xhat: Float[Array, "T n"]
    y: Float[Array, "T p"]
    valid: Bool[Array, "T p"]
    innovation: Float[Array, "T p"]
    diverged_at: Scalar


def observe(
    observer: Observer,
    ts: Numbers | Series,
    ys: Numbers | Series | None = None,
    us: Numbers | Series | None = None,
    *,
    xhat0: Numbers,
    integrator: AbstractIntegrator | None = None,
    hold_innovation: bool = False,
    progress_meter: ProgressMeter | None = None,
) -> Estimate:
    """xhat_k = estimate(k, z_k, u_k, y_k), then z_{k+1} = step(k, z_k, u_k, y_k), over a record (ts, ys, us).

    ts (T,) evenly spaced, ys (T, p) or (T,) if p = 1, us (T, m), to be left out if m = 0; or in the place of ts and ys a record
    that carries its times, a pandas Series or DataFrame or an xarray DataArray. NaN in ys marks a lost sample:
    its innovation is zero, or that of the last valid sample with `hold_innovation`. A flow observer becomes
    Sampled(observer, integrator) with y and u held between samples, which adds half a period of delay; integrator defaults to
    RK4(). progress_meter: one of diffrax's, told after each sample. Works under jit, vmap and grad.
    ValueError names the argument that does not fit.
    """
    require_parts("observe", observer=observer, integrator=integrator, progress_meter=progress_meter)
    check(observer)
    us = values("observe", "us", us, ts)
    ts, ys = record("observe", "ys", ts, ys)
    dtype = dtype_of(observer)
    grid = time_grid("observe", ts, dtype)
    if isinstance(observer, AbstractFlowObserver):
        observer = Sampled(observer, integrator or RK4(), grid.spacing)
    elif integrator is not None:
        raise refuse("observe", "integrator", type(integrator).__name__, "none for a step observer", "Leave it out.")
    check_period("observe", observer, grid.spacing)
    count = grid.ts.shape[0]
    ys = _rows("ys", ys, count, observer.p, "output")
    if us is None and observer.m > 0:
        fix = "Give us (T, m); zeros if the input was zero."
        raise refuse("observe", "us", "None", f"({count}, {observer.m}): the input at every sample", fix)
    us = jnp.zeros((count, 0), dtype) if us is None else _inputs(us, count, observer.m, dtype)
    start = as_state("observe", "xhat0", xhat0, observer.n, dtype)
    return _observe(observer, grid.ts, grid.dts, ys, us, start, hold_innovation, progress_meter)


@eqx.filter_jit
def _observe(
    observer: AbstractStepObserver, ts, dts, ys, us, xhat0, hold_innovation: bool, meter: ProgressMeter | None
) -> Estimate:
    dtype = dtype_of(observer)
    valid = jnp.isfinite(ys)
    ys = jnp.where(valid, ys, 0).astype(dtype)
    samples = Sample(jnp.arange(ts.shape[0]), ts, dts, us, ys, valid)

    def advance(x, z, sample, y, held):
        return x, observer.step(sample.k, z, sample.u, y)

    def body(carry, sample):
        return tick(observer, carry, sample, lambda x, s: s.y, advance, hold_innovation)

    start = begin(observer, None, observer.init(xhat0), dtype, None)
    _, xhat, y, innovation = metered_scan(body, start, samples, meter)[1]
    return Estimate(ts, xhat, y, valid, innovation, divergence_time(ts, xhat))


def _rows(field: str, value: Any, count: int, width: int, what: str) -> Any:
    shape, dtype = np.shape(value), (value if isinstance(value, jax.Array) else np.asarray(value)).dtype
    if not is_real(dtype):
        raise refuse("observe", field, f"dtype {dtype}", "real numbers", "Real and imaginary parts make two columns.")
    if shape == (count,) and width == 1:
        return jnp.asarray(value)[:, None]
    if shape != (count, width):
        expected = f"({count}, {width}): one row for each time, one column for each {what}"
        raise refuse("observe", field, f"shape {shape}", expected, "Transpose or reshape it.")
    return jnp.asarray(value)


def _inputs(us: Any, count: int, m: int, dtype: Any) -> Float[Array, "T m"]:
    us = _rows("us", us, count, m, "input")
    known = concrete(us)
    if known is not None and not np.all(np.isfinite(known)):
        row = int(np.argmin(np.all(np.isfinite(known), axis=1)))
        raise refuse("observe", "us", f"us[{row}] = {known[row]}", "finite inputs", "An input must be known at every sample.")
    return us.astype(dtype)
