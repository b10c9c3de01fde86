"""The first moments of observers side by side: how high the error peaks, and how fast it is gone."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from jaxobs._module import refuse
from jaxobs.plotting._datasets import labels_of, points
from jaxobs.plotting._runs import Runs, as_runs, chosen, is_dataset, labels
from jaxobs.plotting.style import headline, panels, root, series

Scale = Literal["log", "linear", "symlog"]


def peaking(
    runs: Any,
    *,
    states: Sequence[int] | int | None = None,
    names: Sequence[str] | None = None,
    until: float | None = None,
    scale: Scale = "log",
    title: str = "",
    figure: Any = None,
) -> Figure:
    """|xhat_i - x_i| over time from its start, a panel a state and a line an observer, the peak of each marked and written.

    runs: {label: Trajectory}, or a data set with x and xhat (study with save=), whose axes beside the seed make the lines.
    Of several runs under one label the root mean square over them is drawn. A high-gain observer peaks like gamma^{i-1},
    and forgets like e^{-gamma t}: both are straight on the logarithmic scale. scale: "log", "linear", or "symlog", which
    show the signed error of single runs. until [s]: the end of the picture, which the peak is looked for in. ValueError for
    what does not fit.
    """
    if scale not in ("log", "linear", "symlog"):
        raise refuse("plotting.peaking", "scale", repr(scale), "'log', 'linear' or 'symlog'", "The error spans decades: 'log'.")
    lines = _lines(runs)
    first = next(iter(lines.values()))
    where, words = chosen("peaking", "states", states, first.n), labels("peaking", names, first.n)
    ordered = is_dataset(runs) or all(_number(name) is not None for name in lines)
    with panels("peaking", figure, (4.9 * max(len(where), 1) + 0.6, 4.1), 1, len(where)) as (whole, axes):
        for ax, i in zip(axes[0], where, strict=True):
            for k, (name, run) in enumerate(lines.items()):
                _line(ax, name, run, i, until, scale, series(k, len(lines), ordered=ordered))
            _finish(ax, scale, words[i])
        headline(whole, title)
        return root(whole)


def _line(ax: Any, name: str, run: Runs, i: int, until: float | None, scale: str, look: dict[str, Any]) -> None:
    ts = run.ts - run.ts[0]
    shown = ts <= (np.inf if until is None else until)
    if np.count_nonzero(shown) < 2:
        raise refuse("plotting.peaking", "until", until, f"more than {ts[1]:.3g} s", "It ends the picture, in seconds.")
    errors = run.errors("peaking")[:, shown, i]
    signed = errors[0] if run.count == 1 and scale != "log" else np.sqrt(np.mean(errors**2, axis=0))
    finite = np.isfinite(signed)
    if not np.any(finite):
        ax.plot([], [], label=f"{name}: not finite", **look)
        return
    at = int(np.nanargmax(np.where(finite, np.abs(signed), -1)))
    ax.plot(ts[shown], np.where(finite & ((signed > 0) | (scale != "log")), signed, np.nan), **look)
    end = "" if np.all(finite) else ", then not finite"
    label = f"{name}: {np.abs(signed[at]):.3g} at {ts[shown][at]:.3g} s{end}"
    ax.plot(ts[shown][at], signed[at], "o", color=look["color"], mec="white", mew=0.8, ms=7, zorder=5)
    ax.plot([], [], marker="o", mec="white", mew=0.8, label=label, **look)


def _finish(ax: Any, scale: str, word: str) -> None:
    if scale == "log":
        # What has decayed to rounding is not the subject: nine decades at most, of those that are there.
        tops = [line.get_ydata() for line in ax.lines if len(line.get_ydata()) > 1]
        positive = np.concatenate([np.asarray(top, float) for top in tops]) if tops else np.ones(1)
        positive = positive[np.isfinite(positive) & (positive > 1e-300)]
        high = np.max(positive, initial=1e-300)
        low = max(np.min(positive, initial=high), high * 1e-9)
        ax.set(yscale="log", ylim=(low / 2, high * 2))
    elif scale == "symlog":
        ax.set_yscale("symlog", linthresh=0.1)
    ax.set(xlabel="time from the start [s]", ylabel=f"error of {word}" if scale != "log" else f"|error| of {word}")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), title="peak", ncols=2)


def _lines(runs: Any) -> dict[str, Runs]:
    """label -> runs."""
    if is_dataset(runs):
        axes = points(runs, "peaking", "xhat", ("seed", "time", "state"))
        words = {name: labels_of(runs, name) for name in axes}
        cut = [dict(zip(axes, place, strict=True)) for place in itertools.product(*(range(runs.sizes[name]) for name in axes))]
        names = [", ".join(f"{name} = {words[name][i]}" for name, i in at.items()) or "runs" for at in cut]
        return {name: as_runs("peaking", runs.isel(at)) for name, at in zip(names, cut, strict=True)}
    if hasattr(runs, "xhat"):
        runs = {"run": runs}
    if not isinstance(runs, Mapping) or not runs:
        fix = 'E.g. {"gamma = 6": trajectory, ...}.'
        raise refuse("plotting.peaking", "runs", type(runs).__name__, "{label: Trajectory}, at least one", fix)
    found = {str(name): as_runs("peaking", run) for name, run in runs.items()}
    if len(sizes := {run.n for run in found.values()}) > 1:
        raise refuse("plotting.peaking", "runs", f"runs of {sorted(sizes)} states", "the same states", "Draw them apart.")
    return found


def _number(name: str) -> float | None:
    """The last number of a label, if it is one of a grid."""
    try:
        return float(name.rsplit("=", 1)[-1])
    except ValueError:
        return None
