"""Runs, searches and fronts as plotly figures, in the colours of the pictures."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from matplotlib.colors import to_rgb
from plotly.subplots import make_subplots

from jaxobs.plotting._runs import Runs
from jaxobs.plotting.estimates import measured_states, several_truths
from jaxobs.plotting.style import BLUE, CYCLE, GREY, INK, ORANGE, SKY
from jaxobs.report.page import Chart
from jaxobs.tuning import Front, Tuned

DASH = ("solid", "dash", "dashdot", "dot", "longdash", "longdashdot")
SYMBOL = ("circle", "square", "triangle-up", "diamond", "triangle-down", "star")
SAMPLES = 4000  # of a run beyond which every second, third, ... is drawn
AXIS: dict[str, Any] = {"gridcolor": "#e6e6e6", "linecolor": "#666", "zeroline": False, "automargin": True, "ticks": "outside"}
LAYOUT: dict[str, Any] = {
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
    "paper_bgcolor": "white", "plot_bgcolor": "white", "colorway": list(CYCLE),
    "margin": {"l": 56, "r": 14, "t": 14, "b": 44},
    "legend": {"orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom", "x": 0, "font": {"size": 12}},
    "hovermode": "x unified", "dragmode": "zoom", "xaxis": AXIS, "yaxis": AXIS,
}  # fmt: skip


def trajectory(runs: Runs, names: Sequence[str], caption: str) -> Chart:
    """Estimate over truth, a panel a state on one time axis, with a range slider; of several runs the median and their band."""
    rows = runs.n
    step = -(-len(runs.ts) // SAMPLES)
    ts, good = runs.ts[::step], runs.finite
    good = good if good.any() else np.arange(runs.count) == 0  # all diverged: the first one, as far as it goes
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.05)
    outputs = {i: j for j, i in measured_states(runs).items()} if runs.count == 1 else {}
    legend: set[str] = set()
    apart = several_truths(runs)  # no one curve is the truth: the errors are shown
    what = "error" if apart else "estimate"

    def add(row: int, name: str, y: Any, x: Any = ts, **look: Any) -> None:
        shown = {"showlegend": name not in legend, "legendgroup": name, "name": name}
        legend.add(name)
        figure.add_trace(go.Scatter(x=x, y=y, **shown, **look), row=row, col=1)

    for i in range(rows):
        xhat = runs.xhat[good][:, ::step, i]
        if apart and runs.x is not None:
            xhat = xhat - runs.x[good][:, ::step, i]
        elif runs.x is not None:
            add(i + 1, "truth", runs.x[0, ::step, i], mode="lines", line={"color": "#b5b5b5", "width": 4})
        if i in outputs and runs.y is not None and runs.valid is not None:
            seen = np.where(runs.valid[0, ::step, outputs[i]], runs.y[0, ::step, outputs[i]], np.nan)
            add(i + 1, "measurement", seen, mode="markers", marker={"color": INK, "size": 3, "opacity": 0.45})
        if len(xhat) > 1:
            low, middle, high = np.quantile(xhat, [0.05, 0.5, 0.95], axis=0)
            band = {"fill": "toself", "fillcolor": _faint(SKY), "line": {"width": 0}, "hoverinfo": "skip", "mode": "lines"}
            add(i + 1, f"5 to 95 % of {len(xhat)} runs", np.append(low, high[::-1]), np.append(ts, ts[::-1]), **band)
            add(i + 1, f"median {what}", middle, mode="lines", line={"color": BLUE, "width": 1.8})
        else:
            add(i + 1, what, xhat[0], mode="lines", line={"color": BLUE, "width": 1.8})
        figure.update_yaxes(AXIS | {"title": {"text": f"error of {names[i]}" if apart else names[i]}}, row=i + 1, col=1)
    figure.update_xaxes(AXIS)
    figure.update_xaxes(title="time [s]", rangeslider={"visible": True, "thickness": 0.06}, row=rows, col=1)
    _lay(figure, 150 * rows + 230, margin=LAYOUT["margin"] | {"b": 96})
    if step > 1:
        caption += f" Drawn is one sample of {step}."
    return Chart(str(figure.to_json()), caption)


def history(tuned: Tuned) -> Chart:
    """The loss of every start over the steps, and the least so far."""
    h = tuned.history
    steps = np.arange(h.loss.shape[1])
    figure = go.Figure()
    for i, loss in enumerate(np.where(h.good & np.isfinite(h.loss), h.loss, np.nan)):
        name = "from the gain before" if i == 0 else f"start {i}"
        look = {"color": CYCLE[i % len(CYCLE)], "width": 1, "dash": DASH[i % len(DASH)]}
        figure.add_trace(go.Scatter(x=steps, y=loss, mode="lines", name=name, line=look))
    least = np.min(h.best, axis=0)
    least = np.where(np.isfinite(least), least, np.nan)
    figure.add_trace(go.Scatter(x=steps, y=least, mode="lines", name="least so far", line={"color": INK, "width": 2.4}))
    figure.add_hline(tuned.first_loss, line={"color": GREY, "dash": "dash", "width": 1})
    shown = np.append(h.loss[h.good], tuned.first_loss)
    kind = "log" if np.min(shown) > 0 and np.max(shown) > 8 * np.min(shown) else "linear"
    figure.update_yaxes(AXIS | {"title": {"text": "loss"}, "type": kind})
    figure.update_xaxes(AXIS | {"title": {"text": "step"}})
    _lay(figure, 440, margin=LAYOUT["margin"] | {"b": 100})
    return Chart(str(figure.to_json()), "The loss over the steps of the search; the dashed line is the gain before.")


def front(found: Front) -> list[Chart]:
    """Each loss against the proved rate."""
    charts = []
    for name in found.points[0].values:
        figure = go.Figure()
        for i, weight in enumerate(sorted({one.weight for one in found.points})):
            own = [one for one in found.points if one.weight == weight]
            colour, symbol = CYCLE[i % len(CYCLE)], SYMBOL[i % len(SYMBOL)]
            marks = [symbol + ("-open" if one.is_dominated else "") for one in own]
            rates, values = [one.rate for one in own], [one.values[name] for one in own]
            look: dict[str, Any] = {"color": colour, "dash": DASH[i % len(DASH)]}
            mark = {"symbol": marks, "size": 9, "color": colour}
            words = f"weight {weight:g}"
            figure.add_trace(go.Scatter(x=rates, y=values, mode="lines+markers", name=words, line=look, marker=mark))
        for rate, _ in found.missing:
            figure.add_vline(rate, line={"color": ORANGE, "dash": "dot", "width": 1})
        figure.update_xaxes(AXIS | {"title": {"text": f"proved rate, {found.unit}"}})
        figure.update_yaxes(AXIS | {"title": {"text": name}})
        _lay(figure, 420, margin=LAYOUT["margin"] | {"b": 90})
        words = f"The loss {name} against the rate that is proved. Filled: no other point is at least as good in everything."
        charts.append(Chart(str(figure.to_json()), words))
    return charts


def _lay(figure: go.Figure, height: int, **more: Any) -> None:
    shared = {name: value for name, value in LAYOUT.items() if name not in ("xaxis", "yaxis")}
    figure.update_layout(template="none", height=height, autosize=True, **(shared | more))


def _faint(colour: str) -> str:
    red, green, blue = (round(255 * part) for part in to_rgb(colour))
    return f"rgba({red},{green},{blue},0.4)"
