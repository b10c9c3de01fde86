"""Stores that are damaged, forbidden, no store at all, or out of room: told apart, explained, and nothing is lost."""

import itertools
import math
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from study_stores import (
    CONFIG,
    Disk,
    bits,
    blocks,
    emptied,
    files,
    fill,
    flipped,
    make,
    numbers,
    truncated,
)

from jaxobs.studies.durable import StoreError
from jaxobs.studies.store import Store, open_study


def a_file(path):
    path.write_text("notes")


def a_folder(path):
    path.mkdir()
    (path / "notes.txt").write_text("notes")


def another_zarr(path):
    xr.Dataset({"a": ("b", [1.0])}).to_zarr(path, zarr_format=3, consolidated=False)


def edited(change, name="zarr.json"):
    def spoil(path):
        make(path)
        (path / name).write_text(change((path / name).read_text()))

    return spoil


def damaged(damage, name):
    def spoil(path):
        make(path)
        damage(path / name)

    return spoil


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (a_file, "is a file; expected a directory"),
        (a_folder, "directory without zarr.json"),
        (another_zarr, "is a Zarr, but not one that"),
        (edited(lambda text: text[:100]), "zarr.json cannot be read"),
        (edited(lambda _: "3"), "zarr.json cannot be read"),
        (edited(lambda text: text.replace('"format": 1', '"format": 99')), "has format 99; expected 1"),
        (edited(lambda text: text.replace("float64", "float65")), "metadata are damaged"),
        (edited(lambda text: text.replace('"config": "', '"config": "?')), "metadata are damaged"),
        (damaged(Path.unlink, "gamma/c/0"), "gamma/c/0 is missing or damaged"),
        (damaged(flipped, "observer/c/0"), "observer/c/0 is missing or damaged"),
        (damaged(emptied, "alphas/c/0/0"), "alphas/c/0/0 is missing or damaged"),
        (damaged(shutil.rmtree, "chunks_done"), "reading failed: No such file or directory at .*chunks_done"),
        (damaged(truncated, "chunks_done/axes.json"), "metadata are damaged"),
    ],
)
def test_what_is_no_store_is_refused_and_left_alone(tmp_path, spoil, message):
    path = tmp_path / "study"
    spoil(path)
    before = files(tmp_path)
    for call in (lambda: Store.open(path, CONFIG), lambda: open_study(path)):
        with pytest.raises(StoreError, match=message) as caught:
            call()
        assert str(path) in str(caught.value)
    assert files(tmp_path) == before


@pytest.fixture
def unprivileged(tmp_path):
    """Permissions bind every user but root, who becomes another for the time of the test."""
    if os.geteuid() != 0:
        yield
        return
    for folder in (tmp_path, *tmp_path.parents[:3]):
        folder.chmod(0o755)
    os.seteuid(65534)
    yield
    os.seteuid(0)


def test_without_permission(tmp_path, unprivileged):
    owner = os.geteuid()
    os.seteuid(os.getuid())
    store, whole = make(tmp_path / "study"), numbers()
    fill(store, whole, [0, 1])
    before = files(store.path)
    secret = tmp_path / "secret"
    shutil.copytree(store.path, secret)
    for path, mode in ((tmp_path, 0o555), (store.path / "rmse", 0o555), (secret, 0o000), (secret / "zarr.json", 0o000)):
        path.chmod(mode)
    os.seteuid(owner)
    try:
        with pytest.raises(StoreError, match=r"writing chunk 2 of 12 failed: Permission denied at .*rmse"):
            fill(store, whole, [2])
        with pytest.raises(StoreError, match=r"secret.*Permission denied.*right to read"):
            Store.open(secret, CONFIG)
        with pytest.raises(StoreError, match=r"creating the store failed: Permission denied"):
            make(tmp_path / "elsewhere")
        assert open_study(store.path).attrs["complete"] is False  # reading needs no right to write
        assert bits(open_study(store.path)["rmse"].isel(store.region(1)).values) == bits(blocks(store, whole, 1)["rmse"])
    finally:
        os.seteuid(os.getuid())
        for path in (tmp_path, store.path / "rmse", secret):
            path.chmod(0o755)
    assert files(store.path) == before


@pytest.mark.parametrize(
    ("which", "damage"),
    [
        *itertools.product(["rmse/c.0.2.0.0"], [Path.unlink, truncated, emptied, flipped]),
        ("rmse/c.0.2.0.0", lambda file: shutil.copy(file.with_name("c.0.1.0.0"), file)),  # whole, but of another chunk
        *itertools.product(["chunks_done/4.json"], [truncated, emptied]),
        ("chunks_done/4.json", lambda file: file.write_text("[]")),
        ("chunks_done/4.json", lambda file: shutil.copy(file.with_name("3.json"), file)),
        ("chunks_done/4.json", lambda file: file.write_text('{"chunk": 4, "files": {"rmse": [1, 2]}}')),
    ],
)
def test_a_damaged_chunk_is_told_and_computed_again(tmp_path, which, damage):
    store, whole = make(tmp_path / "study"), numbers()
    fill(store, whole)
    before = files(store.path)
    damage(store.path / which)
    with pytest.raises(StoreError, match=r"c\.0\.2\.0.*of chunk 4 is missing or damaged.*computes it again"):
        store.dataset().load()
    untouched = store.dataset()["rmse"].isel(gamma=1)
    assert bits(untouched.values) == bits(whole["rmse"][:, 1])  # the other chunks are read as ever
    assert store.done({0, 1, 2}) == {0, 1, 2}
    with pytest.warns(UserWarning, match="chunk 4 is damaged"):
        assert store.done() == set(range(12)) - {4}
    assert store.done() == set(range(12)) - {4}  # the log is true again
    assert np.isnan(store.dataset()["rmse"].isel(store.region(4)).values).all()
    fill(store, whole, [4])
    assert files(store.path) == before


def test_the_checksum_is_in_the_files_for_every_reader(tmp_path):
    store = make(tmp_path / "study")
    fill(store, numbers())
    flipped(store.file("rmse", 4))
    with pytest.raises(ValueError, match="checksum"):
        xr.open_zarr(store.path, chunks=None).load()


def raised(act) -> StoreError | None:
    try:
        act()
    except StoreError as error:
        return error
    return None


def test_a_full_disk_loses_the_chunk_in_flight_alone(tmp_path, monkeypatch):
    store, whole = make(tmp_path / "study"), numbers()
    fill(store, whole)
    finished, mark = files(store.path), "chunks_done/4.json"
    disk = Disk(monkeypatch)
    for room in itertools.count():
        (store.path / mark).unlink(missing_ok=True)
        disk.full_after(room)
        error = raised(lambda: fill(store, whole, [4]))
        disk.full_after(math.inf)
        assert store.done() >= set(range(12)) - {4}
        assert files(store.path) | {mark: finished[mark]} == finished  # nothing lost, no litter
        if error is None:
            break
        assert "writing chunk 4 of 12 failed: No space left on device" in str(error)
        assert "Free space" in str(error)
    assert room >= 8  # two files and a mark: opened, synchronised and renamed
    assert files(store.path) == finished


def test_a_full_disk_leaves_no_half_created_store(tmp_path, monkeypatch):
    small: dict = {"lanes": {"seed": 3}, "block": {"seed": 2}}
    make(tmp_path / "reference", **small)
    reference = files(tmp_path / "reference")
    disk, path = Disk(monkeypatch), tmp_path / "study"
    for room in itertools.count():
        disk.full_after(room)
        if (error := raised(lambda: make(path, **small))) is None:
            break
        assert "Free space" in str(error)
        assert {one.name for one in tmp_path.iterdir()} <= {"reference", "study"}  # no draft
        if path.exists():  # full after it was renamed: it is whole
            assert files(path) == reference
            shutil.rmtree(path)
    assert room > 10
    assert files(path) == reference


def test_a_variable_without_its_metadata(tmp_path):
    store = make(tmp_path / "study")
    (store.path / "rmse" / "zarr.json").unlink()
    assert np.isnan(store.dataset()["rmse"].values).all()  # they stand in the zarr.json of the whole as well
    with pytest.raises(StoreError, match=r"metadata are damaged.*rmse"):
        fill(store, numbers(), [0])
    assert store.marked() == set()
