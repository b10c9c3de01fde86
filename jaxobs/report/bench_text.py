"""The synthesis bench in tables and sentences, computed from its rows."""

import dataclasses
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

from jaxobs.bench.growth import COVERS, RATE, STRENGTH, last_practical
from jaxobs.bench.rows import GainRow, Pair
from jaxobs.bench.run import SynthesisBench

Table = tuple[str, list[str], list[list[str]]]  # heading, header, cells


def tables(bench: SynthesisBench) -> list[Table]:
    """All of them, in the order of the bench."""
    return [*chain_tables(bench.pairs), least_table(bench), dmvt_table(bench), frontier_table(bench), growth_table(bench)]


def chain_tables(pairs: Sequence[Pair]) -> list[Table]:
    """One a k_f: each gain from elsewhere, and under it ours at the rate that is proved for it."""
    header = [
        "gain", "proved rate /s", "guaranteed", "nominal", "x1", "x2", "x3", "x4", "x5", "|L|", "peak", "design s", "verdict",
        "ours / theirs",
    ]  # fmt: skip
    found = []
    for problem in dict.fromkeys(pair.theirs.problem for pair in pairs):
        cells = []
        for pair in pairs:
            if pair.theirs.problem == problem:
                cells.append([*_gain_cells(pair.theirs), ""])
                if pair.ours is not None:
                    cells.append([*_gain_cells(pair.ours), f"{_number(pair.ratio, 3)} {pair.outcome}"])
                elif pair.theirs.level is not None:
                    cells.append(["ours", *[""] * 11, "not certified", pair.outcome])
        found.append(
            (f"Paper 002, chain of 5 states, {problem}: sqrt(E |e|^2) and standard deviations under unit noise", header, cells)
        )
    return found


def _gain_cells(one: GainRow) -> list[str]:
    numbers = [one.rate, one.level, one.nominal, *one.channels, one.norm, one.peak]
    name = "  ours, same rate" if one.method.startswith("ours") else one.method
    return [name, *(_number(x) for x in numbers), _number(one.seconds, 2), one.verdict]


def least_table(bench: SynthesisBench) -> Table:
    cells = [
        [
            f"{one.k_f}",
            _number(one.norm, 4),
            _number(one.floor, 4),
            _number(one.norm / one.floor, 3),
            _number(one.seconds, 2),
            one.verdict,
        ]
        for one in bench.least
    ]
    header = ["k_f", "|L| certified", "floor, proved", "ratio", "design s", "verdict"]
    return (
        "The smallest gain: certified for the whole box, and what every gain exceeds whose frozen errors decay",
        header,
        cells,
    )


def dmvt_table(bench: SynthesisBench) -> Table:
    header = ["example", "bound", "gain", "L", "|L|", "proved rate", "H2", "L2", "frozen", "verdict"]
    cells = []
    for one in bench.dmvt:
        numbers = [_number(one.norm), _number(one.rate, 6 if one.is_step else 3), *map(_number, (one.h2, one.l2, one.frozen))]
        cells.append([one.example, one.bound, one.method, _matrix(one.gain), *numbers, one.verdict])
    title = "Paper 004: printed and ours at the same bound, rate (1/s; Lorenz: factor a step) and relaxation, under unit noise"
    return title, header, cells


def frontier_table(bench: SynthesisBench) -> Table:
    header = ["k_f", "n", "proved rate /s", "certified", "found at frozen rho", "floor, proved", "certified / floor", "verdict"]
    cells = [
        [
            f"{curve.k_f:g}", f"{curve.n}", _number(one.rate), _number(one.level, 4), _number(one.frozen, 4),
            _number(curve.floor, 4), _number(one.level / curve.floor), one.verdict,
        ]
        for curve in bench.curves
        for one in curve.points
    ]  # fmt: skip
    return "The frontier: sqrt(E |e|^2) against proved rate, from both sides", header, cells


def growth_table(bench: SynthesisBench) -> Table:
    header = ["n", "corners", *(f"{cover}: {what}" for cover in COVERS for what in ("design s", "check s", "level"))]
    rows = {(one.n, one.cover): one for one in bench.growth}
    cells = []
    for n in sorted({one.n for one in bench.growth}):
        line = [f"{n}", f"{2**n}"]
        for cover in COVERS:
            one = rows.get((n, cover))
            line += ["", "", ""] if one is None else [_number(one.design, 2), _number(one.check, 2), _number(one.level, 4)]
        cells.append(line)
    return f"Seconds as the state grows: chain, k_f = {STRENGTH:g}, proved rate {RATE:g} /s", header, cells


def findings(bench: SynthesisBench) -> list[str]:
    """Who wins, how far apart the two sides are, where each cover ends."""
    counts = Counter(pair.outcome for pair in bench.pairs)
    rivals = [pair for pair in bench.pairs if pair.ratio is not None]
    words = [
        f"At equal proved rate ours wins {counts['wins']}, ties {counts['ties']} and loses {counts['loses']} of {len(rivals)} "
        f"against gains that have a proof; {counts['neither proved']} printed gains have none."
    ]
    if rivals:
        best, worst = min(rivals, key=lambda p: p.ratio or 1), max(rivals, key=lambda p: p.ratio or 1)
        words.append(
            f"Guaranteed noise, ours over theirs: from {best.ratio:.3g} ({best.theirs.problem}, {best.theirs.method}) to "
            f"{worst.ratio:.3g} ({worst.theirs.problem}, {worst.theirs.method})."
        )
    for curve in bench.curves:
        if curve.points:
            low = min(curve.points, key=lambda one: one.level)
            words.append(
                f"n = {curve.n}, k_f = {curve.k_f:g}: the quietest certified gain has {low.level:.4g}, the floor is "
                f"{curve.floor:.4g}: a factor {low.level / curve.floor:.3g}."
            )
    for cover in COVERS:
        last = last_practical(bench.growth, cover, bench.budget)
        if last is not None:
            words.append(f"{cover}: practical (at most {bench.budget:g} s a design) up to n = {last}, of those tried.")
    verdicts = Counter(bool(proof.verify()) for _, proof in bench.certificates())
    words.append(f"Certificates checked again in exact arithmetic: {verdicts[True]} hold, {verdicts[False]} do not.")
    return words


def as_json(bench: SynthesisBench) -> dict[str, Any]:
    """Plain objects without the certificates; numbers that are not finite become their names."""
    return {
        "chain": [
            {"theirs": _plain(pair.theirs), "ours": _plain(pair.ours), "ratio": pair.ratio, "outcome": pair.outcome}
            for pair in bench.pairs
        ],
        "least_gain": [_plain(one) for one in bench.least],
        "examples": [_plain(one) for one in bench.dmvt],
        "frontier": [_plain(one) for one in bench.curves],
        "growth": [_plain(one) for one in bench.growth],
        "budget": bench.budget,
        "seconds": bench.seconds,
    }


HIDDEN = ("certificate", "certificates", "below")


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        fields = [field.name for field in dataclasses.fields(value) if field.name not in HIDDEN]
        return {name: _plain(getattr(value, name)) for name in fields}
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _number(x: float | None, digits: int = 3) -> str:
    return "-" if x is None else f"{x:.{digits}g}"


def _matrix(rows: Sequence[Sequence[float]]) -> str:
    """Row by row, a state a row."""
    return "; ".join(" ".join(f"{x:.4g}" for x in row) for row in rows)
