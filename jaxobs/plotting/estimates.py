"""Estimate against truth, state by state."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from jaxobs._module import Numbers, refuse
from jaxobs.plotting._covariance import believed
from jaxobs.plotting._runs import Runs, as_runs, chosen, labels
from jaxobs.plotting.style import BLUE, GREY, INK, ORANGE, SIGMAS, SKY, below, headline, panels, root

TRUTH: dict[str, Any] = {"color": "#b5b5b5", "lw": 3.2, "zorder": 1.2}
BAND: dict[str, Any] = {"color": SKY, "alpha": 0.45, "lw": 0, "zorder": 1.5}
CLOSE = 1e-6  # of the spread of a state: an expected output that is nearer to it measures it


def estimate(
    run: Any,
    *,
    x: Numbers | None = None,
    observer: Any = None,
    deviations: Numbers | None = None,
    measured: Mapping[int, int] | None = None,
    errors: bool = False,
    states: Sequence[int] | int | None = None,
    names: Sequence[str] | None = None,
    span: tuple[float, float] | None = None,
    title: str = "",
    figure: Any = None,
) -> Figure:
    """xhat_i(t) over x_i(t), a panel a state, with a band of two standard deviations or of nine runs in ten:

        one run, `deviations` (T, n) given        xhat_i +- 2 deviations_i
        one run of a Kalman `observer` given      xhat_i +- 2 sqrt(P_ii), from the observer once more over the run's y and u
        one run                                   expected y_j +- 2 sigma, sigma = 1.4826 median |innovation_j|
        several runs of one truth                 the 5 % and 95 % quantiles of xhat_i over the runs, around their median
        several runs, several truths              the same of xhat_i - x_i, since no one curve is the truth

    errors: xhat_i - x_i in any case, with the band of the observer or of `deviations` around zero.

    run: a Trajectory, an Estimate, Derivatives, a batch of them (jax.vmap), or a data set with x and xhat (study with save=).
    x (T, n): the truth of a record, if known. Samples are dots in the panel of the state they measure, `measured` = {output:
    state}, by default where the expected output is the estimate of a state; a lost sample is a tick at the lower edge. Runs
    that are not finite are left out and counted in the title. span: the times that are shown [s]; the vertical scale is theirs.
    states: their numbers, from 1. names: of all n states. ValueError for what does not fit.
    """
    runs = as_runs("estimate", run, x)
    where, words = chosen("estimate", "states", states, runs.n), labels("estimate", names, runs.n)
    shown = _span("estimate", span, runs.ts)
    outputs = measured_states(runs, measured)
    band = _band(runs, run, observer, deviations)
    apart = errors or several_truths(runs)
    if apart:
        runs.errors("estimate")  # refuses a run without a truth
    good = runs.finite
    if not np.any(good):
        fix = "See run.diverged_at for when it left; a shorter step or other gains keep it."
        raise refuse("plotting.estimate", "run", "no run whose estimates are finite", "at least one", fix)
    lost = f"{np.count_nonzero(~good)} of {runs.count} runs diverged and are left out" if not np.all(good) else ""
    size = (8.4, 1.75 * len(where) + 0.9)
    with panels("estimate", figure, size, len(where), 1, sharex=True) as (whole, axes):
        for ax, i in zip(axes[:, 0], where, strict=True):
            _state(ax, runs, i, good, band, shown, apart)
            for j in [j for j, state in outputs.items() if state == i and not apart]:
                _samples(ax, runs, j, shown)
            ax.set_ylabel(f"error of {words[i]}" if apart else words[i])
        axes[-1, 0].set_xlabel("time [s]")
        headline(whole, "; ".join(filter(None, [title, lost])))
        below(whole)
        return root(whole)


def _state(ax: Any, runs: Runs, i: int, good: np.ndarray, band: Any, shown: np.ndarray, apart: bool) -> None:
    """Truth, estimate and band of one state; of its error if `apart`."""
    ts, xhat, what = runs.ts[shown], runs.xhat[good][:, shown, i], "error" if apart else "estimate"
    if apart and runs.x is not None:
        xhat = xhat - runs.x[good][:, shown, i]
        ax.axhline(0.0, color=GREY, lw=0.8, zorder=1.2)
    elif runs.x is not None:
        ax.plot(ts, runs.x[good][0, shown, i], label="truth", **TRUTH)
    if runs.count > 1:
        low, middle, high = np.quantile(xhat, [0.05, 0.5, 0.95], axis=0)
        ax.fill_between(ts, low, high, label=f"5 to 95 % of {len(xhat)} runs", **BAND)
        ax.plot(ts, middle, color=BLUE, label=f"median {what}", zorder=3)
        return
    ax.plot(ts, xhat[0], color=BLUE, label=what, zorder=3)
    if band is not None:
        centre, half, label = band
        centre = runs.xhat[0] * 0 if apart else centre
        if np.any(np.isfinite(half[:, i])) and not (apart and label.endswith("innovation")):
            low, high = (centre[shown, i] + sign * half[shown, i] for sign in (-1, 1))
            ax.fill_between(ts, low, high, label=label, **BAND)


def _samples(ax: Any, runs: Runs, j: int, shown: np.ndarray) -> None:
    """The measurements of output j, and where they were lost."""
    if runs.y is None or runs.valid is None or runs.count > 1:
        return
    ts, y, valid = runs.ts[shown], runs.y[0, shown, j], runs.valid[0, shown, j]
    ax.plot(ts[valid], y[valid], ".", color=INK, ms=2.2, alpha=0.45, label="measurement", zorder=2)
    if not np.all(valid):
        place = np.full(np.count_nonzero(~valid), 0.03)
        ax.plot(ts[~valid], place, "|", color=ORANGE, ms=7, transform=ax.get_xaxis_transform(), label="lost sample")


def _band(runs: Runs, run: Any, observer: Any, deviations: Any) -> tuple[np.ndarray, np.ndarray, str] | None:
    """Centre and half width (T, n), and what they are; None where there is none, NaN for the states without."""
    if observer is not None and deviations is not None:
        raise refuse("plotting.estimate", "deviations", "beside observer", "one of the two", "Both make the band.")
    shape = runs.xhat.shape[1:]
    if observer is not None:
        return runs.xhat[0], SIGMAS * believed("estimate", observer, run).deviations, f"±{SIGMAS} sqrt(P) of the observer"
    if deviations is not None:
        given = np.asarray(deviations, float)
        if runs.count > 1 or given.shape != shape or np.any(given < 0):
            fix = "For a covariance P (T, n, n): jnp.sqrt(jnp.diagonal(P, axis1=1, axis2=2))."
            raise refuse("plotting.estimate", "deviations", f"shape {given.shape}", f"{shape}, >= 0, for one run", fix)
        return runs.xhat[0], SIGMAS * given, f"±{SIGMAS} standard deviations"
    if runs.y is None or runs.innovation is None or runs.valid is None or runs.count > 1:
        return None
    centre, half = runs.xhat[0].copy(), np.full(shape, np.nan)
    for j, i in measured_states(runs).items():
        own = np.abs(runs.innovation[0, runs.valid[0, :, j], j])
        if own.size:
            centre[:, i], half[:, i] = runs.y[0, :, j] - runs.innovation[0, :, j], SIGMAS * 1.4826 * np.median(own)
    return centre, half, f"±{SIGMAS} sigma of the innovation"


def measured_states(runs: Runs, given: Mapping[int, int] | None = None) -> dict[int, int]:
    """The place of the state that each output measures, by the place of the output; only those that measure one."""
    if runs.y is None or runs.innovation is None:
        return {}
    p = runs.y.shape[2]
    if given is not None:
        chosen("estimate", "measured", list(given) or None, p)
        return dict(zip([j - 1 for j in given], chosen("estimate", "measured", list(given.values()) or None, runs.n),
                        strict=False))  # fmt: skip
    found = {}
    for j in range(p):
        expected, y = runs.y[0, :, j] - runs.innovation[0, :, j], runs.y[0, :, j]
        away = [np.max(np.abs(expected - runs.xhat[0, :, i])) for i in range(runs.n)]
        # A filter's estimate has moved from the expected output towards y: it lies between the two.
        inside = [
            np.all((runs.xhat[0, :, i] - expected) * (runs.xhat[0, :, i] - y) <= CLOSE * np.ptp(y) ** 2) for i in range(runs.n)
        ]
        i = int(np.argmin(away))
        if away[i] <= CLOSE * max(1.0, float(np.ptp(runs.xhat[0, :, i]))) or inside[i]:
            found[j] = i
    return found


def several_truths(runs: Runs) -> bool:
    """Whether the runs have several truths."""
    return runs.x is not None and runs.count > 1 and not np.allclose(runs.x, runs.x[:1], rtol=1e-9, atol=1e-12, equal_nan=True)


def _span(owner: str, span: tuple[float, float] | None, ts: np.ndarray) -> np.ndarray:
    """Which samples are shown."""
    if span is None:
        return np.ones(len(ts), bool)
    shown = (ts >= span[0]) & (ts <= span[1]) if len(span) == 2 else np.zeros(len(ts), bool)
    if np.count_nonzero(shown) < 2:
        expected = f"(from, to) [s] with two samples between, within {ts[0]:.6g} to {ts[-1]:.6g}"
        raise refuse(f"plotting.{owner}", "span", span, expected, "Leave it out for all of the run.")
    return shown
