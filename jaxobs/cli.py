"""The command line: `jaxobs demo`, `jaxobs reproduce`, `jaxobs verify`."""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text


def demo(
    out: Path = Path("report"),
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    quick: bool = False,
) -> int:
    """The main job: a recorded walk and the pendulum of paper 000, as tables and one HTML report.

    Args:
        out: folder of the report (demo.html and its pictures), made if missing.
        as_json: print the tables as JSON on standard output instead.
        quick: a tenth of the tuning and a sixteenth of the study, to see that it runs.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs.demo.pendulum import study_pendulum
    from jaxobs.demo.walk import study_walk
    from jaxobs.report import demo_figures, demo_text
    from jaxobs.report.page import page

    console = _console(stderr=as_json)
    out.mkdir(parents=True, exist_ok=True)
    seconds: dict[str, float] = {}
    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=Console(stderr=True)
    ) as progress:

        def timed(what: str, job: Callable):
            task = progress.add_task(what, total=None)
            begin = time.perf_counter()
            result = job(lambda done: progress.update(task, description=f"{what}: {done}"))
            seconds[what] = round(time.perf_counter() - begin, 1)
            progress.update(task, description=f"{what}: done", total=1, completed=1)
            return result

        walk = timed("recorded walk", lambda report: study_walk(quick=quick, progress=report))
        pendulum = timed("pendulum", lambda report: study_pendulum(quick=quick, progress=report))
        pictures: list[tuple[Path, str]] = timed("figures", lambda report: demo_figures.draw(walk, pendulum, out))
    walk_rows, pendulum_rows = demo_text.walk_table(walk), demo_text.pendulum_table(pendulum)
    walk_words, pendulum_words = demo_text.walk_findings(walk), demo_text.pendulum_findings(pendulum)
    sections = [
        ("A recorded walk: the rate that no sensor gave", walk_words, walk_rows, pictures[:2]),
        ("The pendulum of paper 000", pendulum_words, pendulum_rows, pictures[2:]),
    ]
    (out / "demo.html").write_text(page("jaxobs: state observers on real and simulated data", sections), encoding="utf-8")
    if as_json:
        print(json.dumps(demo_text.as_json(walk, pendulum, seconds), indent=2))
    else:
        for heading, words, rows, _ in sections:
            _print(console, heading, words, demo_text.without(rows, "parameters"))
        console.print("  ".join(f"{what} {took} s" for what, took in seconds.items()))
    console.print(f"Report: {out / 'demo.html'}")
    return 0


def reproduce(
    paper: Annotated[Literal["000", "001", "002", "003", "004"] | None, tyro.conf.Positional] = None,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    figures: Path | None = None,
    short: bool = False,
) -> int:
    """The five papers, claim by claim: what is printed, what comes out, and the verdict. Exit code 0 whatever the verdicts.

    Args:
        paper: one of the five; all of them if not given.
        as_json: print the rows as a JSON list on standard output instead of tables.
        figures: folder for the recomputed figures (PNG), made if missing; none are drawn if not given.
        short: leave out the claims that take more than a moment.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs import papers
    from jaxobs.report import papers_figures, papers_text

    console, rows = _console(stderr=as_json), []
    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=Console(stderr=True), transient=True
    ) as progress:
        task = progress.add_task("starting", total=None)

        def show(what: str) -> None:
            progress.update(task, description=escape(what))

        for number in papers.PAPERS if paper is None else (paper,):
            found = list(papers.reproduce(number, short=short, progress=show))
            rows += found
            if not as_json:
                _print_paper(console, papers.load(number), found)
            if figures is not None:
                progress.update(task, description=f"figures of {number}")
                for path, caption in papers_figures.draw_all(papers.pictures(number), figures):
                    console.print(f"Figure: {path}: {caption}", highlight=False, markup=False)
    if as_json:
        print(json.dumps(papers_text.as_json(rows), indent=2))
    elif paper is None:
        console.print(papers_text.count(rows), highlight=False)
    return 0


def _print_paper(console: Console, paper: Any, rows: list[Any]) -> None:
    from jaxobs.report import papers_text

    header, cells = papers_text.table(rows)
    console.rule(f"{paper.number} {paper.title}")
    table = Table(show_edge=False, pad_edge=False)
    for column, ratio in zip(header, (3, 2, 2, 1, 6), strict=True):
        table.add_column(column, overflow="fold", ratio=ratio)
    colours = {"reproduced": "green", "conservative": "green", "slip": "yellow", "scan?": "yellow", "false as stated": "red"}
    for row in cells:
        table.add_row(*(Text(cell, style=colours.get(cell, "") if i == 3 else "") for i, cell in enumerate(row)))
    console.print(table)
    console.print(papers_text.count(rows), highlight=False)


def verify(file: Annotated[Path, tyro.conf.Positional]) -> int:
    """Re-checks a certificate in exact arithmetic. Exit code 0 if it holds, 1 if not, 2 if the file is none.

    Args:
        file: a jaxobs-cert/1 file, written by Certificate.to_json.
    """
    from jaxobs.certificates import load

    console = Console()
    try:
        certificate = load(file)
    except (OSError, ValueError) as error:
        Console(stderr=True).print(error, style="red", markup=False)
        return 2
    verdict = certificate.verify()
    console.print("claim:", certificate.claim, markup=False)
    for assumption in certificate.assumptions:
        console.print("assumes:", assumption, markup=False)
    verdict_style = "green" if verdict else "red"
    console.print("holds:" if verdict else "not certified:", verdict.why, style=verdict_style, markup=False)
    return 0 if verdict else 1


def _console(*, stderr: bool) -> Console:
    """Into a pipe or a file, tables take the width they need."""
    console = Console(stderr=stderr)
    return console if console.is_terminal else Console(stderr=stderr, width=160)


def _print(console: Console, heading: str, words: list[str], rows: tuple[list[str], list[list[str]]]) -> None:
    console.rule(heading)
    table = Table(show_edge=False, pad_edge=False)
    for i, column in enumerate(rows[0]):
        table.add_column(column, justify="left" if i < 1 else "right", overflow="fold", no_wrap=i > 0)
    for row in rows[1]:
        table.add_row(*row)
    console.print(table)
    for sentence in words:
        console.print(f"- {sentence}", highlight=False)


def main() -> None:
    """The entry point `jaxobs`."""
    try:
        code = tyro.extras.subcommand_cli_from_dict({"demo": demo, "reproduce": reproduce, "verify": verify}, prog="jaxobs")
    except KeyboardInterrupt:
        Console(stderr=True).print("stopped")
        code = 130
    sys.exit(code)
