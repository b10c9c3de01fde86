"""The figures of the demo, each a function of the study's data."""

from pathlib import Path

import numpy as np

from jaxobs.demo.pendulum import Pendulum000
from jaxobs.demo.walk import LAST, Row, WalkStudy
from jaxobs.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, canvas

WINDOW = 480  # samples of the last quarter that are drawn: four seconds


def draw(walk: WalkStudy, pendulum: Pendulum000, folder: Path) -> list[tuple[Path, str]]:
    """All figures as PNG files in the folder, each with its caption."""
    paths = [folder / f"{name}.png" for name in ("walk_rate", "walk_table", "pendulum_states", "pendulum_noise")]
    captions = [
        walk_rate(walk, paths[0]),
        walk_table(walk, paths[1]),
        pendulum_states(pendulum, paths[2]),
        pendulum_noise(pendulum, paths[3]),
    ]
    return list(zip(paths, captions, strict=True))


def walk_rate(study: WalkStudy, path: Path) -> str:
    """The rate that nobody measured: gyroscope, chosen observer, simplest tracker."""
    shown = slice(LAST.start, LAST.start + WINDOW)
    ts = study.walk.ts[shown]
    simple = next(i for i, row in enumerate(study.rows) if row.name.startswith("fading memory n = 2"))
    chosen = study.rows.index(study.chosen)
    with canvas(10.0, 5.8, 2, 1, sharex=True, height_ratios=[1, 2]) as (figure, axes):
        axes[0].plot(ts, study.walk.angle[shown], color=INK, lw=1)
        axes[0].set_ylabel("angle [rad]")
        axes[0].set_title("What is measured: the shank's angle, from the magnetometer")
        axes[1].plot(ts, study.walk.rate[shown], color=GREY, lw=3.2, label="gyroscope (the truth, never seen at run time)")
        axes[1].plot(ts, study.rates[simple][shown], color=ORANGE, lw=1, label=_label(study.rows[simple]))
        axes[1].plot(ts, study.rates[chosen][shown], color=BLUE, label=_label(study.chosen))
        axes[1].set(xlabel="time [s]", ylabel="rate [rad/s]", title="What is estimated, causally: its rate")
        figure.legend(loc="outside lower left", ncols=1, fontsize=9)
        figure.savefig(path)
    return "Four seconds of the last quarter; in the legend, the RMSE on the whole of it."


def walk_table(study: WalkStudy, path: Path) -> str:
    """RMSE of every row on the last quarter, with its interval."""
    rows = sorted(study.rows, key=lambda row: -row.rmse)
    place = np.arange(len(rows))
    colour = {"observer": BLUE, "reference": ORANGE, "off-line": GREY}
    with canvas(10.0, 0.27 * len(rows) + 1.2) as (figure, axes):
        for y, row in zip(place, rows, strict=True):
            spread = [[row.rmse - row.rmse_low], [row.rmse_high - row.rmse]]
            filled = "none" if row.tuned == "innovation" else colour[row.kind]
            axes.errorbar(row.rmse, y, xerr=spread, fmt="o", color=colour[row.kind], mfc=filled, ms=5, lw=1.2)
        axes.set_yticks(
            place, [row.name + ("" if row.tuned != "innovation" else ", no gyroscope") for row in rows], fontsize=8.5
        )
        axes.set_xscale("log")
        ticks = [0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0]
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
        axes.set(xlabel="RMSE of the rate on the last quarter [rad/s], 95 % intervals by blocks of one stride")
        axes.set_ylim(-1, len(rows))
        for kind, what in (("observer", "observer"), ("reference", "causal reference"), ("off-line", "off-line, not causal")):
            axes.plot([], [], "o", color=colour[kind], label=what)
        axes.plot([], [], "o", color=BLUE, mfc="none", label="observer tuned without the gyroscope")
        axes.legend(loc="lower left", fontsize=9)
        figure.savefig(path)
    return "Every row of the table, best on top."


def pendulum_states(study: Pendulum000, path: Path) -> str:
    """Figures 1 and 3 of paper 000."""
    with canvas(10.0, 3.4, 1, 2, sharey=True) as (figure, axes):
        one, three, plain = study.figure1, study.figure3, study.figure3_plain
        axes[0].plot(one.ts, one.x[:, 1], color=GREY, lw=3, label="x2")
        axes[0].plot(one.ts, one.xhat[:, 1], color=BLUE, label="estimate, gamma = 6, no noise")
        axes[0].set(title="Figure 1: high-gain observer", xlabel="time", ylabel="x2")
        axes[1].plot(plain.ts, plain.xhat[:, 1], color=ORANGE, lw=0.7, label="q = 0, alphas (3, 2)")
        axes[1].plot(three.ts, three.x[:, 1], color=GREY, lw=3, label="x2")
        axes[1].plot(three.ts, three.xhat[:, 1], color=BLUE, label="q = 2, alphas C(4, k)")
        axes[1].set(title="Figure 3: noise of standard deviation 0.1, gamma = 6", xlabel="time")
        for ax in axes:
            ax.legend(loc="upper right", fontsize=8.5)
            ax.margins(y=0.15)
        figure.savefig(path)
    return "Paper 000, figures 1 and 3, recomputed (x(0) = (1, 0), estimate from 0; the noise level is ours)."


def pendulum_noise(study: Pendulum000, path: Path) -> str:
    """RMSE of x2 against gamma, measured beside the law."""
    with canvas(10.0, 4.2) as (figure, axes):
        for sweep, colour in zip(study.sweeps, (INK, BLUE, GREEN, ORANGE), strict=True):
            low, middle, high = np.quantile(sweep.rmse, [0.05, 0.5, 0.95], axis=1)
            axes.fill_between(sweep.gammas, low, high, color=colour, alpha=0.2, lw=0)
            axes.plot(sweep.gammas, middle, color=colour, label=sweep.name)
            axes.plot(sweep.gammas, sweep.law(), color=colour, lw=1, ls=":")
        axes.set(xscale="log", yscale="log", xlabel="gamma", ylabel="RMSE of x2, t in [10, 20]")
        gammas, seeds = study.sweeps[0].rmse.shape
        axes.set_title(f"{gammas} gammas by {seeds} seeds: median, 5–95 % band, and the law sigma sqrt(T_s gamma³ c) (dotted)")
        ticks = [2, 3, 5, 10, 20, 40]
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
        axes.legend(fontsize=9)
        figure.savefig(path)
    return "At equal gamma, q buys a smaller constant; the exponent stays. The law leaves phi out: it fails at small gamma."


def _label(row: Row) -> str:
    return f"{row.name}: {row.rmse:.3f} rad/s"
