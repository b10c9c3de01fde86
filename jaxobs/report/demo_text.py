"""The demo's tables and sentences, computed from its rows: for the terminal, the page and --json."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs.demo.pendulum import PERIOD, SIGMA, Pendulum000
from jaxobs.demo.walk import WalkStudy, paired_change
from jaxobs.report.page import Table

QZERO = ((2, "fading memory n = 2 (tracker q = 0)"), (3, "fading memory n = 3 (tracker q = 0)"), (4, "tracker n = 4, q = 0"))


def walk_table(study: WalkStudy) -> Table:
    """Every row, in the order of the choosing block; the chosen observer carries a star."""
    blocks = ["train", "choose", "last", "95 %", "2nd half"]
    header = ["method", "tuned by", "parameters", "free", *blocks, "delay ms", "noise gain"]
    body = []
    for row in sorted(study.rows, key=lambda row: row.rmse_choose):
        numbers = [f"{rmse:.3f}" for rmse in (row.rmse_train, row.rmse_choose, row.rmse)]
        numbers += [f"{row.rmse_low:.3f}–{row.rmse_high:.3f}", f"{row.rmse_second_half:.3f}"]
        tail = [f"{row.delay_ms:.1f}", f"{row.noise_gain:.0f}"]
        mark = " *" if row is study.chosen else ""
        body.append([row.name + mark, row.tuned, row.parameters, str(row.free), *numbers, *tail])
    return header, body


def without(table: Table, column: str) -> Table:
    """The table without a column (a terminal is narrower than a page)."""
    keep = [i for i, name in enumerate(table[0]) if name != column]
    return [table[0][i] for i in keep], [[row[i] for i in keep] for row in table[1]]


def pendulum_table(study: Pendulum000) -> Table:
    """RMSE of x2, median over the seeds, beside its law at four of the gammas; and the law at equal settling time."""
    gammas = _sampled_gammas(study)
    base = study.sweeps[0]
    body = []
    for sweep in study.sweeps:
        at = [int(abs(sweep.gammas - g).argmin()) for g in gammas]
        beside = [f"{np.median(sweep.rmse[i]):.4f} / {sweep.law()[i]:.4f}" for i in at]
        equal = np.sqrt(sweep.c * sweep.settling**3 / (base.c * base.settling**3))
        body.append([sweep.name, f"{sweep.c:.5g}", *beside, f"{sweep.settling:.2f}", f"{equal:.3f}"])
    return ["structure", "c", *[f"gamma {g:.3g}" for g in gammas], "gamma t_s", "noise at equal t_s"], body


def _sampled_gammas(study: Pendulum000) -> list[float]:
    gammas = study.sweeps[0].gammas
    return [float(gammas[round(k * (len(gammas) - 1) / 3)]) for k in range(4)]


def walk_findings(study: WalkStudy) -> list[str]:
    """What did it, and what q and the model are worth, in the numbers of this run."""
    by_gyro = {row.name: row for row in study.rows if row.tuned != "innovation"}
    blind = {row.name: row for row in study.rows if row.tuned == "innovation"}
    chosen = study.chosen
    causal = min((row for row in study.rows if row.kind == "reference"), key=lambda row: row.rmse_choose)

    def change(name: str, against: str) -> str:
        """Relative, with its paired interval."""
        middle, low, high = (100 * value for value in paired_change(study, by_gyro[name], by_gyro[against]))
        return f"{middle:+.0f} % ({low:+.0f} to {high:+.0f})"

    plain, toned = "Luenberger, chain n = 2, free gains", "Luenberger, chain n = 2, free gains + 3 tones"
    taught, leg = "Luenberger, learned leg", "Luenberger, swinging leg, free gains"
    held = by_gyro["high-gain, swinging leg (held samples)"]
    sentences = [
        f"Chosen on the choosing block: {chosen.name}, tuned by {chosen.tuned}. RMSE {chosen.rmse:.3f} rad/s on the last "
        f"quarter ({chosen.rmse_low:.3f}–{chosen.rmse_high:.3f}), {chosen.rmse_second_half:.3f} on the whole second half. The "
        f"causal reference that does best on the choosing block, {causal.name}, has {causal.rmse:.3f} and "
        f"{causal.rmse_second_half:.3f}.",
        "What did it, as changes of the RMSE on the last quarter with paired 95 % intervals: free gains instead of fading "
        f"memory {change(plain, 'fading memory n = 2 (tracker q = 0)')}; then three tones as a model of the noise "
        f"{change(toned, plain)}, or a learned leg as a model of the motion {change(taught, plain)}; both "
        f"{change(taught + ' + 3 tones', plain)}.",
        "What q is worth here, against q = 0, mu tuned for each: "
        + "; ".join(
            f"n = {n}: " + ", ".join(f"q = {q} {change(f'tracker n = {n}, q = {q}', base)}" for q in (1, 2))
            for n, base in QZERO
        )
        + ".",
        f"What a model is worth here: the swinging leg {change(leg, 'Luenberger, chain n = 3, free gains')} against a chain "
        f"with as many states; a learned one, with {by_gyro[taught].free - by_gyro[plain].free} numbers more, see above. The "
        f"swinging leg as a continuous high-gain observer over held samples, whose estimate has not seen y_k, has "
        f"{held.rmse:.3f} (delay {held.delay_ms:.1f} ms against {by_gyro[leg].delay_ms:.1f}).",
        f"{chosen.name} with its numbers tuned without the gyroscope, by the likelihood of its innovations, has "
        f"{blind[chosen.name].rmse:.3f}; its structure was chosen with the gyroscope all the same."
        if chosen.name in blind
        else "",
        "The learned leg knows this walker, this sensor and this pace, and was trained on the first half of the same walk: "
        "it is no general differentiator. It carries no certificate.",
    ]
    return [sentence for sentence in sentences if sentence]


def pendulum_findings(study: Pendulum000) -> list[str]:
    """The verdict, the recomputed numbers of (71), and what the table compares."""
    numbers = ", ".join(f"{name} = {value:.4f}" for name, value in study.numbers.items())
    gammas, seeds = study.sweeps[0].rmse.shape
    return [
        f"Condition (5) at gamma = 6, alphas (3, 2), Lipschitz constant 3/2: {study.verdict.why}.",
        f"Recomputed: {numbers}.",
        "Table: measured RMSE of x2 / its law sigma sqrt(T_s gamma³ c), which leaves out phi and the hold "
        f"(1 << gamma << 1/T_s), for {gammas} gammas by {seeds} seeds, noise of standard deviation {SIGMA} held {PERIOD}.",
        "Equal gamma flatters q, whose errors then settle later: gamma t_s is the time after which e_x2, from e_x1(0) = 1 and "
        "with phi left out, stays below 5 % of its peak, and the last column compares the laws at equal t_s.",
    ]


def as_json(walk: WalkStudy, pendulum: Pendulum000, seconds: dict[str, float]) -> dict[str, Any]:
    """The tables as data: each row with at least name, parameters and rmse."""
    sweeps = [
        {
            "name": f"{sweep.name}, gamma = {gamma:.6g}",
            "parameters": {"gamma": float(gamma), "c": sweep.c},
            "rmse": float(np.median(row)),
            "rmse_root_mean_square": float(np.sqrt(np.mean(row**2))),
            "law": float(law),
            "lanes": len(row),
            "diverged": int(np.sum(~np.isfinite(row))),
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
