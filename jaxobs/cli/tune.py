"""`jaxobs tune`: gains by gradient, with a proof at the end, from config files."""

import contextlib
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from jaxobs.cli import screen


def tune(
    configs: Annotated[tuple[Path, ...], tyro.conf.Positional] = (),
    every: Annotated[bool, tyro.conf.arg(name="all")] = False,
    out: Path = Path("tuned"),
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    quick: bool = False,
    plant: Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.py:NAME")] = None,
    changes: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="KEY=VALUE"), tyro.conf.UseAppendAction] = (),
    no_cache: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> int:
    """Less noise at the same proved convergence: each gain is searched by gradient inside what is certified, proved in exact
    arithmetic, and compared with the gain before on fresh seeds. Exit code 0 if all cases are done, 1 if no gain was found for
    one, 2 if a config is wrong, 130 if stopped.

    Args:
        configs: TOML files, or examples of the package: tune_pendulum, tune_chain, tune_flexible_joint, tune_discrete,
            tune_duffing, tune_walk. Sections: [plant], [observer] or [observers.LABEL], [cases.LABEL], [free], [bounds],
            [certify], [objective], [signal], [noise], [disturbance], [time], [start], [check], [search], [record].
        every: all examples of the package.
        out: folder of the certificates, pictures and numbers (tune.json), made if missing.
        as_json: print the numbers as JSON on standard output instead of the tables.
        quick: a tenth of the steps and of the seeds, for a first look.
        plant: in the place of [plant], without its parameters.
        changes: a key of the configs with another value, --set search.steps=100; may be given several times.
        no_cache: compile everything anew, and keep nothing of it.
    """
    from jaxobs.cli.examples import examples, parse
    from jaxobs.cli.override import override, replace_plant
    from jaxobs.cli.tune_config import tune_config

    begun, asked, at = time.perf_counter(), [], ""
    try:
        names = [Path(name) for name in examples("tune")] if every else list(configs)
        if not names:
            raise ValueError(f"tune: given no config; expected a TOML file, or one of {', '.join(examples('tune'))}, or --all")
        for name in names:
            at = f"{name}: "
            asked += [
                (name, one) for one in tune_config(override(replace_plant(parse(name, "tune"), plant), changes), quick=quick)
            ]
        set_up(cache=not no_cache)
        from jaxobs.cli.tune_case import job

        jobs = []
        for name, one in asked:
            at = f"{name}: "
            jobs.append(job(one, f"{name.stem.removeprefix('tune_')}{', ' if one.label else ''}{one.label}"))
        at = f"{out}: "
        out.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        return _complain(at, error)
    return _All(out, screen.console(stderr=as_json), as_json).run(jobs, begun)


def set_up(*, cache: bool) -> None:
    """All cores, 64-bit numbers, and what JAX compiles kept for the next call."""
    from jaxobs.cli.study import set_up

    set_up(None, cache=cache, fuse=False)


class _All:
    """The cases one after the other."""

    def __init__(self, out: Path, console: Console, as_json: bool):
        self.out, self.console, self.as_json = out, console, as_json
        self.results: list[Any] = []
        self.failed: list[dict[str, Any]] = []
        self.wrong = False

    def run(self, jobs: list[Any], begun: float) -> int:
        stopped = False
        try:
            with _bar() as report:
                for i, job in enumerate(jobs):
                    self.one(job, lambda now, i=i, job=job: report(now, i, len(jobs), job.case.name))
                    if self.results and self.results[-1].outcome.tuned.stopped:
                        raise KeyboardInterrupt
        except KeyboardInterrupt:
            stopped = True
        self.end(begun)
        if stopped:
            _say(f"stopped: {len(self.results)} of {len(jobs)} cases are done")
            return 130
        return 2 if self.wrong else 1 if self.failed else 0

    def one(self, job: Any, report: Callable[[Any], None]) -> None:
        from jaxobs.cli import tune_screen
        from jaxobs.designs import Infeasible
        from jaxobs.tuning.case import run

        try:
            report(None)
            case, notes = job.prepare()
            outcome = run(case, progress=report)
        except Infeasible as error:
            best = error.best
            self.failed.append({"case": job.case.name, "reason": error.reason, "change": error.change, "best": best})
            nearest = "" if best is None else f" The nearest feasible rate: {best:.6g}."
            _say(f"{job.case.name}: no gain is proved: {error.reason}.{nearest} {error.change}", "red")
            return
        except ValueError as error:  # a loss that is not finite, a plant that diverges: the numbers of the config
            self.wrong = True
            self.failed.append({"case": job.case.name, "reason": str(error), "change": "", "best": None})
            _complain(f"{job.case.name}: ", error)
            return
        self.results.append(tune_screen.write(job, outcome, self.out, notes))
        if not self.as_json:
            tune_screen.tell(self.results[-1], self.console)

    def end(self, begun: float) -> None:
        """The summary of what is done, and all numbers into one file."""
        from jaxobs.cli import tune_screen

        found: dict[str, Any] = {"cases": [tune_screen.data(one) for one in self.results], "failed": self.failed}
        if self.results:
            found["picture"] = tune_screen.pictures(self.results, self.out)
        found["seconds"] = round(time.perf_counter() - begun, 1)
        text = json.dumps(tune_screen.finite(found), indent=2, allow_nan=False)
        (self.out / "tune.json").write_text(text + "\n", encoding="utf-8")
        if self.as_json:
            print(text)
        elif self.results:
            tune_screen.summary(self.results, self.console)
            where = f"all numbers: {self.out / 'tune.json'}; picture: {found['picture']}; {found['seconds']} s"
            self.console.print(where, markup=False, highlight=False, soft_wrap=True)


@contextlib.contextmanager
def _bar() -> Iterator[Callable[[Any, int, int, str], None]]:
    """What is given the progress of each case: a bar on a terminal, else nothing."""
    from rich import progress as bars

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda now, i, count, name: None
        return
    columns = (bars.SpinnerColumn(), bars.BarColumn(), bars.TextColumn("{task.description}"), bars.TimeElapsedColumn())
    with bars.Progress(*columns, console=console, transient=True) as live:
        task = live.add_task("", total=None)

        def report(now: Any, i: int, count: int, name: str) -> None:
            words = f"{name} ({i + 1} of {count})"
            if now is None:
                live.update(task, description=f"{words}: proof of the gain before", total=None, completed=0)
                return
            done = now.stage * now.steps + now.step
            last = done == now.stages * now.steps
            stage = f"stage {now.stage + 1} of {now.stages}" if now.stages > 1 else "without a proof"
            what = "exact proof and comparison" if last else f"{stage}, loss {now.loss:.5g}"
            live.update(task, description=f"{words}: {what}", total=now.stages * now.steps, completed=done)

        yield report


def _say(text: str, style: str | None = None) -> None:
    Console(stderr=True).print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def _complain(at: str, error: Exception) -> int:
    _say(" ".join([f"{at}{error}", *getattr(error, "__notes__", [])]), "red")
    return 2
