"""`jaxobs reproduce`."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text

from jaxobs.cli import screen


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

    console, rows = screen.console(stderr=as_json), []
    with screen.waiting("starting") as show:
        for number in papers.PAPERS if paper is None else (paper,):
            found = list(papers.reproduce(number, short=short, progress=show))
            rows += found
            if not as_json:
                _print_paper(console, papers.load(number), found)
            if figures is not None:
                show(f"figures of {number}")
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
