"""The claims of the papers in words and tables."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from typing import Any

from jaxobs.papers import Row
from jaxobs.papers.claims import OURS

COLUMNS = ["claim", "printed", "ours", "verdict", "why"]
ORDER = ("reproduced", "conservative", "slip", "scan?", "false as stated", "open")


def table(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Header and cells of the rows of one paper."""
    return COLUMNS, [[row.claim, row.printed, number(row.ours), row.verdict, row.why] for row in rows]


def number(ours: float | str | None) -> str:
    """A computed value, in nine digits."""
    return "" if ours is None else ours if isinstance(ours, str) else f"{ours:.9g}"


def count(rows: Sequence[Row]) -> str:
    """How many rows of each verdict, in words."""
    printed = [row for row in rows if row.printed != OURS]
    verdicts = Counter(row.verdict for row in printed)
    claims = f"{len(printed)} claims: " + ", ".join(f"{verdicts[name]} {name}" for name in ORDER if verdicts[name])
    return claims + (f"; and {len(rows) - len(printed)} rows of ours" if len(printed) < len(rows) else "")


def as_json(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Plain objects; a number that is not finite becomes its name, since JSON has none."""
    plain = [dataclasses.asdict(row) for row in rows]
    for row in plain:
        if isinstance(row["ours"], float) and not abs(row["ours"]) < float("inf"):
            row["ours"] = str(row["ours"])
    return plain
