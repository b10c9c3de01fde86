"""One look for every figure: colours that colour-blind readers tell apart (Okabe and Ito), thin axes, no box.

Colours alone never carry a meaning: lines of one panel also differ in their dashes, so that a grey print says the same.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure, FigureBase
from matplotlib.figure import Figure as MatplotlibFigure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from jaxobs._module import refuse

INK, BLUE, ORANGE, GREEN, SKY, PURPLE, GREY = "#222222", "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#CC79A7", "#999999"
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, SKY, INK)
DASHES = ("-", (0, (5, 1.6)), (0, (5, 1.4, 1, 1.4)), (0, (1.2, 1.2)), (0, (8, 2)), (0, (3, 1, 1, 1, 1, 1)))
MARKERS = "os^Dv*"
SEQUENTIAL = "cividis"  # for numbers: its lightness grows along the scale, for every kind of colour vision
SIGMAS = 2  # how many standard deviations a band reaches to either side

STYLE: dict[Any, Any] = {
    "figure.dpi": 110,
    "figure.constrained_layout.use": True,
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "axes.edgecolor": "#666666",
    "axes.linewidth": 0.7,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.prop_cycle": cycler(color=CYCLE),
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9,
}
NOTE = 8.5  # points: words inside a panel
WHITE_BOX: dict[str, Any] = {"frameon": True, "facecolor": "white", "edgecolor": "none", "framealpha": 0.85}


class Picture(MatplotlibFigure):
    """A Figure that a notebook shows as it is, without pyplot: no global state, no display needed."""

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.savefig(stream, format="png")
        return stream.getvalue()


@contextmanager
def canvas(width: float, height: float, rows: int = 1, columns: int = 1, **kwargs) -> Iterator[tuple[Figure, Any]]:
    """A figure in the common style, with its axes."""
    with mpl.rc_context(STYLE):
        figure = Picture(figsize=(width, height))
        yield figure, figure.subplots(rows, columns, **kwargs)


@contextmanager
def panels(owner: str, figure: Any, size: tuple[float, float], rows: int, columns: int, **kwargs) -> Iterator[tuple[Any, Any]]:
    """The figure given, or a new one of this size in inches, with its axes as (rows, columns)."""
    if figure is not None and not isinstance(figure, FigureBase):
        fix = "For one panel among others: figure=big.subfigures(1, 2)[0]."
        raise refuse(f"plotting.{owner}", "figure", type(figure).__name__, "a matplotlib Figure or SubFigure", fix)
    with mpl.rc_context(STYLE):
        whole = Picture(figsize=size) if figure is None else figure
        yield whole, whole.subplots(rows, columns, squeeze=False, **kwargs)


@contextmanager
def panel(owner: str, ax: Any, size: tuple[float, float]) -> Iterator[Axes]:
    """The axes given, or those of a new figure of this size in inches."""
    if ax is not None and not isinstance(ax, Axes):
        fix = "It is what figure.subplots() returns; this picture has one panel."
        raise refuse(f"plotting.{owner}", "ax", type(ax).__name__, "matplotlib Axes", fix)
    with mpl.rc_context(STYLE):
        yield Picture(figsize=size).subplots() if ax is None else ax


def root(part: Any) -> Figure:
    """The whole figure that axes or a part of a figure belong to."""
    return part.get_figure(root=True)


def series(i: int, count: int = 1, *, ordered: bool = False) -> dict[str, Any]:
    """Colour and dashes of line i of `count`. ordered: the lines have numbers (a grid of gammas), from dark to light."""
    if ordered and count > 2:
        return {"color": mpl.colormaps[SEQUENTIAL](0.75 * i / (count - 1)), "linestyle": DASHES[i % 3]}
    return {"color": CYCLE[i % len(CYCLE)], "linestyle": DASHES[(i + i // len(CYCLE)) % len(DASHES)]}


def lightness(colour: Any) -> float:
    """L* of CIELAB, 0 (black) to 100 (white): what is left of a colour in a grey print."""
    rgb = np.asarray(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    y = float(linear @ np.array([0.2126, 0.7152, 0.0722]))
    return 116 * y ** (1 / 3) - 16 if y > 0.008856 else 903.3 * y


def headline(figure: Any, title: str) -> None:
    """The title of the whole figure, at its left."""
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=11)


def below(figure: Any, columns: int = 5) -> None:
    """One legend for all panels, under them, each label once."""
    found: dict[str, Any] = {}
    for ax in figure.axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if found:
        figure.legend(found.values(), found.keys(), loc="outside lower center", ncols=min(columns, len(found)))


def log_ticks(axis: Any) -> None:
    """Of a logarithmic axis over less than two decades: 1, 2, 5 in plain numbers; else powers of ten."""
    low, high = axis.get_view_interval()
    axis.set_minor_formatter(NullFormatter())
    if high < 100 * low:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
