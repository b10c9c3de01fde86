"""Figures 1 to 3 and what q is worth, recomputed."""

import numpy as np

from jaxobs.papers.p000 import experiment, noise
from jaxobs.papers.pictures import Line, Panel, Picture
from jaxobs.tuning import MEASURES, noise_constant

OURS = (
    f"x(0) = (1, 0), estimate from 0, u = 0.5 sin t; noise {experiment.SIGMA:g} held {experiment.PERIOD:g} s: not in the paper"
)


def figure1() -> Picture:
    path = experiment.run(experiment.plain())
    lines = (Line("x2", path.ts, path.x[:, 1], faint=True), Line("estimate", path.ts, path.xhat[:, 1], style="--"))
    panel = Panel("High-gain observer, gamma = 6, alphas (3, 2)", "t", "x2", lines)
    return Picture("000_figure1", f"Figure 1: x2 and its estimate. {OURS}.", (panel,))


def figure2() -> Picture:
    path = experiment.run(experiment.plain(), noisy=True)
    lines = (Line("y", path.ts, path.y[:, 0]), Line("x1", path.ts, path.x[:, 0], style="--"))
    return Picture("000_figure2", f"Figure 2: the noisy output. {OURS}.", (Panel("Output", "t", "y", lines),))


def figure3() -> Picture:
    robust, classical = (experiment.run(one, noisy=True) for one in (experiment.integral(), experiment.plain()))
    panels = [
        Panel(title, "t", "x2", (Line("estimate", p.ts, p.xhat[:, 1]), Line("x2", p.ts, p.x[:, 1], style="--")))
        for title, p in (("q = 2, alphas C(4, k)", robust), ("q = 0, alphas (3, 2)", classical))
    ]
    caption = (
        f"Figure 3: x2 and its estimate by the q-integral observer, beside the classical one; gamma = 6 is ours too. {OURS}."
    )
    return Picture("000_figure3", caption, tuple(panels))


def noise_law() -> Picture:
    """RMS error of x2 over gamma at equal gamma, and relative to (3, 2) at four kinds of equality."""
    gammas = np.geomspace(1.5, 30, 40)
    level = experiment.SIGMA * np.sqrt(experiment.PERIOD * gammas**3)
    named = [("(3, 2)", float(noise_constant(experiment.ALPHAS)))]
    named += [(f"C({2 + q}, k), q = {q}", noise.binomial(q).c) for q in noise.ORDERS]
    law = tuple(Line(name, gammas, level * np.sqrt(c)) for name, c in named)
    table = noise.measured_ratios()
    orders = np.asarray(noise.ORDERS, float)
    law_ratios = {m: [noise.quietest(m, q).ratio for q in noise.ORDERS] for m in MEASURES}
    law_ratios["gamma"] = [noise.binomial(q).ratio for q in noise.ORDERS]  # last: it lies on that of the abscissa
    worth = tuple(
        Line(f"equal {name}", orders, np.asarray(values), style="--" if name == "gamma" else "-")
        for name, values in law_ratios.items()
    )
    seen = tuple(
        Line("measured" if i == 0 else "", orders, np.mean(table[name], axis=1), style="o", faint=True)
        for i, name in enumerate(law_ratios)
    )
    panels = (
        Panel("At equal gamma", "gamma", "RMS error of x2", law, "log", "log"),
        Panel("What q integrators are worth", "q", "RMS error of x2, relative to (3, 2)", (*worth, *seen), ylim=(0.0, 1.3)),
    )
    caption = (
        "Broadband noise: the law sigma sqrt(T_s gamma^3 c), and its value relative to alphas (3, 2) at equal gamma, and with "
        "alphas optimised for each q at equal settling time, squared error and spectral abscissa; dots: measured on the "
        f"pendulum, with the fastest poles held back. {OURS}."
    )
    return Picture("000_noise_law", caption, panels)


PICTURES = (figure1, figure2, figure3, noise_law)
