"""Searches for gains: their record, what they were good for, and what a decay rate costs."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from jaxobs._module import refuse, require_instance
from jaxobs.plotting.style import BLUE, CYCLE, GREY, INK, MARKERS, ORANGE, WHITE_BOX, headline, panel, panels, root, series
from jaxobs.tuning import Comparison, Front, Tuned

FEW = 12  # parameters with a line of their own in the legend


def history(tuned: Tuned, *, title: str = "", figure: Any = None) -> Figure:
    """Over the steps of a search: the loss of each start and the least so far; the barrier; the norm of the gradient; the
    parameters of the start that won. Shaded: every other stage, each with its weight of the barrier. tuned: from
    jaxobs.tune."""
    require_instance("plotting.history", "tuned", tuned, Tuned, "jaxobs.tune returns it.")
    h = tuned.history
    steps = np.arange(h.loss.shape[1])
    with panels("history", figure, (8.4, 9.2), 4, 1, sharex=True, height_ratios=[2.2, 1, 1, 1.6]) as (whole, grid):
        axes = grid[:, 0]
        _losses(axes[0], tuned, steps)
        for i, start in enumerate(_paths(h.barrier, h.good)):
            axes[1].plot(steps, start, color=_colour(i), lw=1)
        axes[1].set_ylabel("barrier")
        if not np.any(np.isfinite(h.barrier)):
            axes[1].text(0.5, 0.5, "none: nothing is proved", transform=axes[1].transAxes, ha="center", va="center", color=GREY)
        for i, start in enumerate(_paths(h.slope, h.good)):
            axes[2].plot(steps, start, color=_colour(i), lw=1)
        axes[2].set(ylabel="norm of\nthe gradient", yscale="log")
        _parameters(axes[3], tuned, steps)
        axes[3].set_xlabel("step")
        for ax in axes:
            _stages(ax, h.weight)
        if np.unique(h.weight).size > 1:
            _weights(axes[0], h.weight)
        headline(whole, title)
        return root(whole)


def front(front: Front, *, title: str = "", figure: Any = None) -> Figure:
    """Each loss against the rate that is proved, a panel a loss, a colour and a mark a weight; filled: no other point is at
    least as good in everything. Every point is certified; a dotted line is a rate that could not be proved. front: from
    jaxobs.tuning.pareto."""
    require_instance("plotting.front", "front", front, Front, "jaxobs.tuning.pareto returns it.")
    names = list(front.points[0].values)
    weights = sorted({one.weight for one in front.points})
    with panels("front", figure, (4.6 * len(names), 3.6), 1, len(names)) as (whole, axes):
        for ax, name in zip(axes[0], names, strict=True):
            for i, weight in enumerate(weights):
                chosen = [one for one in front.points if one.weight == weight]
                rates, values = np.array([(one.rate, one.values[name]) for one in chosen]).T
                look, marker = series(i), MARKERS[i % len(MARKERS)]
                ax.plot(rates, values, lw=1, marker=marker, ms=0, label=f"weight {weight:g}", **look)
                free = np.array([one.is_dominated for one in chosen])
                fill = np.where(free, "white", look["color"])
                ax.scatter(rates, values, s=28, marker=marker, facecolor=fill, edgecolor=look["color"], zorder=3)
            for rate, _ in front.missing:
                ax.axvline(rate, color=GREY, lw=0.8, ls=":")
            ax.set(xlabel=f"proved rate, {front.unit}", ylabel=name)
        if len(weights) > 1:
            axes[0][0].legend(markerscale=1.0, **WHITE_BOX)
        headline(whole, title)
        return root(whole)


def comparison(
    cases: Comparison | Sequence[tuple[str, Any, Any]], *, state: int | None = None, title: str = "", ax: Any = None
) -> Figure:
    """RMSE after in units of that before, with its 95 % interval, and the floor. The numbers stand beside it.

    cases: what `jaxobs.tuning.compare` returns, whose first observer is the one before and whose others are the cases, for the
    `state` (from 1; the last if not given); or (name, row before, row after) a case, rows as `Comparison.row` has them.
    """
    against = "the gain before, at the same proved rate"
    if isinstance(cases, Comparison):
        cases = _cases(cases, state)
        against = cases[0][1].observer
    elif not len(cases) or any(len(case) != 3 for case in cases):
        fix = "jaxobs.tuning.compare returns what can be drawn at once."
        raise refuse("plotting.comparison", "cases", repr(cases)[:60], "(name, row before, row after) a case", fix)
    place = np.arange(len(cases))[::-1]
    alone = ax is None
    with panel("comparison", ax, (9.6, 0.52 * len(cases) + 1.7)) as ax:
        ax.axvline(1.0, color=GREY, lw=1.2)
        for y, (_, before, after) in zip(place, cases, strict=True):
            ratio, low, high = (1 + value for value in (after.change, after.change_low, after.change_high))
            half = [before.rmse_low / before.rmse, before.rmse_high / before.rmse]
            ax.plot(half, [y, y], color=GREY, lw=5, alpha=0.45, solid_capstyle="butt")
            ax.errorbar(ratio, y, xerr=[[max(ratio - low, 0)], [max(high - ratio, 0)]], fmt="o", color=BLUE, ms=6, capsize=3)
            if after.floor is not None:
                ax.plot(after.floor / before.rmse, y, "|", color=ORANGE, ms=16, mew=2)
            words = f"x{after.state}: {before.rmse:.3g} to {after.rmse:.3g}"
            ax.annotate(words, (1.01, y), xycoords=("axes fraction", "data"), va="center", fontsize=8.5, annotation_clip=False)
        ax.set_yticks(place, [name for name, _, _ in cases])
        ax.set(ylim=(-0.7, len(cases) - 0.3), xlabel=f"RMSE / RMSE of {against}")
        ax.set_xlim(left=0)
        ax.plot([], [], color=GREY, lw=5, alpha=0.45, label="before, 95 %")
        ax.plot([], [], "o", color=BLUE, label="after, 95 % (paired)")
        if any(after.floor is not None for _, _, after in cases):
            ax.plot([], [], "|", color=ORANGE, ms=14, mew=2, label="floor")
        if alone:
            root(ax).legend(loc="outside lower center", ncols=3)
        else:
            ax.legend(**WHITE_BOX)
        ax.set_title(title)
        return root(ax)


def _cases(found: Comparison, state: int | None) -> list[tuple[str, Any, Any]]:
    """The first observer of a comparison against each of the others."""
    known = sorted({row.state for row in found.rows})
    number = known[-1] if state is None else state
    rows = [row for row in found.rows if row.state == number]
    if len(rows) < 2:
        fix = "A comparison has a row for each state it was asked for, and two observers at least."
        raise refuse("plotting.comparison", "state", state, f"one of {known}, with two observers", fix)
    return [(row.observer, rows[0], row) for row in rows[1:]]


def _losses(ax: Any, tuned: Tuned, steps: np.ndarray) -> None:
    h = tuned.history
    for i, start in enumerate(_paths(h.loss, h.good) if len(h.loss) > 1 else ()):
        ax.plot(steps, start, color=_colour(i), lw=1, alpha=0.55, label="from the gain before" if i == 0 else f"start {i}")
    ax.plot(steps, np.min(h.best, axis=0), color=INK, lw=1.8, label="least so far")
    ax.axhline(tuned.first_loss, color=GREY, lw=0.9, ls="--", label="the gain before")
    if tuned.certificate is not None:
        ax.plot(steps[-1], tuned.loss, "o", color=BLUE, ms=6, zorder=5, label=f"proved: {tuned.loss:.4g}")
    if tuned.free_loss is not None:
        ax.axhline(tuned.free_loss, color=ORANGE, lw=0.9, ls=":", label=f"without the proof: {tuned.free_loss:.4g}")
    taken_back = np.nonzero(~np.all(h.good, axis=0))[0]
    if taken_back.size:
        ax.plot(steps[taken_back], np.full(taken_back.size, 0.02), "|", color=ORANGE, ms=6, transform=ax.get_xaxis_transform(),
                label="steps taken back")  # fmt: skip
    shown = np.concatenate([h.loss[h.good], [tuned.first_loss]])
    low, high = np.min(shown), np.quantile(shown, 0.995)
    low = min(low, tuned.loss if tuned.free_loss is None else tuned.free_loss)
    if low > 0:
        ax.set(yscale="log" if high > 8 * low else "linear", ylim=(low * 0.96, high * 1.06))
    ax.set_ylabel("loss")
    ax.legend(loc="upper right", fontsize=8.5, **WHITE_BOX)


def _parameters(ax: Any, tuned: Tuned, steps: np.ndarray) -> None:
    """Those of the best start, as the search sees them, less where they began."""
    starts = tuned.history.loss.shape[0]
    row = min(tuned.start, starts - 1)
    lines = []
    for name, values in tuned.history.theta.items():
        own = values[row].reshape(len(steps), -1)
        lines += [(f"{_plain(name)}{f'[{j}]' if own.shape[1] > 1 else ''}", own[:, j]) for j in range(own.shape[1])]
    for i, (label, path) in enumerate(lines):
        ax.plot(steps, path - path[0], color=_colour(i), lw=1.1, label=label if len(lines) <= FEW else None)
    ax.set_ylabel("parameters,\nfrom their start")
    if lines and len(lines) <= FEW:
        ax.legend(loc="upper left", fontsize=8, ncols=3)


def _paths(values: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Steps that were taken back are left out."""
    return np.where(good & np.isfinite(values), values, np.nan)


def _stages(ax: Any, weight: np.ndarray) -> None:
    for k, (first, last) in enumerate(_pieces(weight)):
        if k % 2:
            ax.axvspan(first - 0.5, last - 0.5, color="#f1f3f5", zorder=0, lw=0)


def _weights(ax: Any, weight: np.ndarray) -> None:
    for first, last in _pieces(weight):
        where = ((first + last) / 2, 0.02)
        text = f"weight {weight[first]:g}"
        ax.annotate(text, where, xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=8, color=GREY)


def _pieces(weight: np.ndarray) -> list[tuple[int, int]]:
    """(first, beyond the last) step of each stage."""
    ends = [0, *(np.nonzero(np.diff(weight))[0] + 1).tolist(), len(weight)]
    return list(itertools.pairwise(ends))


def _colour(i: int) -> str:
    return CYCLE[i % len(CYCLE)]


def _plain(name: str) -> str:
    """ "['alphas']" as "alphas"."""
    return name.strip("[]'\"") or "theta"
