"""`jaxobs bench synthesis`: the designs of the project beside the papers', in tables."""

import json
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from jaxobs.bench.run import run
from jaxobs.report import bench_figures, bench_text


def synthesis(
    *, as_json: bool = False, figures: Path | None = None, short: bool = False, certificates: Path | None = None
) -> int:
    """Gains beside the papers' at the same proved rate, the frontier of noise against rate, time as the state grows: the tables
    on standard output, or one JSON object; pictures (PNG) and the certificates of all rows into folders, made if missing."""
    console = Console(stderr=as_json)
    if not console.is_terminal:
        console = Console(stderr=as_json, width=220)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("starting", total=None)
        bench = run(short=short, progress=lambda what: progress.update(task, description=escape(what)))
        words = bench_text.findings(bench)
    if as_json:
        print(json.dumps(bench_text.as_json(bench) | {"findings": words}, indent=2))
    else:
        for heading, header, cells in bench_text.tables(bench):
            _print(console, heading, header, cells)
        for sentence in words:
            console.print(f"- {sentence}", highlight=False, markup=False)
        console.print("  ".join(f"{what} {took} s" for what, took in bench.seconds.items()), highlight=False)
    if certificates is not None:
        certificates.mkdir(parents=True, exist_ok=True)
        written = list(bench.certificates())
        for name, proof in written:
            proof.to_json(certificates / f"{name}.json")
        console.print(f"Certificates: {len(written)} in {certificates}", highlight=False, markup=False)
    if figures is not None:
        for path, caption in bench_figures.draw(bench, figures):
            console.print(f"Figure: {path}: {caption}", highlight=False, markup=False)
    return 0


def _print(console: Console, heading: str, header: list[str], cells: list[list[str]]) -> None:
    console.rule(heading)
    table = Table(show_edge=False, pad_edge=False)
    for i, column in enumerate(header):
        table.add_column(column, justify="left" if i == 0 else "right", overflow="fold")
    for row in cells:
        table.add_row(*map(escape, row))
    console.print(table)
