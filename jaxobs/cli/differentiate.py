"""`jaxobs differentiate`: a recorded signal from CSV, its derivatives into CSV and a picture."""

import json
import math
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from jaxobs.cli import screen


def differentiate(
    record: Annotated[Path, tyro.conf.Positional],
    column: str | None = None,
    time: str | None = None,
    order: int = 1,
    mu: float | None = None,
    q: int = 0,
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None,
    figure: Path | None = None,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Derivatives of a recorded signal, by the discrete tracker without delay: CSV in, CSV and picture out. Exit code 0 if they
    are written, 2 if the record or an option does not fit.

    Args:
        record: a CSV file with a header; empty fields and nan are lost samples.
        column: the signal; not needed if there is one besides the time.
        time: the column of times, in seconds or as dates; the first one if not given.
        order: the highest derivative wanted.
        mu: rate of all poles [1/s]: large follows fast, small smooths; found from the record if not given.
        q: integrators, against tones far above mu.
        out: the CSV file to write; RECORD.derivatives.csv if not given.
        figure: a picture of signal and derivatives (PNG, SVG or PDF); none if not given.
        as_json: print what was found as JSON on standard output instead.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    import pandas as pd

    import jaxobs
    from jaxobs.cli.records import read_record

    out = out or record.with_name(f"{record.stem}.derivatives.csv")
    try:
        series, names = read_record(record, time, column)
        found = jaxobs.differentiate(series, order=order, mu=mu, q=q)
        table = pd.DataFrame(found.xhat, columns=pd.Index(names.derivatives(order)))
        table.insert(0, names.time, series.index)
        table.to_csv(out, index=False)
        if figure is not None:
            from jaxobs import plotting

            drawn = plotting.estimate(
                found, names=names.derivatives(order), title=f"{record.name}, mu = {float(found.mu):.4g} /s"
            )
            drawn.savefig(figure)
    except (OSError, ValueError) as error:
        return screen.complain(f"{record}: {error}")
    told: dict[str, Any] = {"file": str(out), "figure": None if figure is None else str(figure)}
    told |= {"samples": len(series), "lost": int(series.isna().sum()), "mu": float(found.mu)}
    told |= {"period": float(found.ts[1] - found.ts[0]), "mu_from": "given" if mu is not None else "the record"}
    lost_at = float(found.diverged_at)
    told |= {"diverged_at": lost_at if math.isfinite(lost_at) else None}
    if as_json:
        print(json.dumps(told, indent=2))
        return 0
    lost = f", {told['lost']} lost" if told["lost"] else ""
    console = Console()
    console.print(f"{told['samples']} samples{lost}, one every {told['period']:.6g} s", highlight=False)
    how = "" if mu is not None else ", found from the whole record: the estimates are not causal through it"
    console.print(f"mu = {told['mu']:.4g} /s{how}", highlight=False, soft_wrap=True)
    for path in filter(None, (told["file"], told["figure"])):
        console.print("written:", path, markup=False, highlight=False)
    return 0
