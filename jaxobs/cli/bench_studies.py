"""`jaxobs bench studies`: what the examples of `jaxobs study` cost on this machine."""

import json
import resource
import sys
import time
import tomllib
from typing import Any

from jaxobs.cli import screen

FEW = 16  # seeds of a short run
HEADER = ["study", "precision", "lanes", "steps", "first result [s]", "ns a lane-step", "peak memory [MB]"]


def studies(*, as_json: bool, short: bool) -> int:
    """Each example, twice: the first call compiles, the second is timed. short: with 16 seeds."""
    from jaxobs.cli.examples import examples
    from jaxobs.cli.study import set_up

    set_up(None, cache=False, fuse=True)
    rows = [_measured(name, text, FEW if short else None) for name, text in examples("study").items()]
    if as_json:
        print(json.dumps([dict(zip(HEADER, row, strict=True)) for row in rows], indent=2))
        return 0
    import jax

    console = screen.console(stderr=False)
    cells = [[f"{x:.3g}" if isinstance(x, float) else str(x) for x in row] for row in rows]
    screen.print_table(console, (HEADER, cells))
    console.print(f"{jax.device_count()} devices; peak memory is that of the whole process so far", highlight=False)
    return 0


def _measured(name: str, text: str, seeds: int | None) -> list[Any]:
    from jaxobs.cli.study_config import study_config
    from jaxobs.studies import Seeds, study

    asked = study_config(tomllib.loads(text))
    plant, families, arguments = asked.study()
    if seeds is not None and arguments["keys"] is not None:
        arguments["keys"] = Seeds(arguments["keys"].key, seeds)
    steps, seconds, lanes = len(arguments["ts"]), [], 0
    for _ in range(2):
        begin = time.perf_counter()
        lanes = study(plant, families, **arguments).diverged_at.size
        seconds.append(time.perf_counter() - begin)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    return [name, asked.run.precision, lanes, steps, seconds[0], 1e9 * seconds[1] / (lanes * steps), round(peak)]
