"""Studies: a metric over the grid of observers, with what the seeds say of it."""

import itertools
import math
from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullLocator

from jaxobs._module import Numbers, refuse
from jaxobs.plotting._datasets import Table, labels_of, numbers, points, spelled, table, unit
from jaxobs.plotting.style import (
    INK,
    ORANGE,
    SEQUENTIAL,
    WHITE_BOX,
    headline,
    lightness,
    log_ticks,
    panels,
    root,
    series,
)

WRITTEN = 240  # cells of a panel beyond which their numbers are left out
LINES = 8  # of one panel


def noise_map(
    ds: Any, metric: str = "rmse", *, rows: str | None = None, columns: str | None = None, title: str = "", figure: Any = None
) -> Figure:
    """The median of a metric over the seeds on two axes of a study, gamma by q as a rule: a panel a state, the least framed.

    ds: what `jaxobs.study` returns, on two axes beside the seed, which `rows` and `columns` choose and name (by default in the
    order of the data set: the last is `columns`). Lanes that diverged are left out; a cell in which all did is crossed, one
    whose median is infinite (most runs never settle) says so. Every
    state has a colour scale of its own, logarithmic where the values span more than a factor of four. ValueError for a metric
    that is not there, and for more axes than two: choose with ds.sel.
    """
    owner, axes = "noise_map", points(ds, "noise_map", metric, ("seed", "state", "output", "lag"))
    rows, columns = _two(ds, owner, axes, metric, rows, columns)
    found = table(ds, owner, metric, (rows, columns))
    order = [found.axes.index(name) for name in (rows, columns)]
    median = np.moveaxis(found.quantiles(0.5)[0], order, (0, 1))
    across = len(median[0]) > 9 or len(found.words) == 1
    down, side = (len(found.words), 1) if across else (1, len(found.words))
    size = (max(4.2, 0.66 * len(median[0]) + 1.1) * side + 0.3, max(2.1, 0.42 * len(median) + 1.25) * down + 0.3)
    with panels(owner, figure, size, down, side) as (whole, axes_):
        for k, (ax, word) in enumerate(zip(axes_.flat, found.words, strict=True)):
            image = _cells(ax, median[:, :, k])
            if median[:, :, k].size > WRITTEN:
                bar = whole.colorbar(image, ax=ax, pad=0.015, aspect=14)
                if isinstance(image.norm, LogNorm):
                    log_ticks(bar.ax.yaxis)
            for axis, name in ((ax.yaxis, rows), (ax.xaxis, columns)):
                axis.set_ticks(np.arange(ds.sizes[name]), labels_of(ds, name))
                axis.set_label_text(name)
            ax.set_title(unit(found, metric, word))
            if ax.get_xticklabels() and max(len(text.get_text()) for text in ax.get_xticklabels()) > 6:
                ax.tick_params(axis="x", labelrotation=45)
        over = f"median of {found.seeds} seeds" if found.seeds > 1 else ""
        headline(whole, "; ".join(filter(None, [title, over, found.left_out])))
        return root(whole)


def _two(ds: Any, owner: str, axes: list[str], metric: str, rows: str | None, columns: str | None) -> tuple[str, str]:
    """The names of the two axes."""
    known = [str(d) for d in ds[metric].dims if d not in ("seed", "state", "output", "lag")]
    for field, name in (("rows", rows), ("columns", columns)):
        if name is not None and name not in known:
            raise refuse(f"plotting.{owner}", field, repr(name), "one of " + ", ".join(known), "These are the study's axes.")
    free = [name for name in [*axes, *(name for name in known if name not in axes)] if name not in (rows, columns)]
    free = [name for name in known if name in free]
    wanted = [name for name in free if name in axes]
    missing = (rows is None) + (columns is None)
    if len(wanted) > missing:
        fix = "Choose one: ds.sel(" + ", ".join(f"{name}=..." for name in wanted[: len(wanted) - missing]) + ")."
        raise refuse(f"plotting.{owner}", "ds", "the axes " + ", ".join(axes), "two axes beside the seed", fix)
    chosen = wanted + [name for name in free if name not in wanted][: missing - len(wanted)]
    if len(chosen) < missing or (rows == columns and rows is not None):
        fix = "noise_curve draws one axis."
        raise refuse(f"plotting.{owner}", "ds", "the axes " + (", ".join(axes) or "none"), "two axes beside the seed", fix)
    left = [name for name in known if name in chosen]
    return rows or left.pop(0), columns or left.pop(0)


def _cells(ax: Any, values: np.ndarray) -> Any:
    """The map of one state."""
    finite = values[np.isfinite(values)]
    low, high = (float(f(finite)) for f in (np.min, np.max)) if finite.size else (0.0, 1.0)
    norm = LogNorm(low, high) if low > 0 and high > 4 * low else Normalize(low, high if high > low else low + 1)
    image = ax.imshow(np.ma.masked_invalid(values), norm=norm, cmap=SEQUENTIAL, aspect="auto", origin="lower")
    ax.grid(False)
    for side in ax.spines.values():
        side.set_visible(False)
    colours = mpl.colormaps[SEQUENTIAL]
    for i, j in np.ndindex(values.shape):
        if np.isinf(values[i, j]):
            ax.text(j, i, "∞", ha="center", va="center", fontsize=11, color=INK)
        elif np.isnan(values[i, j]):
            ax.plot([j - 0.3, j + 0.3], [i - 0.3, i + 0.3], [j - 0.3, j + 0.3], [i + 0.3, i - 0.3], color=ORANGE, lw=1)
        elif values.size <= WRITTEN:
            ink = "white" if lightness(colours(norm(values[i, j]))[:3]) < 55 else INK
            ax.text(j, i, f"{values[i, j]:#.3g}".rstrip("."), ha="center", va="center", fontsize=8, color=ink)
    if finite.size:
        i, j = np.unravel_index(np.nanargmin(values), values.shape)
        ax.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, fill=False, ec=ORANGE, lw=2.6, zorder=4, label="least"))
    return image


def noise_curve(
    ds: Any,
    metric: str = "rmse",
    *,
    axis: str | None = None,
    law: Mapping[str, Numbers] | Numbers | None = None,
    title: str = "",
    figure: Any = None,
) -> Figure:
    """A metric over one axis of a study, the gammas as a rule: the median over the seeds with the band of 5 to 95 %, a panel a
    state and a line for each member of the other axes.

    ds: what `jaxobs.study` returns. axis: one of its axes of numbers, the last of them if not given. law: what theory expects,
    dotted: values along the axis, (points,) or (points, states), or {label of a line: such values}. Axes are logarithmic where
    the numbers are positive and span more than a factor of four. Lanes that diverged are left out; where a quantile is infinite
    there is a gap. ValueError as `noise_map`.
    """
    owner = "noise_curve"
    known = [n for n in points(ds, owner, metric, ("seed", "state", "output", "lag")) if numbers(ds, n) is not None]
    name = axis or (known[-1] if known else "")
    if name not in known:
        fix = "noise_map draws two axes; an axis of one member makes no curve."
        given = "none" if axis is None else repr(axis)
        raise refuse(f"plotting.{owner}", "axis", given, f"an axis of numbers: {', '.join(known) or 'there is none'}", fix)
    found = table(ds, owner, metric)
    place, at = found.axes.index(name), numbers(ds, name)
    assert at is not None
    order = np.argsort(at)
    lines = _lines(ds, owner, found, place)
    quantiles = np.moveaxis(found.quantiles(0.05, 0.5, 0.95), place + 1, -1)[..., order]
    quantiles = np.where(np.isfinite(quantiles), quantiles, np.nan)
    with panels(owner, figure, _wide(found), 1, len(found.words)) as (whole, axes):
        for k, (ax, word) in enumerate(zip(axes[0], found.words, strict=True)):
            for i, (label, member) in enumerate(lines.items()):
                low, middle, high = (q[(*member, k)] for q in quantiles)
                look = series(i, len(lines))
                if found.seeds > 1:
                    ax.fill_between(at[order], low, high, color=look["color"], alpha=0.18, lw=0)
                ax.plot(at[order], middle, marker="o" if len(at) < 25 else None, ms=3.5, label=label or None, **look)
                own = _law(law, label, len(at), len(found.words))
                if own is not None:
                    ax.plot(at[order], own[order, k], color=look["color"], lw=1.1, ls=":")
            _scales(ax, at, quantiles[1][..., k, :])
            ax.set(xlabel=name, ylabel=unit(found, metric, word))
            _legend(ax, law is not None)
        seeds = f"median and 5 to 95 % of {found.seeds} seeds" if found.seeds > 1 else ""
        headline(whole, "; ".join(filter(None, [title, seeds, found.left_out])))
        return root(whole)


def convergence(ds: Any, metric: str = "rmse", *, title: str = "", figure: Any = None) -> Figure:
    """The mean of a metric over the first N seeds against N, with mean +- 1.96 s / sqrt(N), s the deviation over them:
    whether a study has seeds enough. A panel a state, a line for each point of the study's other axes (eight at most:
    choose with ds.sel).

    Lanes that diverged and infinite values are left out, and counted in the title. ValueError for fewer than two seeds, and
    as `noise_map`.
    """
    owner = "convergence"
    found = table(ds, owner, metric)
    if found.seeds < 2:
        fix = "Give the study keys: keys=jaxobs.Seeds(jax.random.key(0), 100)."
        raise refuse(f"plotting.{owner}", "ds", f"{found.seeds} seed", "two seeds or more", fix)
    lines = _lines(ds, owner, found, None)
    with panels(owner, figure, _wide(found), 1, len(found.words)) as (whole, axes):
        for k, (ax, word) in enumerate(zip(axes[0], found.words, strict=True)):
            for i, (label, member) in enumerate(lines.items()):
                count, mean, half = running_mean(found.values[(*member, k)])
                look = series(i, len(lines))
                if not len(count):
                    ax.plot([], [], label=f"{label}: fewer than two numbers".removeprefix(": "), **look)
                    continue
                ax.fill_between(count, mean - half, mean + half, color=look["color"], alpha=0.18, lw=0)
                ax.plot(count, mean, label=f"{label}: {mean[-1]:.4g} ± {half[-1]:.2g}".removeprefix(": "), **look)
            ax.set(xscale="log", xlabel="seeds", ylabel=f"mean {unit(found, metric, word)}")
            log_ticks(ax.xaxis)
            _legend(ax, False)
        headline(whole, "; ".join(filter(None, [title or "mean over the first N seeds, 95 % interval", found.left_out])))
        return root(whole)


def running_mean(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """N, the mean of the first N numbers, 1.96 s_N / sqrt(N), for N = 2, 3, ...; NaN left out."""
    own = values[np.isfinite(values)]
    count = np.arange(1, len(own) + 1)
    mean = np.cumsum(own) / count
    # Around the last mean, so that a small spread on a large mean keeps its digits.
    middle = mean[-1] if len(own) else 0.0
    square = np.cumsum((own - middle) ** 2) - count * (mean - middle) ** 2
    deviation = np.sqrt(np.maximum(square[1:], 0) / np.maximum(count[1:] - 1, 1))
    return count[1:], mean[1:], 1.96 * deviation / np.sqrt(count[1:])


def _lines(ds: Any, owner: str, found: Table, without: int | None) -> dict[str, tuple[Any, ...]]:
    """Label -> the place on all axes but one."""
    axes = [name for i, name in enumerate(found.axes) if i != without]
    sizes = [ds.sizes[name] for name in axes]
    if math.prod(sizes) > LINES:
        given = f"{math.prod(sizes)} lines, on " + ", ".join(f"{n} ({s})" for n, s in zip(axes, sizes, strict=True))
        fix = "Choose with ds.sel or ds.isel; noise_map draws two axes."
        raise refuse(f"plotting.{owner}", "ds", given, f"at most {LINES}", fix)
    words = [labels_of(ds, n) if spelled(ds, n) else [f"{n} = {label}" for label in labels_of(ds, n)] for n in axes]
    places = itertools.product(*map(range, sizes))
    return {", ".join(words[k][i] for k, i in enumerate(place)): place for place in places}


def _wide(found: Table) -> tuple[float, float]:
    return (4.7 * len(found.words) + (0.3 if len(found.words) > 1 else 2.0), 3.9)


def _law(law: Any, label: str, points: int, states: int) -> np.ndarray | None:
    own = law.get(label) if isinstance(law, Mapping) else law
    if own is None:
        return None
    values = np.asarray(own, float)
    values = np.repeat(values[:, None], states, axis=1) if values.shape == (points,) else values
    if values.shape != (points, states):
        fix = "One value a point of the axis, or a column a state."
        raise refuse("plotting.noise_curve", "law", f"shape {np.shape(own)}", f"({points},) or ({points}, {states})", fix)
    return values


def _scales(ax: Any, at: np.ndarray, values: np.ndarray) -> None:
    finite = values[np.isfinite(values)]
    for axis, numbers_, name in ((ax.xaxis, at, "x"), (ax.yaxis, finite, "y")):
        if numbers_.size and np.min(numbers_) > 0 and np.max(numbers_) > 4 * np.min(numbers_):
            (ax.set_xscale if name == "x" else ax.set_yscale)("log")
            log_ticks(axis)
    if len(at) <= 8 and ax.get_xscale() == "log":
        ax.set_xticks(np.sort(at), [f"{value:.3g}" for value in np.sort(at)])
        ax.xaxis.set_minor_locator(NullLocator())


def _legend(ax: Any, law: bool) -> None:
    if law:
        ax.plot([], [], color=INK, lw=1.1, ls=":", label="law")
    if ax.get_legend_handles_labels()[1]:
        ax.legend(loc="best", **WHITE_BOX)
