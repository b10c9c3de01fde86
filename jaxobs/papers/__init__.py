"""The five papers, claim by claim: what is printed, what comes out, and what of it holds.

    for row in jaxobs.papers.reproduce("000"): print(row)

One module a paper holds its claims; `pictures(paper)` recomputes its figures.
"""

import importlib
from collections.abc import Callable, Iterator

from jaxobs.papers.claims import Claim as Claim
from jaxobs.papers.claims import Paper as Paper
from jaxobs.papers.claims import Row as Row
from jaxobs.papers.pictures import Line as Line
from jaxobs.papers.pictures import Panel as Panel
from jaxobs.papers.pictures import Picture as Picture

PAPERS = ("000", "001", "002", "003", "004")


def load(number: str) -> Paper:
    """The claims of one paper. ValueError for a number that is none of the five."""
    if number not in PAPERS:
        raise ValueError(f"paper: given {number!r}; expected one of {', '.join(PAPERS)}. See `jaxobs reproduce --help`.")
    return importlib.import_module(f"jaxobs.papers.p{number}").PAPER


def reproduce(
    number: str | None = None, *, short: bool = False, progress: Callable[[str], None] | None = None
) -> Iterator[Row]:
    """Every claim of a paper (of all five), computed now. short: without the long ones."""
    for one in PAPERS if number is None else (number,):
        for claim in load(one).claims:
            if not (short and claim.long):
                if progress is not None:
                    progress(f"{one} {claim.name}")
                yield claim.check()


def pictures(number: str) -> Iterator[Picture]:
    """The figures of a paper, recomputed."""
    load(number)
    for draw in importlib.import_module(f"jaxobs.papers.p{number}").PICTURES:
        yield draw()
