"""A figure as data: what `report/` draws and a notebook may use otherwise."""

import dataclasses
from typing import Any, Literal

Scale = Literal["linear", "log"]


@dataclasses.dataclass(frozen=True)
class Line:
    """A curve y over x (arrays of one length). style: a matplotlib line style; faint lines go behind."""

    label: str
    x: Any
    y: Any
    style: str = "-"
    faint: bool = False


@dataclasses.dataclass(frozen=True)
class Panel:
    """One pair of axes. ylim [lowest, highest] cuts what would hide the rest."""

    title: str
    xlabel: str
    ylabel: str
    lines: tuple[Line, ...]
    xscale: Scale = "linear"
    yscale: Scale = "linear"
    ylim: tuple[float, float] | None = None


@dataclasses.dataclass(frozen=True)
class Picture:
    """A figure of a paper, recomputed: file name without ending, caption (what is ours is said there), panels side by side."""

    name: str
    caption: str
    panels: tuple[Panel, ...]
