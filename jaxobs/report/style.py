"""One look for every figure: colours that colour-blind readers tell apart (Okabe and Ito), thin axes, no box."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from cycler import cycler
from matplotlib.figure import Figure

INK, BLUE, ORANGE, GREEN, SKY, PURPLE, GREY = "#222222", "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#CC79A7", "#999999"
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, SKY, INK)

STYLE: dict[Any, Any] = {
    "figure.dpi": 110,
    "figure.constrained_layout.use": True,
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "axes.edgecolor": "#666666",
    "axes.linewidth": 0.7,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.prop_cycle": cycler(color=CYCLE),
    "lines.linewidth": 1.4,
    "legend.frameon": False,
}


@contextmanager
def canvas(width: float, height: float, rows: int = 1, columns: int = 1, **kwargs) -> Iterator[tuple[Figure, Any]]:
    """A figure in the common style, with its axes."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height))  # without pyplot: no global state, no display
        yield figure, figure.subplots(rows, columns, **kwargs)
