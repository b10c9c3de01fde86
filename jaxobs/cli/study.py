"""`jaxobs study`: a Monte Carlo study from a config file."""

import contextlib
import json
import math
import os
import re
import shlex
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from jaxobs.cli import screen


def study(
    config: Annotated[Path, tyro.conf.Positional],
    store: Path | None = None,
    part: str | None = None,
    seeds: int | None = None,
    precision: Literal["float64", "float32"] | None = None,
    plant: Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.py:NAME")] = None,
    changes: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="KEY=VALUE"), tyro.conf.UseAppendAction] = (),
    rows: int = 40,
    report: Path | None = None,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    devices: int | None = None,
    chunk: int | None = None,
    no_cache: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
) -> int:
    """A Monte Carlo study from a config file: medians over the seeds on the screen, all numbers in the store. Exit code 0 if
    all that was asked for is computed, 1 if it failed under way, 2 if the config or the store does not fit, 130 if stopped.

    Args:
        config: a TOML file, or an example of the package: study_pendulum, study_mismatch, study_chain, study_tracker.
            Sections: [plant], [observer] or [observers.LABEL], [signal], [noise], [disturbance], [time], [start],
            [metrics], [run]. A list in the place of a number makes an axis.
        store: folder of the results (Zarr), made if missing; without it only the table is printed.
            The same command again computes only what is missing there. Ctrl-C stops after the chunk in flight.
        part: I/N computes share I of N (0/N to N-1/N) into the common store: one job of an array.
        seeds: in the place of run.seeds.
        precision: float64 or float32, in the place of run.precision.
        plant: in the place of [plant], without its parameters.
        changes: a key of the config with another value, --set observer.gamma=[2.0,4.0]; may be given several times.
        rows: the most rows of the table; 40 fit on a screen.
        report: a page with curves and heat maps of every metric (HTML, one file, no network needed); none if not given.
        as_json: print the table as JSON on standard output instead.
        devices: CPU devices, one for each core if not given.
        chunk: the largest number of lanes stored together; found by itself if not given.
        no_cache: compile everything anew, and keep nothing of it.
    """
    from jaxobs.cli.examples import parse
    from jaxobs.cli.override import override, replace_plant
    from jaxobs.cli.study_config import study_config

    settings = {"run.seeds": seeds, "run.precision": precision}
    settings = tuple(f"{key}={value}" for key, value in settings.items() if value is not None)
    try:
        share = _share(part, store)
        asked = study_config(override(replace_plant(parse(config, "study"), plant), (*changes, *settings)))
        for name, value in (("--rows", rows), ("--devices", devices), ("--chunk", chunk)):
            if value is not None and value < 1:
                raise ValueError(f"{name}: given {value}; expected a whole number >= 1.")
        set_up(devices, cache=not no_cache, fuse="Adaptive" not in str(asked))  # wherever it may stand
        with _warnings():
            true, families, arguments = asked.study()
    except (OSError, ValueError) as error:
        return _complain(f"{config}: {error}", 2)
    return _Job(config, store, as_json, rows, report).run(
        true, families, arguments | {"store": store, "part": share, "chunk": chunk}
    )


def set_up(devices: int | None, *, cache: bool, fuse: bool) -> None:
    """All cores, 64-bit numbers where they are asked for, and what JAX compiles kept for the next call."""
    import jax

    from jaxobs.studies.devices import compile_cache, use_all_cores

    use_all_cores(devices, fuse=fuse)
    jax.config.update("jax_enable_x64", True)  # a study in float32 has parts of float32
    if cache and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        compile_cache()


class _Job:
    """One study: progress on the way, the table at the end."""

    def __init__(self, config: Path, store: Path | None, as_json: bool, rows: int, page: Path | None):
        self.config, self.store, self.as_json, self.rows, self.page = config, store, as_json, rows, page
        self.last: Any = None
        self.begun = time.perf_counter()

    def run(self, plant: Any, families: Any, arguments: dict[str, Any]) -> int:
        from jaxobs.cli.study_config import named
        from jaxobs.studies import study

        def seen(now: Any) -> None:
            self.last = now
            if report is not None:
                report(now)

        try:
            with _bar() as report, _warnings():
                ds = study(plant, families, **arguments, progress=seen)
        except KeyboardInterrupt as stop:
            return self.stopped(stop, len(arguments["ts"]))
        except (OSError, ValueError) as error:
            note = "" if self.store is None or self.last is None else " What was finished is in the store."
            return _complain(f"{self.config}: {named(str(error))}{note}", 2 if self.last is None else 1)
        self.tell(ds, len(arguments["ts"]))
        return self.write_page(ds)

    def stopped(self, stop: KeyboardInterrupt, steps: int) -> int:
        """What is finished is kept in the store, or else shown."""
        if (partial := getattr(stop, "dataset", None)) is not None and self.last is not None:
            self.tell(partial, steps)
        for note in getattr(stop, "__notes__", []):
            _say(note.partition(";")[0].removeprefix("study: ") + ".")
        if self.store is None:
            _say("Nothing is stored. With --store DIR the same command goes on where it stopped.")
        else:
            _say(f"To go on where it stopped: jaxobs {shlex.join(sys.argv[1:])}")
        return 130

    def write_page(self, ds: Any) -> int:
        """The report, where one is asked for."""
        if self.page is None:
            return 0
        from jaxobs import report

        try:
            report.write(self.page, {str(self.config): ds}, title=f"Study {self.config}")
        except OSError as error:
            return _complain(f"{self.page}: {error}", 1)
        _say(f"Report: {self.page}")
        return 0

    def tell(self, ds: Any, steps: int) -> None:
        import jax

        from jaxobs.cli.study_screen import show
        from jaxobs.cli.study_table import summary

        found = summary(ds, self.rows)
        seconds = time.perf_counter() - self.begun
        rate = None if self.last is None else self.last.rate
        found |= {"steps": steps, "seconds": round(seconds, 3), "lane_steps_per_second": rate, "complete": bool(ds.complete)}
        found |= {"precision": ds.precision, "devices": jax.device_count(), "backend": jax.default_backend()}
        found |= {"store": None if self.store is None else str(self.store)}
        if self.as_json:
            print(json.dumps(_finite(found), indent=2, allow_nan=False))
        else:
            show(found, screen.console(stderr=False))


def _finite(value: Any) -> Any:
    """JSON has no infinity."""
    if isinstance(value, dict):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _share(part: str | None, store: Path | None) -> tuple[int, int] | None:
    """I/N."""
    if part is None:
        return None
    found = re.fullmatch(r"(\d+)/(\d+)", part)
    if found is None or int(found[1]) >= int(found[2]):
        raise ValueError(f"--part: given {part!r}; expected I/N with 0 <= I < N. The third of eight jobs is 2/8.")
    if store is None:
        raise ValueError("--store: given nothing; expected a folder, in which the parts of the study meet.")
    return int(found[1]), int(found[2])


@contextlib.contextmanager
def _bar() -> Iterator[Any]:
    """What is given the progress: a bar on a terminal, else nothing."""
    from jaxobs.studies.progress import reporter

    with reporter(Console(stderr=True).is_terminal) as report:
        yield report


@contextlib.contextmanager
def _warnings() -> Iterator[None]:
    """Warnings as one line each."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_: _say(f"warning: {message}", "yellow")
        yield


def _say(text: str, style: str | None = None) -> None:
    Console(stderr=True).print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def _complain(text: str, code: int) -> int:
    _say(text, "red")
    return code
