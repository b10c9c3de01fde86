"""How far a study is, and how it is stopped."""

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax.numpy as jnp

from jaxobs._module import refuse
from jaxobs.integrators import ProgressMeter


class Progress(NamedTuple):
    """`done` of `total` lanes; `rate` in lane-steps per second and `left` in seconds, as far as this call has measured them."""

    done: int
    total: int
    rate: float
    left: float


class Meter:
    """Tells `report` how far the work is. Lanes that a store had already are done, but say nothing about the rate; neither do,
    once there are others, pieces that came with a compilation."""

    def __init__(self, report: Callable[[Progress], Any] | None, total: int, done: int, steps: int):
        self.report, self.total, self.done, self.steps = report, total, done, steps
        self.measured: dict[bool, tuple[int, float]] = {}  # compiled with it or not -> lanes, seconds

    def add(self, lanes: int, seconds: float, *, compiled: bool) -> None:
        before, spent = self.measured.get(compiled, (0, 0.0))
        self.measured[compiled] = (before + lanes, spent + seconds)
        self.done += lanes
        if self.report is not None:
            computed, spent = self.measured.get(False) or self.measured[True]
            rate = computed / max(spent, 1e-9)
            self.report(Progress(self.done, self.total, rate * self.steps, (self.total - self.done) / rate))


def check_progress(progress: Any) -> None:
    if not (progress is None or isinstance(progress, bool | ProgressMeter) or callable(progress)):
        fix = "True shows a bar; a function is called with each Progress; diffrax's meters are told the share that is done."
        raise refuse("study", "progress", repr(progress), "None, True, a function or a progress meter", fix)


@contextlib.contextmanager
def reporter(progress: Any) -> Iterator[Callable[[Progress], Any] | None]:
    """None or False: quiet. True: a bar on the screen. A function: it is given a Progress after each piece of work. A progress
    meter of diffrax: it is told the share of the lanes that is done."""
    if progress is True:
        with _bar() as report:
            yield report
    elif isinstance(progress, ProgressMeter):
        state = progress.init()

        def tell(now: Progress) -> None:
            nonlocal state
            state = progress.step(state, jnp.asarray(now.done / now.total))

        yield tell
        progress.close(state)
    else:
        yield progress or None


@contextlib.contextmanager
def _bar() -> Iterator[Callable[[Progress], None]]:
    from rich import progress as bars
    from rich.console import Console

    columns = (bars.BarColumn(), bars.MofNCompleteColumn(), bars.TextColumn("lanes  {task.description}"))
    with bars.Progress(*columns, console=Console(stderr=True)) as screen:
        task = screen.add_task("", total=None)

        def report(now: Progress) -> None:
            words = f"{now.rate:.3g} lane-steps/s  {_clock(now.left)} left"
            screen.update(task, completed=now.done, total=now.total, description=words)

        yield report


def _clock(seconds: float) -> str:
    hours, rest = divmod(round(seconds), 3600)
    return f"{hours}:{rest // 60:02d}:{rest % 60:02d}"


class Stop:
    """Within it the first Ctrl-C sets `asked`, the second is a KeyboardInterrupt at once; after it all is as before.

    Only the main thread receives signals: elsewhere, or where Ctrl-C is ignored, nothing is changed.
    """

    def __init__(self):
        self.asked, self.before = False, None

    def __enter__(self) -> "Stop":
        if threading.current_thread() is threading.main_thread():
            before = signal.getsignal(signal.SIGINT)
            if before is not signal.SIG_IGN and before is not None:
                self.before = before
                signal.signal(signal.SIGINT, self._receive)
        return self

    def __exit__(self, *error: Any) -> None:
        if self.before is not None:
            signal.signal(signal.SIGINT, self.before)

    def _receive(self, number: int, where: Any) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        print("Stopping after the chunk in flight; Ctrl-C again stops at once.", file=sys.stderr)


def wait(arrays: list[Any]) -> None:
    """Until all are computed. A thread that waits inside JAX hears no signal, so it looks now and then instead."""
    start = time.perf_counter()
    while not all(array.is_ready() for array in arrays if hasattr(array, "is_ready")):
        time.sleep(min(max((time.perf_counter() - start) / 50, 2e-5), 0.02))
