"""`jaxobs bench`."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from jaxobs.cli import screen


def bench(
    what: Annotated[Literal["synthesis", "studies"], tyro.conf.Positional],
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    figures: Path | None = None,
    short: bool = False,
    certificates: Path | None = None,
) -> int:
    """Tables of what can be proved, and of what runs how fast here. `synthesis`: gains of the package beside the papers', at
    the same proved rate. `studies`: the examples of `jaxobs study` on this machine, time for a step of a lane, compile time
    and memory; benchmarks/race.py of the repository sets them beside C, numba, NumPy, diffrax and scipy.

    Args:
        what: the tables to make.
        as_json: print the rows as JSON on standard output instead of tables.
        figures: folder for the pictures (PNG), made if missing; none are drawn if not given.
        short: leave out what takes more than a moment.
        certificates: folder for the certificates behind the rows, made if missing; none are written if not given.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    if what == "studies":
        from jaxobs.cli.bench_studies import studies

        for option, given in (("--figures", figures), ("--certificates", certificates)):
            if given is not None:
                return screen.complain(f"{option}: given {given}; expected nothing: `bench studies` makes a table alone.")
        return studies(as_json=as_json, short=short)
    from jaxobs.report.bench_cli import synthesis

    return synthesis(as_json=as_json, figures=figures, short=short, certificates=certificates)
