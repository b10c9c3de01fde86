"""Studies that are killed, interrupted, run out of disk or share a store end with the data set of an undisturbed one."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from study_processes import end, processes
from study_stores import bits, files
from study_worker import CHUNKS, run

from jaxobs.studies.store import Store, open_study

pytestmark = pytest.mark.slow
HERE = Path(__file__).parent
LIMIT = 120  # s for one process


@pytest.fixture(scope="module")
def start(tmp_path_factory):
    """Starts a worker on a store, with its part of it."""
    with processes(tmp_path_factory) as begin:
        yield lambda store, *part, before=(): begin("study_worker.py", store, *part, before=before)


@pytest.fixture(scope="module")
def undisturbed(start, tmp_path_factory):
    path = tmp_path_factory.mktemp("undisturbed") / "study"
    end(start(path))
    return path


def follow(process, lines: int) -> int:
    """Waits until a worker has computed so many chunks, or all it had."""
    return sum(1 for _ in zip(range(lines), process.stdout, strict=False))


def assert_same(path: Path, undisturbed: Path) -> None:
    """Every file but the date is the same, byte for byte, and so are the numbers that are read."""
    ours, theirs = files(path), files(undisturbed)
    theirs["zarr.json"] = theirs["zarr.json"].replace(created(undisturbed), created(path))
    assert {name for name in ours if not name.endswith(".partial")} == set(theirs)
    assert not [name for name in theirs if ours[name] != theirs[name]]
    one, other = open_study(path).load(), open_study(undisturbed).load()
    assert one.attrs["complete"]
    assert all(bits(one[name].values) == bits(other[name].values) for name in other.variables if other[name].dtype.kind != "U")


def created(path: Path) -> bytes:
    return open_study(path).attrs["created"].encode()


def test_the_store_has_the_numbers_of_the_study_in_memory(undisturbed):
    stored, memory = open_study(undisturbed), run()
    assert set(stored.variables) == set(memory.variables)
    for name, variable in memory.variables.items():
        assert variable.dims == stored[name].dims
        assert variable.attrs == stored[name].attrs
        np.testing.assert_array_equal(variable.values, stored[name].values, strict=True)
    assert {k: v for k, v in memory.attrs.items() if k != "created"} == {
        k: v for k, v in stored.attrs.items() if k != "created"
    }
    diverged = np.isfinite(stored["diverged_at"])
    assert diverged.sel(gamma=1000.0).all()  # whole chunks of them
    assert not diverged.sel(gamma=2.0).any()


def test_killed_at_every_operation(tmp_path):
    done = subprocess.run([sys.executable, str(HERE / "store_killed.py"), str(tmp_path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    kills = [int(word) for word in done.stdout.split()[1:]]
    assert min(kills) > 5


def test_killed_at_any_time_and_resumed(tmp_path, start, undisturbed):
    draw, path, marked, cut_short = random.Random(5), tmp_path / "study", set(), 0
    while cut_short < 5 and len(marked) < CHUNKS:  # a fast machine may be done before the fifth
        process = start(path)
        computed = follow(process, draw.randint(0, 5))
        time.sleep(draw.uniform(0, 0.05))
        process.kill()
        rest = process.communicate(timeout=LIMIT)[0]
        if not path.exists():
            continue
        store, before = Store.read(path), marked
        marked = store.marked()
        cut_short += len(marked) < CHUNKS
        assert before <= marked
        assert len(marked) >= len(before) + computed + rest.count("computed") - 1  # at most the one in flight is lost
        assert store.done() == marked  # none of them damaged
    assert cut_short >= 2
    assert end(start(path)).count("computed") == CHUNKS - len(marked)
    assert_same(path, undisturbed)


def test_ctrl_c_stops_after_the_chunk_in_flight(tmp_path, start, undisturbed):
    path = tmp_path / "study"
    process = start(path)
    computed = follow(process, 3)
    process.send_signal(signal.SIGINT)
    rest, errors = process.communicate(timeout=LIMIT)
    assert process.returncode != 0
    assert "KeyboardInterrupt" in errors
    assert f"kept in {path}" in errors
    computed += rest.count("computed")
    assert computed < CHUNKS
    assert len(Store.read(path).done()) == computed
    assert end(start(path)).count("computed") == CHUNKS - computed
    assert end(start(path)) == ""  # nothing is left to do
    assert_same(path, undisturbed)


def test_two_workers_on_one_store_one_of_them_killed_and_replaced(tmp_path, start, undisturbed):
    path = tmp_path / "study"
    first, second = start(path, 0, 2), start(path, 1, 2)
    follow(first, 4)
    first.kill()
    follow(first, CHUNKS)
    done = len(Store.read(path).marked() & set(range(0, CHUNKS, 2)))
    assert 3 <= done < CHUNKS // 2
    replacement = start(path, 0, 2)
    assert end(second).count("computed") == CHUNKS // 2
    assert end(replacement).count("computed") == CHUNKS // 2 - done
    assert_same(path, undisturbed)
    assert [one.name for one in tmp_path.iterdir()] == ["study"]


def test_two_workers_that_do_the_same(tmp_path, start, undisturbed):
    path = tmp_path / "study"
    for process in [start(path), start(path)]:
        end(process)
    assert_same(path, undisturbed)


def mounting() -> list[str] | None:
    """A command that runs another with file systems of its own, if this machine lets us."""
    for options in ("-m", "-rm"):
        trial = ["unshare", options, "sh", "-c", "mount -t tmpfs -o size=64k none /mnt"]
        try:
            if subprocess.run(trial, capture_output=True).returncode == 0:
                return ["unshare", options]
        except OSError:
            pass
    return None


ON_A_SMALL_DISK = """
mount -t tmpfs -o size="$1",nr_inodes=0 none "$0/disk" || exit 99
shift
"$@" && echo "ended well"
ls -A "$0/disk" > "$0/left"
cp -r "$0/disk" "$0/when_full"
mount -o remount,size=64m none "$0/disk" || exit 99
"$@" && cp -r "$0/disk" "$0/freed"
"""


@pytest.mark.parametrize(("size", "least"), [("16k", 0), ("200k", 1)])
def test_a_full_disk(tmp_path, start, undisturbed, size, least):
    if (unshare := mounting()) is None:
        pytest.skip("no right to mount a small disk")
    (tmp_path / "disk").mkdir()
    process = start(tmp_path / "disk/study", before=[*unshare, "sh", "-c", ON_A_SMALL_DISK, str(tmp_path), size])
    out, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, errors
    assert "StoreError" in errors
    assert "No space left on device" in errors
    assert "Free space, or move the store" in errors
    assert "ended well" not in out
    full = tmp_path / "when_full/study"
    marked = Store.read(full).marked() if full.exists() else set()
    assert least <= len(marked) < CHUNKS
    assert (tmp_path / "left").read_text().split() == ["study"] * full.exists()  # no draft
    assert not marked or Store.read(full).done() == marked
    assert_same(tmp_path / "freed/study", undisturbed)
    assert not list((tmp_path / "freed").rglob("*.partial"))
