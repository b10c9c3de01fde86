"""What the commands share on the screen."""

from rich.console import Console
from rich.table import Table


def console(*, stderr: bool) -> Console:
    """Into a pipe or a file, tables take the width they need."""
    screen = Console(stderr=stderr)
    return screen if screen.is_terminal else Console(stderr=stderr, width=160)


def print_section(console: Console, heading: str, words: list[str], rows: tuple[list[str], list[list[str]]]) -> None:
    console.rule(heading)
    table = Table(show_edge=False, pad_edge=False)
    for i, column in enumerate(rows[0]):
        table.add_column(column, justify="left" if i < 1 else "right", overflow="fold", no_wrap=i > 0)
    for row in rows[1]:
        table.add_row(*row)
    console.print(table)
    for sentence in words:
        console.print(f"- {sentence}", highlight=False)
