"""The figures of the papers: every Picture in the common style."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from jaxobs.papers import Panel, Picture
from jaxobs.plotting.style import GREY, canvas, log_ticks

PANEL_WIDTH, HEIGHT = 5.0, 3.8  # inches
CROWDED = 7  # lines beyond which the legend stands beside the axes


def draw(picture: Picture, folder: Path) -> tuple[Path, str]:
    """One PNG file in the folder, with its caption."""
    path = folder / f"{picture.name}.png"
    count = len(picture.panels)
    columns = min(count, 3)
    rows = -(-count // columns)
    with canvas(max(PANEL_WIDTH * columns, 7.0), HEIGHT * rows, rows, columns, squeeze=False) as (figure, axes):
        for ax, panel in zip(axes.flat, picture.panels, strict=False):
            _panel(ax, panel)
        for ax in list(axes.flat)[count:]:
            ax.set_axis_off()
        figure.savefig(path)
    return path, picture.caption


def draw_all(pictures: Iterable[Picture], folder: Path) -> list[tuple[Path, str]]:
    folder.mkdir(parents=True, exist_ok=True)
    return [draw(picture, folder) for picture in pictures]


def _panel(ax, panel: Panel) -> None:
    for line in panel.lines:
        x, y = np.asarray(line.x), np.asarray(line.y)
        marker = "o" if line.style == "o" else None
        style = "none" if line.style == "o" else line.style
        shade = {"color": GREY, "lw": 3.0, "zorder": 1} if line.faint else {}
        ax.plot(x, y, linestyle=style, marker=marker, ms=4, label=line.label, **shade)
    ax.set(title=panel.title, xlabel=panel.xlabel, ylabel=panel.ylabel, xscale=panel.xscale, yscale=panel.yscale)
    if panel.ylim is not None:
        ax.set_ylim(*panel.ylim)
    for axis, scale in ((ax.xaxis, panel.xscale), (ax.yaxis, panel.yscale)):
        if scale == "log":
            log_ticks(axis)
    if any(line.label for line in panel.lines):
        outside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)} if len(panel.lines) > CROWDED else {}
        ax.legend(fontsize=8, **outside)
