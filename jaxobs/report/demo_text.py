"""The demo's tables and sentences, computed from its rows: for the terminal, the page and --json."""

import dataclasses
from typing import Any

from jaxobs.demo.pendulum import PERIOD, SIGMA, Pendulum000
from jaxobs.demo.walk import Row, WalkStudy

Table = tuple[list[str], list[list[str]]]


def walk_table(study: WalkStudy) -> Table:
    """Every row, in the order of the choosing block; the chosen observer carries a star."""
    header = [
        "method",
        "tuned by",
        "parameters",
        "free",
        "train",
        "choose",
        "last",
        "95 %",
        "2nd half",
        "delay ms",
        "noise gain",
    ]
    body = []
    for row in sorted(study.rows, key=lambda row: row.rmse_choose):
        numbers = [
            f"{row.rmse_train:.3f}",
            f"{row.rmse_choose:.3f}",
            f"{row.rmse:.3f}",
            f"{row.rmse_low:.3f}–{row.rmse_high:.3f}",
        ]
        tail = [f"{row.rmse_second_half:.3f}", f"{row.delay_ms:.1f}", f"{row.noise_gain:.0f}"]
        mark = " *" if row is study.chosen else ""
        body.append([row.name + mark, row.tuned, row.parameters, str(row.free), *numbers, *tail])
    return header, body


def without(table: Table, column: str) -> Table:
    """The table without a column (a terminal is narrower than a page)."""
    keep = [i for i, name in enumerate(table[0]) if name != column]
    return [table[0][i] for i in keep], [[row[i] for i in keep] for row in table[1]]


def pendulum_table(study: Pendulum000) -> Table:
    """RMSE of x2, median over the seeds, beside its law, at four of the gammas."""
    header = ["structure", "c", *[f"gamma {g:.3g}" for g in _sampled_gammas(study)]]
    body = []
    for sweep in study.sweeps:
        at = [int(abs(sweep.gammas - g).argmin()) for g in _sampled_gammas(study)]
        median = [float(sorted(sweep.rmse[i])[sweep.rmse.shape[1] // 2]) for i in at]
        body.append(
            [sweep.name, f"{sweep.c:.5g}", *[f"{m:.4f} / {sweep.law()[i]:.4f}" for m, i in zip(median, at, strict=True)]]
        )
    return header, body


def _sampled_gammas(study: Pendulum000) -> list[float]:
    gammas = study.sweeps[0].gammas
    return [float(gammas[round(k * (len(gammas) - 1) / 3)]) for k in range(4)]


def walk_findings(study: WalkStudy) -> list[str]:
    """What did it, and what q and the model are worth, in the numbers of this run."""
    by_gyro = {row.name: row for row in study.rows if row.tuned != "innovation"}
    without = {row.name: row for row in study.rows if row.tuned == "innovation"}
    chosen = study.chosen
    fir = by_gyro["causal least-squares FIR, 80 taps"]
    sentences = [
        f"Chosen on the choosing block: {chosen.name}, tuned by {chosen.tuned}. RMSE {chosen.rmse:.3f} rad/s on the last "
        f"quarter ({chosen.rmse_low:.3f}–{chosen.rmse_high:.3f}), {chosen.rmse_second_half:.3f} on the whole second half; the "
        f"best causal reference, an 80-tap FIR filter, has {fir.rmse:.3f} and {fir.rmse_second_half:.3f}.",
        "What did it: " + _steps(by_gyro) + ".",
        f"Without any gyroscope, by the likelihood of its own innovations, {chosen.name} has {without[chosen.name].rmse:.3f}."
        if chosen.name in without
        else "",
        _worth_of_q(by_gyro),
        _worth_of_models(by_gyro),
        "The learned leg knows this walker, this sensor and this pace, and was trained on the first half of the same walk: "
        "it is no general differentiator. It carries no certificate.",
    ]
    return [sentence for sentence in sentences if sentence]


def _steps(rows: dict[str, Row]) -> str:
    names = (
        "fading memory n = 2 (tracker q = 0)",
        "Luenberger, chain n = 2, free gains",
        "Luenberger, chain n = 2, free gains + 3 tones",
        "Luenberger, learned leg",
        "Luenberger, learned leg + 3 tones",
    )
    return ", then ".join(f"{name} {rows[name].rmse:.3f}" for name in names if name in rows)


def _worth_of_q(rows: dict[str, Row]) -> str:
    parts = []
    for n in (2, 3, 4):
        base = rows[f"fading memory n = {n} (tracker q = 0)" if n < 4 else "tracker n = 4, q = 0"].rmse
        others = [f"q = {q} {100 * (rows[f'tracker n = {n}, q = {q}'].rmse / base - 1):+.0f} %" for q in (1, 2)]
        parts.append(f"n = {n}: {', '.join(others)}")
    return "What q is worth here (change of the RMSE against q = 0, mu tuned for each): " + "; ".join(parts) + "."


def _worth_of_models(rows: dict[str, Row]) -> str:
    def change(name: str, against: str) -> str:
        return f"{100 * (rows[name].rmse / rows[against].rmse - 1):+.0f} %"

    leg, held = rows["Luenberger, swinging leg, free gains"], rows["high-gain, swinging leg (held samples)"]
    return (
        "What a model is worth here: a swinging leg inside the observer "
        f"{change(leg.name, 'Luenberger, chain n = 3, free gains')} against no model with as many states, a learned one "
        f"{change('Luenberger, learned leg', 'Luenberger, chain n = 2, free gains')}. The same leg as a continuous high-gain "
        f"observer over held samples, whose estimate has not seen y_k, has {held.rmse:.3f} (delay {held.delay_ms:.1f} ms "
        f"against {leg.delay_ms:.1f})."
    )


def pendulum_findings(study: Pendulum000) -> list[str]:
    numbers = ", ".join(f"{name} = {value:.4f}" for name, value in study.numbers.items())
    gammas, seeds = study.sweeps[0].rmse.shape
    return [
        f"Condition (5) at gamma = 6, alphas (3, 2), Lipschitz constant 3/2: {study.verdict.why}.",
        f"Recomputed: {numbers}.",
        "Table: measured RMSE of x2 / its law sigma sqrt(T_s gamma³ c), which leaves out phi and the hold "
        f"(1 << gamma << 1/T_s), for {gammas} gammas by {seeds} seeds, noise of standard deviation {SIGMA} held {PERIOD}.",
    ]


def as_json(walk: WalkStudy, pendulum: Pendulum000, seconds: dict[str, float]) -> dict[str, Any]:
    """The tables as data: each row with at least name, parameters and rmse."""
    sweeps = [
        {
            "name": f"{sweep.name}, gamma = {gamma:.6g}",
            "parameters": {"gamma": float(gamma), "c": sweep.c},
            "rmse": float((row**2).mean() ** 0.5),
            "law": float(law),
        }
        for sweep in pendulum.sweeps
        for gamma, row, law in zip(sweep.gammas, sweep.rmse, sweep.law(), strict=True)
    ]
    return {
        "walk": [dataclasses.asdict(row) for row in walk.rows],
        "chosen": walk.chosen.name,
        "pendulum": {"condition5": {"holds": pendulum.verdict.holds, **pendulum.numbers}, "sweeps": sweeps},
        "seconds": seconds,
    }
