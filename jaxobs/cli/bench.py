"""`jaxobs bench`."""

from pathlib import Path
from typing import Annotated, Literal

import tyro


def bench(
    what: Annotated[Literal["synthesis"], tyro.conf.Positional],
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    figures: Path | None = None,
    short: bool = False,
    certificates: Path | None = None,
) -> int:
    """Tables of what can be proved: our gains beside the papers', at the same proved rate.

    Args:
        what: the tables to make.
        as_json: print the rows as JSON on standard output instead of tables.
        figures: folder for the pictures (PNG), made if missing; none are drawn if not given.
        short: leave out what takes more than a moment.
        certificates: folder for the certificates behind the rows, made if missing; none are written if not given.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs.report.bench_cli import synthesis

    return {"synthesis": synthesis}[what](as_json=as_json, figures=figures, short=short, certificates=certificates)
