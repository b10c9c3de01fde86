"""Observers side by side, before and after: errors under the same noise with intervals, transients, bandwidths."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy.integrate

from jaxobs._module import Numbers, dtype_of, refuse, require_instance, require_positive
from jaxobs.integrators import AbstractIntegrator
from jaxobs.metrics import RMSE, Peak
from jaxobs.observers import Observer
from jaxobs.plants import AbstractPlant
from jaxobs.signals import Zero
from jaxobs.studies import Family, study
from jaxobs.tuning._linearised import Passband, passband
from jaxobs.tuning._paired import relative_change, root_mean_square


@dataclasses.dataclass(frozen=True)
class Row:
    """One observer and one state x_i, i = `state` (1 is the first). Times in s, rates in rad/s, errors in units of x_i.

    rmse, rmse_low, rmse_high: root of the mean square error over t >= after, and its 95 % interval over seeds. change, ...: the
    same of rmse / (that of the first observer) - 1, over the same seeds. settling_time, squared_error (int e_i^2 dt), peak
    (max |e_i|): of the noise-free transient. bandwidth, noise_bandwidth, fastest_pole: of y_1 -> yhat_1, linearised. lanes:
    the runs with noise; diverged: those left out because they did. floor, certified: what the caller said.
    """

    observer: str
    state: int
    rmse: float
    rmse_low: float
    rmse_high: float
    change: float
    change_low: float
    change_high: float
    settling_time: float
    squared_error: float
    peak: float
    bandwidth: float
    noise_bandwidth: float
    fastest_pole: float
    lanes: int
    diverged: int
    floor: float | None = None
    certified: str | float | None = None


@dataclasses.dataclass(frozen=True)
class Comparison:
    """The rows, first observer first; print it for the table, `to_dict()` for JSON."""

    rows: tuple[Row, ...]
    after: float
    band: float
    seeds: int
    plants: int

    def __str__(self) -> str:
        table = [HEADS, *(_cells(row, first=row.observer == self.rows[0].observer) for row in self.rows)]
        kept = [i for i in range(len(HEADS)) if i < 2 or any(line[i] for line in table[1:])]
        widths = [max(len(line[i]) for line in table) for i in kept]
        lines = []
        for line in table:
            first, *others = (line[i].rjust(w) for i, w in zip(kept, widths, strict=True))
            lines.append("  ".join([line[0].ljust(len(first)), *others]).rstrip())
        return "\n".join([*lines, *self._notes()])

    def row(self, observer: str, state: int | None = None) -> Row:
        """The row of this observer, and of this state where there are several."""
        found = [row for row in self.rows if row.observer == observer and state in (None, row.state)]
        if len(found) != 1:
            names = ", ".join(sorted({f"{row.observer!r} x{row.state}" for row in self.rows}))
            raise refuse("Comparison.row", "observer", f"{observer!r}, state {state}", f"one of {names}", "Name both.")
        return found[0]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: what is not finite is null, but infinity is "inf"."""
        rows = [{name: _plain(value) for name, value in dataclasses.asdict(row).items()} for row in self.rows]
        return {"after": self.after, "band": self.band, "seeds": self.seeds, "plants": self.plants, "rows": rows}

    def _notes(self) -> list[str]:
        plants = f" and {self.plants} plants or starts" if self.plants > 1 else ""
        notes = [
            f"RMSE over t >= {self.after:.6g} s, {self.seeds} seeds{plants}; [95 %] over seeds: t on log RMSE, changes paired.",
            f"Settling (outside {100 * self.band:.3g} % of its peak), ISE, peak: without noise. Rates in rad/s.",
        ]
        if any(row.diverged for row in self.rows):
            notes.append("Diverged runs are left out of the RMSE; a change counts the runs that neither observer lost.")
        return notes


def compare(
    observers: Mapping[str, Observer],
    plant: Any,
    *,
    ts: Numbers,
    x0: Any,
    xhat0: Any,
    keys: Any,
    noise: Any,
    disturbance: Any = None,
    signal: Any = None,
    after: float | int,
    state: int | Sequence[int] | None = None,
    integrator: AbstractIntegrator | None = None,
    band: float = 0.05,
    at: Numbers | None = None,
    floor: Sequence[float] | None = None,
    certified: Mapping[str, str | float] | None = None,
) -> Comparison:
    """R_i = sqrt(mean over seeds, plants and times t >= after of (xhat_i - x_i)^2) of each observer, and R_i / R_i,first - 1.

    All runs are those of `jaxobs.study`: seed s gives every observer the same noise and disturbance, so that differences are
    paired. A seed is the unit: its mean square over plants and starts is one number, and the 95 % intervals are Student's t
    on log R over seeds by the delta method (S - 1 degrees of freedom; for the change on log R - log R_first). They say
    nothing of other plants than those given. Without disturbance and with exact models the lowest gain wins: give one of the
    two. A run whose x, xhat or RMSE is not finite is counted, not averaged, which favours the observer that lost it.

    plant: one, several for mismatch, `jaxobs.grid(plant, a=[0.9, 1.0, 1.1])` or a sequence. x0, xhat0 (n,) or (starts, n).
    keys: as in `study`; take seeds that no tuning has seen. state: i or several, 1 the first; all if None.
    The transient (settling time: the last time that |e_i| exceeds band * max |e_i|, infinity if that is the end) is one run
    without noise of the plant before its grid, or of the first; with several starts the worst is shown, of ISE the mean.
    Bandwidths and the fastest pole are those of the observer linearised at the state `at` (zeros) and the first input.
    floor: one number a state, put beside its RMSE; certified: {name: rate or label}, put into its rows and not looked at.

    ValueError names the argument that does not fit. All arguments else are those of `jaxobs.study`.
    """
    plants, nominal = _plants(plant)
    names = _names(observers)
    n = nominal.n
    states = _states(state, n)
    require_positive("compare", "band", band, "It is a share of the peak, e.g. 0.05.")
    if floor is not None and len(floor) != n:
        raise refuse("compare", "floor", f"{len(floor)} numbers", f"{n}", "One for each state.")
    for name in certified or {}:
        if name not in names:
            raise refuse("compare", "certified", repr(name), "one of " + ", ".join(map(repr, names)), "Name an observer.")
    times = np.asarray(ts, np.float64)
    if times.ndim != 1 or not times[-1] >= after:
        raise refuse(
            "compare", "after", after, f"at most {float(np.max(times)):.6g} s, the end of ts", "The RMSE begins there."
        )
    around = {"ts": ts, "x0": x0, "xhat0": xhat0, "signal": signal, "integrator": integrator}
    noisy = {"keys": keys, "noise": noise, "disturbance": disturbance}
    metrics = {"rmse": RMSE(jnp.asarray(after, dtype_of(next(iter(observers.values())))))}
    parts = [_errors(study(one, dict(observers), metrics=metrics, **around, **noisy)) for one in plants]
    squares, lost = (np.concatenate(some, axis=1) for some in zip(*parts, strict=True))
    still = study(nominal, dict(observers), metrics={"peak": Peak()}, save=1, **around)
    transient = _transient(still, times, band)
    bands = [_passband(observer, nominal, at, signal, times) for observer in observers.values()]
    rows = []
    for i, name in enumerate(names):
        for k in states:
            own, both = ~lost[i], ~(lost[i] | lost[0])
            error = root_mean_square(_by_seed(squares[i, :, :, k - 1], own))
            change = relative_change(*(_by_seed(squares[j, :, :, k - 1], both) for j in (i, 0)))
            settling, ise, peak = (float(part[i, k - 1]) for part in transient)
            said = None if floor is None else float(floor[k - 1])
            counts = lost[i].size, int(np.sum(lost[i]))
            rows.append(
                Row(name, k, *error, *change, settling, ise, peak, *bands[i], *counts, said, (certified or {}).get(name))
            )
    return Comparison(tuple(rows), float(after), float(band), squares.shape[2], squares.shape[1])


def _errors(ds: Any) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares (observers, lanes, seeds, n), and which runs are lost (observers, lanes, seeds)."""
    if "seed" not in ds.rmse.dims:
        raise refuse("compare", "keys", "None", "PRNG keys, or jaxobs.Seeds(key, count)", "The intervals are over seeds.")
    squares = np.asarray(ds.rmse.transpose("observer", ..., "seed", "state"), np.float64) ** 2
    ended = np.asarray(ds.diverged_at.transpose("observer", ..., "seed"), np.float64)
    count, *_, seeds, n = squares.shape
    squares, ended = squares.reshape(count, -1, seeds, n), ended.reshape(count, -1, seeds)
    lost = np.isfinite(ended) | ~np.all(np.isfinite(squares), axis=3)
    return squares, lost


def _by_seed(squares: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """The mean over the kept lanes (lanes, seeds) of each seed that has one."""
    count = np.sum(kept, axis=0)
    total = np.sum(np.where(kept, squares, 0), axis=0)
    return total[count > 0] / count[count > 0]


def _transient(ds: Any, times: np.ndarray, band: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Settling time, integral of the square and peak of the noise-free error, (observers, n) each."""
    order = ("observer", ..., "time", "state")
    error = np.abs(np.asarray(ds.xhat.transpose(*order), np.float64) - np.asarray(ds.x.transpose(*order), np.float64))
    error = error.reshape(error.shape[0], -1, *error.shape[-2:])
    error = np.where(np.isfinite(error), error, np.inf)
    peak = np.max(error, axis=2)
    settling, ise = np.full_like(peak, np.inf), np.full_like(peak, np.inf)
    for i, j, k in zip(*np.nonzero(np.isfinite(peak)), strict=True):
        path = error[i, j, :, k]
        settling[i, j, k] = _settled(path, times, band * peak[i, j, k])
        with np.errstate(over="ignore"):
            ise[i, j, k] = scipy.integrate.simpson((path / max(peak[i, j, k], 1e-300)) ** 2, x=times) * peak[i, j, k] ** 2
    return np.max(settling, axis=1), np.mean(ise, axis=1), np.max(peak, axis=1)


def _settled(error: np.ndarray, times: np.ndarray, level: float) -> float:
    """The time from the start at which the error last crosses the level, interpolated; infinity if it ends above."""
    outside = np.nonzero(error > level)[0]
    if len(outside) == 0:
        return 0.0
    i = int(outside[-1])
    if i == len(error) - 1:
        return np.inf
    share = (error[i] - level) / (error[i] - error[i + 1])
    return float(times[i] + share * (times[i + 1] - times[i]) - times[0])


def _passband(observer: Any, plant: Any, at: Any, signal: Any, times: np.ndarray) -> Passband:
    dtype = dtype_of(observer)
    x = jnp.zeros((plant.n,), dtype) if at is None else jnp.asarray(at, dtype)
    if x.shape != (plant.n,):
        raise refuse("compare", "at", f"shape {x.shape}", f"({plant.n},)", "It is a state: one number for each.")
    source = Zero(plant.m) if signal is None else signal.observer if isinstance(signal, Family) else signal
    spacing = (times[-1] - times[0]) / (len(times) - 1)
    return passband(observer, plant, x, source(jnp.asarray(times[0], dtype)), float(spacing))


def _plants(plant: Any) -> tuple[list[Any], AbstractPlant]:
    """Each plant or grid of one, and the plant of the transient."""
    several = list(plant) if isinstance(plant, list | tuple) else [plant]
    if not several:
        raise refuse("compare", "plant", "none", "at least one", "Several plants make a mismatch; one is enough.")
    bare = [one.observer if isinstance(one, Family) else one for one in several]
    for one in bare:
        require_instance("compare", "plant", one, AbstractPlant, "Give a plant, a grid of it, or a list of them.")
    return several, bare[0]


def _names(observers: Any) -> list[str]:
    fix = 'Name them, the reference first: compare({"paper": observer, "tuned": other}, plant, ...).'
    require_instance("compare", "observers", observers, Mapping, fix)
    if not observers:
        raise refuse("compare", "observers", "none", "at least one", fix)
    for name, observer in observers.items():
        require_instance("compare", f"observers[{name!r}]", observer, Observer, "Give the observer alone, not a grid of it.")
    return list(observers)


def _states(state: Any, n: int) -> list[int]:
    chosen = range(1, n + 1) if state is None else [state] if isinstance(state, int | np.integer) else state
    states = [int(k) for k in chosen]
    if not states or any(not 1 <= k <= n for k in states) or len(set(states)) < len(states):
        raise refuse("compare", "state", state, f"numbers from 1 to {n}, each once", "x_1 is the first state.")
    return states


HEADS = (
    "observer", "x_i", "RMSE", "[95 %]", "floor", "change", "[95 %]", "settling", "ISE", "peak", "bandwidth", "noise bw",
    "fastest pole", "diverged", "certified",
)  # fmt: skip


def _cells(row: Row, *, first: bool) -> tuple[str, ...]:
    change = ("", "")
    if not first:
        change = f"{100 * row.change:+.1f} %", f"[{100 * row.change_low:+.1f}, {100 * row.change_high:+.1f}]"
    numbers = (row.settling_time, row.squared_error, row.peak, row.bandwidth, row.noise_bandwidth, row.fastest_pole)
    proved = "" if row.certified is None else row.certified if isinstance(row.certified, str) else f"{row.certified:.4g}"
    return (
        row.observer, str(row.state), f"{row.rmse:.4g}", f"[{row.rmse_low:.4g}, {row.rmse_high:.4g}]",
        "" if row.floor is None else f"{row.floor:.4g}", *change, *(f"{number:.4g}" for number in numbers),
        f"{row.diverged}/{row.lanes}" if row.diverged else "", proved,
    )  # fmt: skip


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return "inf" if value == math.inf else None
    return value
