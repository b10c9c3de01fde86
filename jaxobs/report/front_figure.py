"""What a decay rate costs, as a picture."""

import numpy as np
from matplotlib.figure import Figure

from jaxobs.report.style import BLUE, CYCLE, GREY, canvas
from jaxobs.tuning import Front


def front_figure(front: Front, *, title: str = "") -> Figure:
    """Each loss against the rate that is proved, a panel a loss and a colour a weight; filled: no other point is at least as
    good in everything. Every point is certified."""
    names = list(front.points[0].values)
    weights = sorted({one.weight for one in front.points})
    with canvas(4.6 * len(names), 3.6, 1, len(names), squeeze=False) as (figure, axes):
        for ax, name in zip(axes[0], names, strict=True):
            for i, weight in enumerate(weights):
                chosen = [one for one in front.points if one.weight == weight]
                rates, values = np.array([(one.rate, one.values[name]) for one in chosen]).T
                colour = CYCLE[i % len(CYCLE)] if len(weights) > 1 else BLUE
                ax.plot(rates, values, color=colour, lw=1, label=f"weight {weight:g}")
                free = np.array([one.is_dominated for one in chosen])
                ax.scatter(rates, values, s=26, facecolor=np.where(free, "white", colour), edgecolor=colour, zorder=3)
            for rate, _ in front.missing:
                ax.axvline(rate, color=GREY, lw=0.8, ls=":")
            ax.set(xlabel=f"proved rate, {front.unit}", ylabel=name)
        if len(weights) > 1:
            axes[0][0].legend(fontsize=8.5)
        if title:
            figure.suptitle(title, x=0.01, ha="left", fontsize=11)
        return figure
