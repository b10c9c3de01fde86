"""`jaxobs demo`."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from jaxobs.cli import screen


def demo(
    out: Path = Path("report"),
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    quick: bool = False,
) -> int:
    """The main job: a recorded walk and the pendulum of paper 000, as tables and one HTML report.

    Args:
        out: folder of the report (demo.html and its pictures), made if missing.
        as_json: print the tables as JSON on standard output instead.
        quick: a tenth of the tuning and a sixteenth of the study, to see that it runs.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs.demo.pendulum import study_pendulum
    from jaxobs.demo.walk import study_walk
    from jaxobs.report import demo_figures, demo_text
    from jaxobs.report.page import page

    console = screen.console(stderr=as_json)
    out.mkdir(parents=True, exist_ok=True)
    seconds: dict[str, float] = {}
    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=Console(stderr=True)
    ) as progress:

        def timed(what: str, job: Callable):
            task = progress.add_task(what, total=None)
            begin = time.perf_counter()
            result = job(lambda done: progress.update(task, description=f"{what}: {done}"))
            seconds[what] = round(time.perf_counter() - begin, 1)
            progress.update(task, description=f"{what}: done", total=1, completed=1)
            return result

        walk = timed("recorded walk", lambda report: study_walk(quick=quick, progress=report))
        pendulum = timed("pendulum", lambda report: study_pendulum(quick=quick, progress=report))
        pictures: list[tuple[Path, str]] = timed("figures", lambda report: demo_figures.draw(walk, pendulum, out))
    walk_rows, pendulum_rows = demo_text.walk_table(walk), demo_text.pendulum_table(pendulum)
    walk_words, pendulum_words = demo_text.walk_findings(walk), demo_text.pendulum_findings(pendulum)
    sections = [
        ("A recorded walk: the rate that no sensor gave", walk_words, walk_rows, pictures[:2]),
        ("The pendulum of paper 000", pendulum_words, pendulum_rows, pictures[2:]),
    ]
    (out / "demo.html").write_text(page("jaxobs: state observers on real and simulated data", sections), encoding="utf-8")
    if as_json:
        print(json.dumps(demo_text.as_json(walk, pendulum, seconds), indent=2))
    else:
        for heading, words, rows, _ in sections:
            screen.print_section(console, heading, words, demo_text.without(rows, "parameters"))
        console.print("  ".join(f"{what} {took} s" for what, took in seconds.items()))
    console.print(f"Report: {out / 'demo.html'}")
    return 0
