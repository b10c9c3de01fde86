"""The one loop: estimate at each sample, then move on. `observe` runs it on a record, `simulate` on a plant."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jaxobs._module import Module, Scalar, concrete, is_real, refuse, require_instance
from jaxobs.integrators import AbstractIntegrator, ProgressMeter
from jaxobs.metrics import AbstractMetric, Moment
from jaxobs.noise import AbstractNoise
from jaxobs.observers import AbstractStepObserver, Observer
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant
from jaxobs.signals import AbstractSignal

PARTS = {  # argument -> what it must be, what to try
    "plant": (AbstractFlowPlant | AbstractStepPlant, "Give a plant, e.g. jaxobs.plants.Pendulum(); the observer comes second."),
    "observer": (Observer, "Give the observer alone: a design returns it together with its certificate."),
    "signal": (AbstractSignal | None, "Build it first, e.g. jaxobs.signals.Sine(0.5, 2.0); no signal is no input."),
    "noise": (AbstractNoise | None, "Build it first, e.g. jaxobs.noise.Gaussian(0.1)."),
    "disturbance": (AbstractNoise | None, "Build it first, e.g. jaxobs.noise.Gaussian(0.1)."),
    "integrator": (AbstractIntegrator | None, "Build it first, e.g. jaxobs.integrators.RK4()."),
    "progress_meter": (ProgressMeter | None, "Build it first, e.g. diffrax.TextProgressMeter()."),
}


def require_parts(owner: str, **parts: Any) -> None:
    """Each argument is an object of its kind."""
    for field, part in parts.items():
        kind, fix = PARTS[field]
        require_instance(owner, field, part, kind, fix)


class Sample(NamedTuple):
    """What is given at t_k: the step to the next sample, u_k, the record y_k or the noise w_k, and the disturbance E d_k."""

    k: Int[Array, "..."]
    t: Float[Array, "..."]
    dt: Float[Array, "..."]
    u: Float[Array, "... m"]
    y: Float[Array, "... p"]
    valid: Bool[Array, "... p"]
    d: Any = None


Advance = Callable[[Any, Any, Sample, Array, Array], tuple[Any, Any]]  # (x, z, sample, y, held) -> the next (x, z)


def begin(observer: Observer, x: Any, z: Any, dtype: Any, metrics: Mapping[str, AbstractMetric] | None) -> Any:
    """What the loop carries: x, z, the innovation that is held, the states of the metrics, the time of divergence."""
    states = {name: metric.init(observer.n, observer.p, dtype) for name, metric in (metrics or {}).items()}
    return x, z, jnp.zeros((observer.p,), dtype), states, jnp.asarray(jnp.inf, dtype)


def tick(
    observer: Observer,
    carry: Any,
    sample: Sample,
    measure: Callable[[Any, Sample], Float[Array, " p"]],
    advance: Advance,
    hold_innovation: bool,
    metrics: Mapping[str, AbstractMetric] | None = None,
) -> tuple[Any, Any]:
    """One sample: the next carry, and (x, xhat, y, innovation), or with metrics (x, xhat).

    An invalid y is replaced by the expected one: its innovation is zero, or, with `hold_innovation`, that of the last valid
    sample.
    """
    x, z, held, states, lost = carry
    time = sample.k if isinstance(observer, AbstractStepObserver) else sample.t
    expected = observer.predict(time, z, sample.u)
    seen = measure(x, sample)
    innovation = jnp.where(sample.valid, seen - expected, held)
    y = jnp.where(sample.valid, seen, expected + held)
    held = innovation if hold_innovation else held
    xhat = observer.estimate(time, z, sample.u, y)
    out = (x, xhat, y, innovation)
    if metrics is not None:
        moment = Moment(sample.t, x, xhat, innovation, sample.valid)
        states, out = {name: metric.update(states[name], moment) for name, metric in metrics.items()}, (x, xhat)
        finite = jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(xhat))
        lost = jnp.where(finite, lost, jnp.minimum(lost, sample.t))
    return (*advance(x, z, sample, y, held), held, states, lost), out


def results(carry: Any, metrics: Mapping[str, AbstractMetric]) -> dict[str, Any]:
    """The metrics at the end, and under "diverged_at" the first time at which x or xhat was not finite."""
    (*_, states, lost) = carry
    return {name: metric.result(states[name]) for name, metric in metrics.items()} | {"diverged_at": lost}


class Grid(NamedTuple):
    """Times and steps in the precision of the run; the steps are differences taken in float64."""

    ts: Float[Array, " T"]
    dts: Float[Array, " T"]
    spacing: Scalar


JITTER = 0.5  # of a period: recorded clocks; what is more is a gap


def time_grid(owner: str, ts: Any, dtype: Any, most_uneven: float | None = JITTER) -> Grid:
    """Checks (where the values are concrete): one axis, two samples at least, finite, increasing, and even if asked.

    most_uneven: how far a step may be from the mean one, as a share of it; None for any grid.
    """
    if np.ndim(ts) != 1 or np.shape(ts)[0] < 2:
        raise refuse(owner, "ts", f"shape {np.shape(ts)}", "(T,) with T >= 2", "Give one time for each sample.")
    known = concrete(ts)
    if known is None:
        dts = jnp.diff(ts)
        return Grid(ts.astype(dtype), _with_last(dts).astype(dtype), jnp.mean(dts).astype(dtype))
    if not is_real(known.dtype):
        raise refuse(
            owner, "ts", f"dtype {known.dtype}", "seconds as floats", "For dates: (ts - ts[0]) / np.timedelta64(1, 's')."
        )
    known = known.astype(np.float64)
    if not np.all(np.isfinite(known)):
        row = int(np.argmin(np.isfinite(known)))
        raise refuse(owner, "ts", f"ts[{row}] = {known[row]}", "finite times", "Drop or interpolate that row.")
    dts = np.diff(known)
    if not np.all(dts > 0):
        row = int(np.argmin(dts > 0)) + 1
        given = f"ts[{row}] = {known[row]:.9g} after ts[{row - 1}] = {known[row - 1]:.9g}"
        raise refuse(owner, "ts", given, "increasing times", "Sort the record and drop doubled rows.")
    spacing = (known[-1] - known[0]) / len(dts)
    if spacing < 64 * np.finfo(dtype).eps * np.max(np.abs(known)):
        given = f"times near {known[-1]:.9g} s with steps of {spacing:.3g} s"
        expected = f"times that {jnp.dtype(dtype).name} tells apart"
        raise refuse(owner, "ts", given, expected, "Subtract ts[0], or work in float64 (jax_enable_x64).")
    if most_uneven is not None and np.max(np.abs(dts - spacing)) > most_uneven * spacing:
        row = int(np.argmax(np.abs(dts - spacing))) + 1
        given = f"a step of {dts[row - 1]:.6g} s before row {row}, {spacing:.6g} s on average"
        raise refuse(
            owner, "ts", given, "an even spacing", "Fill gaps with NaN rows (they count as lost samples), or resample."
        )
    return Grid(jnp.asarray(known, dtype), jnp.asarray(_with_last(dts), dtype), jnp.asarray(spacing, dtype))


def _with_last(dts: Any) -> Any:
    """One step for each sample; the last one leads nowhere and repeats its predecessor."""
    return jnp.concatenate([dts, dts[-1:]]) if isinstance(dts, jax.Array) else np.append(dts, dts[-1])


def check_period(owner: str, part: Module, spacing: Scalar) -> None:
    """A part made for one sampling period, or with such a model, meets data of that period, to 1e-3 (clocks jitter)."""
    maker = next((m for m in (part, getattr(part, "model", None)) if hasattr(m, "dt")), None)
    if maker is None:
        return
    given, made_for = concrete(spacing), concrete(getattr(maker, "dt"))  # noqa: B009 (not every Module has one)
    if given is not None and made_for is not None and abs(given / made_for - 1) > 1e-3:
        raise refuse(
            owner, "ts", f"samples {given:.6g} s apart", f"{type(maker).__name__}.dt = {made_for:.6g} s",
            f"Build the {type(part).__name__} for this spacing, or resample.",
        )  # fmt: skip


def divergence_time(ts: Float[Array, " T"], *paths: Float[Array, "T ..."]) -> Scalar:
    """The first time with a value that is not finite; infinity if there is none."""
    good = jnp.stack([jnp.all(jnp.isfinite(path.reshape(path.shape[0], -1)), axis=1) for path in paths]).all(axis=0)
    return jnp.where(jnp.all(good), jnp.inf, ts[jnp.argmin(good)])


def as_state(owner: str, field: str, value: Any, size: int, dtype: Any) -> Float[Array, " size"]:
    """An initial state as a float vector of the right length, finite where it is concrete."""
    if np.shape(value) != (size,):
        raise refuse(owner, field, f"shape {np.shape(value)}", f"({size},)", "Give one number for each state.")
    known = concrete(value)
    if known is not None and not np.all(np.isfinite(known)):
        raise refuse(owner, field, known, "finite numbers", "Start from a finite guess, zeros if nothing is known.")
    return jnp.asarray(value, dtype)
