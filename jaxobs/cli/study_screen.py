"""The table of a study on the screen."""

from typing import Any

from rich.console import Console
from rich.table import Table


def show(found: dict[str, Any], console: Console) -> None:
    """The table, then what stands behind it."""

    def line(text: str) -> None:
        console.print(text, markup=False, highlight=False, soft_wrap=True)

    rows = found["rows"]
    incomplete = found["computed"] < found["lanes"]
    header = [*rows[0]["at"], *(["runs"] if incomplete else []), "diverged"]
    body = [
        [*map(_text, row["at"].values()), *([str(row["runs"])] if incomplete else []), str(row["diverged"])] for row in rows
    ]
    one = found["axes"].get("seed", 1) == 1
    columns = {}
    for label in rows[0]["values"]:
        unit = " (s)" if found["units"][label.partition("[")[0]] == "s" else ""
        columns[label + unit] = [_cell(row["values"][label], one=one) for row in rows]
    room, fitting = console.width - sum(_width(name, [row[i] for row in body]) for i, name in enumerate(header)), []
    for label, texts in columns.items():
        room -= _width(label, texts)
        fitting += [label] if room >= 0 or not fitting else []
    table = Table(show_edge=False, pad_edge=False)
    for i, name in enumerate([*header, *fitting]):
        table.add_column(name, justify="right", no_wrap=i >= len(rows[0]["at"]))
    for i, row in enumerate(body):
        table.add_row(*row, *(columns[label][i] for label in fitting))
    console.print(table)
    for text in _remarks(found, [label for label in columns if label not in fitting]):
        line(text)


def _remarks(found: dict[str, Any], unfitting: list[str]) -> list[str]:
    """Whatever the table does not say by itself."""
    words, seeds = [], found["axes"].get("seed", 1)
    if seeds > 1:
        some = f" the first {found['seeds_shown']:,} of" if found["seeds_shown"] < seeds else ""
        words.append(f"median [10 %, 90 %] over{some} {seeds:,} seeds, without the runs that diverged")
    if found["shown"]:
        shown = ", ".join(f"{few} of {size} values of {name}" for name, (few, size) in found["shown"].items())
        words.append(f"shown: {shown}; --rows N shows more")
    if unfitting:
        words.append(f"too wide for this screen: {', '.join(unfitting)}; see --json")
    if found["left_out"]:
        wide = ", ".join(f"{name} ({size} numbers a run)" for name, size in found["left_out"].items())
        words.append(f"only in the data set: {wide}")
    lanes = " x ".join(f"{name} {size:,}" for name, size in found["axes"].items()) or "one lane"
    words.append(f"{lanes} = {found['lanes']:,} lanes, {found['steps']:,} samples each, {found['precision']}")
    if found["computed"] < found["lanes"]:
        words.append(f"computed so far: {found['computed']:,} of {found['lanes']:,} lanes")
    words.append(f"diverged: {found['diverged']:,} of {found['computed']:,} lanes")
    rate, where = found["lane_steps_per_second"], f"{found['devices']} {found['backend']} device(s)"
    work = "nothing was left to compute" if rate is None else f"compilation included; {rate:.3g} lane-steps/s on {where}"
    words.append(f"time: {found['seconds']:.1f} s, {work}")
    if found["store"] is not None:
        words.append(f"stored: {found['store']}; open it with jaxobs.studies.open_study({found['store']!r})")
    return words


def _width(name: str, texts: list[str]) -> int:
    """Of a column, with what separates it from the next."""
    return max(map(len, [name, *texts])) + 3


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _cell(found: list[float] | None, *, one: bool) -> str:
    """ "median [low, high]", or the one value."""
    if found is None:
        return "-"
    low, middle, high = (f"{value:.3g}" for value in found)
    return middle if one else f"{middle} [{low}, {high}]"
