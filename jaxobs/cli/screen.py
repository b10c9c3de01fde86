"""What the commands share on the screen."""

import contextlib
from collections.abc import Callable, Iterator, Mapping

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text


def console(*, stderr: bool) -> Console:
    """Into a pipe or a file, tables take the width they need."""
    screen = Console(stderr=stderr)
    return screen if screen.is_terminal else Console(stderr=stderr, width=160)


def print_section(console: Console, heading: str, words: list[str], rows: tuple[list[str], list[list[str]]]) -> None:
    console.rule(heading)
    print_table(console, rows)
    for sentence in words:
        console.print(f"- {sentence}", highlight=False)


def print_table(console: Console, rows: tuple[list[str], list[list[str]]]) -> None:
    """A header and rows; all columns but the first hold numbers."""
    table = Table(show_edge=False, pad_edge=False)
    for i, column in enumerate(rows[0]):
        table.add_column(column, justify="left" if i < 1 else "right", overflow="fold", no_wrap=i > 0)
    for row in rows[1]:
        table.add_row(*row)
    console.print(table)


def print_pairs(console: Console, pairs: Mapping[str, str]) -> None:
    """Names, and what each is, on lines of their own."""
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    for name, words in pairs.items():
        table.add_row(Text(name), Text(words))
    console.print(table)


@contextlib.contextmanager
def waiting(first: str) -> Iterator[Callable[[str], None]]:
    """What is under way, and for how long, on a terminal; nothing is left of it. Gives the function that says what is next."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(first, total=None)
        yield lambda what: progress.update(task, description=escape(what))


def complain(text: str, code: int = 2) -> int:
    """An error, as one paragraph on standard error, and the exit code that goes with it."""
    Console(stderr=True).print(text, style="red", markup=False, highlight=False, soft_wrap=True)
    return code
