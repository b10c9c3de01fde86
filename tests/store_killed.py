"""Kills itself at every operation by which a store is created or a chunk is written: store_killed.py DIR.

Each time a child of this process is killed (SIGKILL), and the next one goes on with what is left. Prints how often.
"""

import itertools
import math
import os
import signal
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from study_stores import CONFIG, Disk, files, fill, make, numbers

from jaxobs.studies.store import Store


def killed(work, room: float) -> bool:
    """Whether a child that does `work` dies after `room` operations."""
    if child := os.fork():
        _, status = os.waitpid(child, 0)
        assert status in (0, signal.SIGKILL), status
        return status == signal.SIGKILL
    disk = Disk(pytest.MonkeyPatch())
    disk.fail = lambda path: os.kill(os.getpid(), signal.SIGKILL)
    disk.full_after(room)
    try:
        work()
    except BaseException as error:
        print(repr(error), file=sys.stderr)
        os._exit(1)
    os._exit(0)


def main(folder: Path) -> None:
    warnings.filterwarnings("ignore", ".*fork")  # this process has not used JAX
    whole, path = numbers(), folder / "study"
    assert not killed(lambda: fill(make(folder / "reference"), whole), math.inf)
    expected = files(folder / "reference")
    for room in itertools.count():  # creation: nothing or all of it is there
        if not killed(lambda: there(path), room):
            break
        assert not path.exists() or files(path).keys() == empty(expected)
    kills = [room]
    for room in itertools.count():  # a chunk: the earlier ones stay, and the same call completes it
        if not killed(lambda: fill(there(path), whole, [5]), room):
            break
        assert not killed(lambda: check(path, None), math.inf)
    kills.append(room)
    for room in itertools.count(1):  # all of them: each child goes on where the one before was killed
        if not killed(lambda: fill(store := there(path), whole, sorted(set(range(12)) - store.done())), 7 * room):
            break
    kills.append(room - 1)
    assert not killed(lambda: check(path, set(range(12))), math.inf)
    assert {name: data for name, data in files(path).items() if not name.endswith(".partial")} == expected
    print("killed", *kills)


def there(path: Path) -> Store:
    return Store.open(path, CONFIG) or make(path)


def empty(expected: dict[str, bytes]) -> set[str]:
    """The files that a store has from the beginning."""
    written = ("rmse/c.", "diverged_at/c.", *(f"chunks_done/{chunk}.json" for chunk in range(12)))
    return {name for name in expected if not name.startswith(written)}


def check(path: Path, done: set[int] | None) -> None:
    """The log is what the chunks are, and the numbers of those that are done are right."""
    store, whole = there(path), numbers()
    marked = store.marked()
    found = store.done()
    assert found == marked
    assert done is None or found == done
    ds = store.dataset()
    for chunk in range(12):
        for name, array in whole.items():
            place = tuple(store.region(chunk).values())
            values = ds[name].values[place]
            assert values.tobytes() == array[place].tobytes() if chunk in found else np.isnan(values).all()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
