"""The frontier as a picture: noise against proved rate, from above and from below, with the papers' gains on it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from jaxobs.bench.frontier import Curve, Point
from jaxobs.bench.growth import COVERS
from jaxobs.bench.rows import GainRow
from jaxobs.bench.run import SynthesisBench
from jaxobs.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, canvas

COLOUR = {2: PURPLE, 3: GREEN, 4: ORANGE, 5: BLUE}


def draw(bench: SynthesisBench, folder: Path) -> list[tuple[Path, str]]:
    """The PNG files of the bench, each with its caption."""
    folder.mkdir(parents=True, exist_ok=True)
    frontier, growth = folder / "synthesis_frontier.png", folder / "synthesis_growth.png"
    return [(frontier, draw_frontier(bench, frontier)), (growth, draw_growth(bench, growth))]


def draw_frontier(bench: SynthesisBench, path: Path) -> str:
    strengths = sorted({curve.k_f for curve in bench.curves})
    size = (5.6 * len(strengths) + 0.4, 7.6)
    with canvas(*size, 2, len(strengths), squeeze=False, sharex=True, sharey="row", height_ratios=[2.6, 1]) as (figure, axes):
        for k, k_f in enumerate(strengths):
            own = [curve for curve in bench.curves if curve.k_f == k_f and curve.points]
            rivals = [pair.theirs for pair in bench.pairs if pair.theirs.problem == f"k_f = {k_f:g}" and pair.theirs.level]
            _noise(axes[0, k], own, rivals)
            _price(axes[1, k], own)
            axes[0, k].set_title(f"Chain of n states, slopes within ±{k_f:g}/n")
        axes[0, 0].set_ylabel("noise of the estimate, sqrt(E |e|²)")
        axes[1, 0].set_ylabel("price of proof,\nsolid / dotted")
        _legend(axes[0, 0])
        figure.savefig(path)
    return (
        "Noise, under unit measurement noise and unit noise on the last state, against proved decay rate. Solid: gains "
        "certified for all rho(t); dotted: the best found for one constant rho at that rate; dashed: the proved floor "
        "below which no causal observer comes at that rho. Marks: gains of paper 002, n = 5, with their j0, at what is proved "
        "of them. Below: certified over found, the price of one gain with a proof for all rho(t)."
    )


def _noise(ax, curves: Sequence[Curve], rivals: Sequence[GainRow]) -> None:
    for curve in curves:
        colour = COLOUR.get(curve.n, INK)
        rates = np.array([one.rate for one in curve.points])
        levels, frozen = (np.array([getattr(one, name) for one in curve.points]) for name in ("level", "frozen"))
        ax.fill_between(rates, frozen, levels, color=colour, alpha=0.13, lw=0)
        ax.plot(rates, levels, color=colour, lw=1.9)
        ax.plot(rates, frozen, color=colour, lw=1.1, ls=":")
        ax.plot(rates, np.full(len(rates), curve.floor), color=colour, lw=0.9, ls="--")
        end = (rates[-1], levels[-1])
        ax.annotate(f"n = {curve.n}", end, xytext=(5, 0), textcoords="offset points", color=colour, va="center")
    ax.set(xscale="log", yscale="log")
    fastest, loudest = (max((f(curve.points[-1]) for curve in curves), default=1.0) for f in (_rate, _level))
    beyond = [one for one in rivals if _rate(one) > 1.3 * fastest or _level(one) > 10 * loudest]
    for (word, marker), (place, side) in zip(MARKERS.items(), (((-6, 3), "right"), ((5, -9), "left")), strict=True):
        for one in rivals:
            if one.method.startswith(word) and one not in beyond:
                ax.plot(one.rate, one.level, marker, color=INK, mfc="white", ms=6, zorder=4)
                where = {"xytext": place, "textcoords": "offset points", "ha": side}
                ax.annotate(_j0(one), (one.rate, one.level), fontsize=8.5, color=INK, **where)
    lines = [f"{one.method.partition(',')[0]} lies beyond, at {_rate(one):.3g} /s and {_level(one):.1e}" for one in beyond]
    ax.text(0.99, 0.01, "\n".join(lines), transform=ax.transAxes, ha="right", va="bottom", fontsize=8, color=INK)


MARKERS = {"printed": "o", "HG/LMI": "^"}


def _legend(ax) -> None:
    styles = {"certified for all rho(t)": ("-", 1.9), "best found, one constant rho": (":", 1.1), "floor, proved": ("--", 0.9)}
    for label, (style, width) in styles.items():
        ax.plot([], [], style, color=INK, lw=width, label=label)
    for word, marker in MARKERS.items():
        ax.plot([], [], marker, color=INK, mfc="white", ms=6, label=f"{word} gain, n = 5, j0 beside it")
    ax.legend(loc="upper left", fontsize=8.5)


def _price(ax, curves: Sequence[Curve]) -> None:
    for curve in curves:
        rates = [one.rate for one in curve.points]
        ax.plot(rates, [one.level / one.frozen for one in curve.points], color=COLOUR.get(curve.n, INK))
    ax.set(xscale="log", yscale="log", xlabel="proved decay rate [1/s]")
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())


def _rate(one: Point | GainRow) -> float:
    return one.rate or 0.0


def _level(one: Point | GainRow) -> float:
    return one.level or 0.0


def _j0(one: GainRow) -> str:
    return one.method.partition("j0 = ")[2].partition(",")[0]


def draw_growth(bench: SynthesisBench, path: Path) -> str:
    """Seconds of the design and of the check, a line a cover."""
    with canvas(7.0, 4.2) as (figure, ax):
        for cover, colour, marker in zip(COVERS, (BLUE, GREEN, ORANGE), "os^", strict=True):
            own = [one for one in bench.growth if one.cover == cover]
            ax.plot(
                [one.n for one in own], [one.design for one in own], f"-{marker}", color=colour, ms=5, label=f"{cover}: design"
            )
            checked = [one for one in own if one.check]
            ax.plot(
                [one.n for one in checked],
                [one.check for one in checked],
                f":{marker}",
                color=colour,
                ms=4,
                mfc="white",
                label=f"{cover}: exact check",
            )
        ax.axhline(bench.budget, color=GREY, lw=1, ls="--")
        ax.set(yscale="log", xlabel="states n (2ⁿ corners)", ylabel="seconds", title="What each way of covering the box costs")
        ax.legend(fontsize=8.5)
        figure.savefig(path)
    return f"Seconds of a design and of its exact check; the dashed line is the budget of {bench.budget:g} s."
