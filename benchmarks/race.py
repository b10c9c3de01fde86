"""Is a study as fast as a specialist's C? One interleaved run against C, numba, NumPy, diffrax and scipy.

Every contender computes the same study: equal precision, method, number of steps and law of the noise, metrics only. Each lives
in a process of its own; one computes at a time, round after round, and ratios are taken within a round, because a shared
machine changes its speed from one second to the next. Time to the first result is apart. The results are compared: without
noise lane by lane, with noise by a z-score.
Run: python benchmarks/race.py [--workload pendulum|chain|tracker] [--quick] [--json FILE]
"""

import argparse
import dataclasses
import itertools
import json
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from _c import DTYPES, NoCompiler, Reference, build, inspect
from _contenders import CONTENDERS, CORES, Contender, Entry, Failed, compare
from _job import SIGMA, STUDIES, Job
from _verify import verify

SHORTEST = 0.2  # [s] a run is repeated until it takes that long
SLOW, SLOW_ROUNDS = 3.0, 3  # [s] longer runs take part in fewer rounds
LONG_ENOUGH = 1000  # [steps] shorter runs are start-up, above all of the tracker
FAR_AHEAD = 3.0  # the vector build of the C against its scalar build


@dataclasses.dataclass
class Row:
    """One contender on one job; times in ns per lane-step, one for each round it took part in."""

    job: Job
    contender: str
    times: list[float]
    first: float
    peak: float
    ratios: dict[str, list[float]] = dataclasses.field(default_factory=dict)
    agreement: Any = None
    left_out: str = ""

    @property
    def median(self) -> float:
        return statistics.median(self.times)


def spread(values: list[float]) -> tuple[float, float, float]:
    """Lower quartile, median, upper quartile."""
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    return float(low), float(middle), float(high)


def contest(job: Job, entries: list[Entry], rounds: int, folder: Path) -> list[Row]:
    """All contenders of one job, round robin."""
    rows, work = [], job.lanes * job.steps
    racing: list[tuple[Entry, Row, int, int]] = []
    for entry in entries:
        row = Row(job, entry.contender.label, [], float("nan"), float("nan"))
        rows.append(row)
        try:
            row.first = entry.prepare(dataclasses.replace(job, seed=len(rows)))  # streams of their own
            once = entry.ask("run", 1)["seconds"]
        except Failed as error:
            row.left_out = str(error) + (f" (needs {entry.contender.needs})" if entry.contender.needs else "")
            continue
        racing.append((entry, row, max(1, int(SHORTEST / once)), SLOW_ROUNDS if once > SLOW else rounds))
    saved = {}
    for turn in range(rounds):
        for entry, row, repeats, turns in racing:
            if turn < turns:
                row.times.append(entry.ask("run", repeats)["seconds"] / work * 1e9)
    for entry, row, _, _ in racing:
        path = folder / "result.npz"
        row.peak = entry.ask("save", str(path))["peak"]
        with np.load(path) as data:
            saved[row.contender] = data["rmse"], data["lanes"]
        lanes = len(saved[row.contender][1])
        row.times = [time * job.lanes / lanes for time in row.times]  # a few lanes stood for all
    base = "C" if "C" in saved else next(iter(saved))
    for entry, row, _, _ in racing:
        allowed = dict(entry.contender.other_method).get(job.workload, 0.0)
        if row.contender != base:
            row.agreement = compare(job, *saved[row.contender], saved[base][0], allowed)
        for rival in (rival for _, rival, _, _ in racing):
            row.ratios[rival.contender] = [mine / theirs for mine, theirs in zip(row.times, rival.times, strict=False)]
    return rows


def show(rows: list[Row]) -> None:
    job = rows[0].job
    noise = f"noise {job.sigma:g}" if job.sigma else "no noise"
    print(f"\n{job.workload}, {job.precision}, {noise}, {job.lanes:,} lanes x {job.steps:,} steps")
    print(f"{'':12}{'ns per lane-step':>30}{'x C':>30}{'x jaxobs':>26}{'first s':>9}{'MB':>7}  same numbers")
    for row in rows:
        if row.left_out:
            print(f"{row.contender:12}  left out: {row.left_out.splitlines()[0]}")
            continue
        low, middle, high = spread(row.times)
        cells = [f"{middle:.4g} ({low:.3g}..{high:.3g})"]
        for base in ("C", "jaxobs"):
            cells.append("{1:.3g} ({0:.3g}..{2:.3g})".format(*spread(row.ratios[base])) if base in row.ratios else "")
        found = (
            ""
            if row.agreement is None
            else f"{'yes' if row.agreement.close else 'NO'}, {row.agreement.measure} {row.agreement.value:.2g}"
        )
        print(
            f"{row.contender:12}{cells[0]:>30}{cells[1]:>30}{cells[2]:>26}{row.first:9.2f}{row.peak:7.0f}  {found}", flush=True
        )


def compile_all(options: argparse.Namespace, folder: Path) -> tuple[dict[str, Any], list[str]]:
    """(what the disassembly of each C shows, what is wrong with it); empty where there is no compiler."""
    shown, wrong, workload = {}, [], options.workload
    for precision in options.precision:
        for contender in chosen(workload, precision, options.only):
            if contender.module != "_rival_c" or "RACE_SUBSTEPS" in dict(contender.environment):
                continue
            variant = dict(contender.environment).get("RACE_VARIANT", "vector")
            try:
                path = build(folder, precision, variant, workload)
            except NoCompiler as error:
                print(f"{contender.label}, {precision}, is left out: {error}")
                continue
            if contender.label == "C":
                said, faults = verify(Reference(path, precision))
                wrong += faults
                print(f"C, {precision}: {said}")
            hot = inspect(path)
            if hot is None:
                print("objdump is missing: whether the C is vectorised cannot be shown")
            elif variant != "scalar":
                good = hot.vectorised(precision, variant, TRIGONOMETRIC[workload])
                shown[f"{contender.label}, {precision}"] = hot._asdict() | {"vectorised": good}
                calls = ", ".join(f"{hot.calls.count(c)} {c}" for c in dict.fromkeys(hot.calls)) or "none"
                what = f"{hot.packed} products on vectors ({hot.register}), {hot.scalar} scalar, calls of sin and cos: {calls}"
                print(f"{contender.label}, {precision}: a step has {what}")
                wrong += [] if good else [f"{contender.label}, {precision}, is not vectorised: the C is the defect"]
    return shown, wrong


TRIGONOMETRIC = {"pendulum": 8, "chain": 0, "tracker": 0}  # pairs of sin and cos in a step


def race(options: argparse.Namespace) -> tuple[list[Row], dict[str, Any], list[str]]:
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shown, wrong = compile_all(options, folder)
        print(f"{CORES} cores; medians of {options.rounds} rounds (quartiles); MB: peak beyond the idle process", flush=True)
        for precision in options.precision:
            entries = [Entry(c, precision, folder) for c in chosen(options.workload, precision, options.only)]
            try:
                for lanes, sigma in itertools.product(options.lanes, options.sigma):
                    found = contest(
                        Job(options.workload, precision, sigma, lanes, options.steps), entries, options.rounds, folder
                    )
                    show(found)
                    rows += found
            finally:
                for entry in entries:
                    entry.close()
    return rows, shown, wrong + verdicts(rows)


def chosen(workload: str, precision: str, only: list[str] | None) -> list[Contender]:
    fitting = [c for c in CONTENDERS if workload in c.workloads and precision in c.precisions]
    return [c for c in fitting if not only or c.label in only]


def as_record(row: Row) -> dict[str, Any]:
    record = dataclasses.asdict(row)
    if not row.left_out:
        record["median"] = row.median
        record["median_ratios"] = {name: statistics.median(each) for name, each in row.ratios.items()}
    return record


def verdicts(rows: list[Row]) -> list[str]:
    """What must hold for the race to mean anything."""
    wrong = [f"{r.contender} computes something else in {r.job}" for r in rows if r.agreement and not r.agreement.close]
    wrong += [f"jaxobs gives no result for {r.job}: {r.left_out}" for r in rows if r.contender == "jaxobs" and r.left_out]
    for row in rows:
        enough = row.job.steps >= LONG_ENOUGH
        if enough and row.contender == "C, scalar" and "C" in row.ratios and statistics.median(row.ratios["C"]) < FAR_AHEAD:
            wrong.append(f"the C is hardly faster than its scalar build in {row.job}: the C is the defect")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workload", choices=list(TRIGONOMETRIC), default="pendulum")
    parser.add_argument("--lanes", type=int, nargs="+", default=[4096, 65536], help="multiples of 64")
    parser.add_argument("--steps", type=int, help="1000, but for the chain (see _job.py)")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--precision", nargs="+", choices=list(DTYPES), help="both, but for the chain (see _job.py)")
    parser.add_argument("--sigma", type=float, nargs="+", default=[0.0, SIGMA], help="of the noise; 0: none")
    parser.add_argument("--only", nargs="+", choices=[c.label for c in CONTENDERS], help="these contenders alone")
    parser.add_argument("--quick", action="store_true", help="4096 lanes x 200 steps, 3 rounds")
    parser.add_argument("--json", type=Path, help="all times, ratios and checks go here too")
    options = parser.parse_args()
    if options.precision is None:
        options.precision = ["float64"] if options.workload == "chain" else list(DTYPES)
    options.steps = options.steps or STUDIES[options.workload].steps
    if options.quick:
        options.lanes, options.steps, options.rounds = [4096], 200, 3
    rows, shown, wrong = race(options)
    if options.json:
        record = {"cores": CORES, "disassembly": shown, "rows": [as_record(row) for row in rows], "wrong": wrong}
        options.json.write_text(json.dumps(record, indent=1))
    print("\n" + "\n".join(wrong or ["All contenders that took part computed the same study."]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
