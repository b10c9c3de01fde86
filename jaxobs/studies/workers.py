"""A study on the workers of a Dask cluster: each computes chunks of one store, and one that is killed is replaced."""

import math
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable
from typing import Any

import jax
import xarray as xr

from jaxobs._module import refuse, require_integer
from jaxobs.integrators import ProgressMeter
from jaxobs.studies.durable import StoreError
from jaxobs.studies.montecarlo import study
from jaxobs.studies.progress import Progress, check_progress, reporter
from jaxobs.studies.store import Store

ONE = threading.Lock()  # a process computes one share at once, with all its devices
LATE = 60.0  # s; network file systems show other machines' files so much later


def study_on(
    client: Any, plant: Any, families: Any, *, store: Any, tasks: int = 1000, retries: int = 2,
    progress: bool | Callable[..., Any] | ProgressMeter | None = None, **arguments: Any,
) -> xr.Dataset:  # fmt: skip
    """`jaxobs.study(plant, families, store=store, ...)` by the workers of `client`, a `distributed.Client`: the same bits.

    store: a folder that this machine and all workers see under the same name. The study is cut into at most `tasks` shares,
    share i of n being that of `study(part=(i, n))`. Dask gives the share of a worker that was killed to another one, as often
    as its setting distributed.scheduler.allowed-failures says; who takes over computes what is not in the store yet. A share
    that fails with an error is tried `retries` times again. The same call goes on with what is missing.

    Numbers have the width that they have here (64 bits if jax_enable_x64 is set). A worker computes one share at a time, on all
    its devices; started with `dask worker ... --nthreads 1 --preload "import jaxobs; jaxobs.use_all_cores()"` it has one for
    each core.
    progress: as in `study`, after each share. Other arguments: those of `study`, but part.

    ValueError names the argument that does not fit; StoreError if this machine does not see what the workers have stored.
    """
    if not callable(getattr(client, "submit", None)):
        raise refuse("study_on", "client", repr(client), "a distributed.Client", 'pip install "jaxobs[dask]" has it.')
    if "part" in arguments:
        raise refuse("study_on", "part", repr(arguments["part"]), "nothing", "The shares are made here; tasks= bounds them.")
    require_integer("study_on", "tasks", tasks, 1, "It bounds the number of shares.")
    require_integer("study_on", "retries", retries, 0, "It counts the trials after the first.")
    check_progress(progress)
    from cloudpickle import dumps
    from distributed import as_completed

    path, again = os.path.abspath(store), {"retries": retries, "pure": False}
    whole = dumps((plant, families, arguments | {"store": path}))
    given = client.submit(_same, whole, **again)  # a task, not scattered data: Dask makes it again when its holder dies
    wide = bool(jax.config.values["jax_enable_x64"])
    # A worker beyond the last chunk: it checks everything, makes the store, and computes nothing.
    chunks, said = client.submit(_share, given, wide, (sys.maxsize - 1, sys.maxsize), **again).result()
    _warn(said, told := set())
    made = _seen(path, lambda: Store.read(path))
    count, before, begun, done = min(tasks, chunks), made.marked(), time.perf_counter(), 0
    shares = {client.submit(_share, given, wide, (i, count), **again): range(i, chunks, count) for i in range(count)}
    total, fresh = math.prod(made.sizes.values()), 0
    try:
        with reporter(progress) as report:
            for future in as_completed(shares):
                _warn(future.result()[1], told)
                done += sum(_lanes(made, chunk) for chunk in shares[future])
                fresh += sum(_lanes(made, chunk) for chunk in shares[future] if chunk not in before)
                if report is not None:
                    rate = (fresh or done) / (time.perf_counter() - begun)
                    report(Progress(done, total, rate * len(arguments["ts"]), (total - done) / rate))
    finally:
        client.cancel([future for future in shares if not future.done()])
    return _seen(path, lambda: _complete(made))


def _same(whole: bytes) -> bytes:
    return whole


def _share(whole: bytes, wide: bool, part: tuple[int, int]) -> tuple[int, list[Warning | str]]:
    """On a worker: compute a part of the study. The number of chunks of all of it, and what it warns of."""
    from cloudpickle import loads

    with ONE, jax.enable_x64(wide), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        plant, families, arguments = loads(whole)
        study(plant, families, part=part, **arguments)
    return len(Store.read(arguments["store"])), [one.message for one in caught]


def _warn(said: list[Warning | str], told: set[str]) -> None:
    """The warnings of the workers, here and once."""
    for one in said:
        if str(one) not in told:
            told.add(str(one))
            warnings.warn(one, stacklevel=3)


def _lanes(store: Store, chunk: int) -> int:
    return math.prod(place.stop - place.start for place in store.region(chunk).values())


def _complete(store: Store) -> xr.Dataset:
    if missing := len(store) - len(store.marked()):
        raise StoreError(f"{missing} of {len(store)} chunks are not there")
    return store.dataset()


def _seen(path: str, read: Callable[[], Any]) -> Any:
    """What a worker has stored, as soon as this machine sees it."""
    begun = time.perf_counter()
    while True:
        try:
            return read()
        except StoreError as error:
            if time.perf_counter() - begun > LATE:
                fix = "Give a folder that is the same on this machine and on every worker."
                raise StoreError(
                    f"study_on: the workers have stored it, but this machine does not see it: {error}. {fix}"
                ) from error
        time.sleep(0.5)
