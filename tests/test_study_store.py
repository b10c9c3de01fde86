"""The store of a study: what is read is what was written, bit for bit, and only where it belongs."""

import json
import os
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
import zarr
from study_stores import BLOCK, CONFIG, LANES, bits, blocks, files, fill, frame, make, numbers, variables

from jaxobs.studies import creation, durable
from jaxobs.studies.config_diff import differences
from jaxobs.studies.durable import StoreError
from jaxobs.studies.store import Store, open_study


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("lanes", "block"),
    [
        (LANES, BLOCK),
        (LANES, {"observer": 1, "gamma": 2, "seed": 3}),
        ({"seed": 7}, {"seed": 3}),
        ({"gamma": 4}, {"gamma": 9}),
        ({}, {}),
    ],
)
def test_what_is_read_is_what_was_written(tmp_path, lanes, block, dtype):
    store, whole = make(tmp_path / "study", lanes, block, dtype=dtype), numbers(lanes, dtype)
    fill(store, whole)
    assert store.done() == set(range(len(store)))
    assert Store.open(store.path, CONFIG) == store
    for ds in (store.dataset(), open_study(store.path).load(), xr.open_zarr(store.path, chunks=None)):
        assert set(ds.data_vars) == set(whole)
        for name, array in whole.items():
            assert ds[name].dims == variables(lanes)[name].dims
            assert ds[name].dtype == dtype
            assert bits(ds[name].values) == bits(array)
    assert open_study(store.path).attrs["complete"]


def test_every_lane_lies_in_one_chunk_and_every_chunk_has_its_own_files(tmp_path):
    store = make(tmp_path / "study")
    found = np.zeros(tuple(LANES.values()), int)
    for chunk in range(len(store)):
        found[tuple(store.region(chunk).values())] += 1
        for name in store.shapes:
            assert store.chunk_of(store.file(name, chunk).name) == chunk
    assert (found == 1).all()
    before = set(files(store.path))
    fill(store, numbers(), [3])
    new = {str(store.file(name, 3).relative_to(store.path)) for name in store.shapes}
    assert set(files(store.path)) - before == new | {"chunks_done/3.json"}


def test_axes_and_attributes_come_back(tmp_path):
    store = make(tmp_path / "study")
    ds = store.dataset()
    xr.testing.assert_identical(ds.drop_vars(list(ds.data_vars)).drop_attrs(deep=False), frame().drop_attrs(deep=False))
    assert ds["observer"].dtype.kind == "U"
    assert ds["gamma"].attrs == {"units": "1/s"}
    assert ds["rmse"].attrs == {"units": "m"}
    own = {"format": 1, "config": json.dumps(CONFIG, sort_keys=True), "complete": False}
    assert ds.attrs == frame().attrs | own
    assert float(ds["rmse"].sel(observer="steady", gamma=2.0).isnull().mean()) == 1.0


def test_what_is_not_done_reads_as_nan(tmp_path):
    store, whole = make(tmp_path / "study"), numbers()
    fill(store, whole, [1, 4, 5])
    (store.path / "chunks_done" / "4.json").unlink()  # as if killed after the data and before the mark
    ds = open_study(store.path)
    assert not ds.attrs["complete"]
    assert store.done() == store.marked() == {1, 5}
    for chunk in range(len(store)):
        for name, array in blocks(store, whole, chunk).items():
            found = ds[name].isel(store.region(chunk)).values
            assert bits(found) == bits(array) if chunk in (1, 5) else np.isnan(found).all()


def test_the_layout_of_the_store_stays(tmp_path):
    store = make(tmp_path / "study")
    assert make(tmp_path / "study", block={"observer": 1, "gamma": 3, "seed": 3}).block == store.block == BLOCK


def test_another_config_is_refused_with_the_difference(tmp_path):
    store = make(tmp_path / "study")
    fill(store, numbers(), [0])
    before = files(store.path)
    other = {"ts": [0.0, 0.1], "observer": {"q": 2, "gamma": [1.0, 2.5, 3.0]}, "save": 10}
    for call in (lambda: Store.open(store.path, other), lambda: make(store.path, config=other)):
        with pytest.raises(StoreError, match="another study") as caught:
            call()
        lines = [line.strip() for line in str(caught.value).splitlines()[1:]]
        assert lines == [
            "observer.q: stored 1, given 2", "observer.gamma[1]: stored 2.0, given 2.5", "save: stored nothing, given 10",
        ]  # fmt: skip
        assert str(store.path) in str(caught.value)
    assert files(store.path) == before


@pytest.mark.parametrize(
    ("stored", "given", "expected"),
    [
        ({"a": 1}, {"a": 1}, []),
        ({"a": float("nan")}, {"a": float("nan")}, []),
        ({"a": 1}, {"a": 1.0}, ["a: stored 1, given 1.0"]),
        ({"a": True}, {"a": 1}, ["a: stored True, given 1"]),
        ({"a": {"b": [{"c": 1}]}}, {"a": {"b": [{"c": 2}]}}, ["a.b[0].c: stored 1, given 2"]),
        ({"a": [1]}, {"a": [1, 2]}, ["a: stored 1 values [1], given 2 values [1, 2]"]),
        ({"a": 1, "b": 2}, {"b": 2}, ["a: stored 1, given nothing"]),
        ({"a": {"b": 1}}, {"a": "x"}, ["a: stored {'b': 1}, given 'x'"]),
        (1, 2, ["the config: stored 1, given 2"]),
    ],
)
def test_differences(stored, given, expected):
    assert differences(stored, given) == expected


def test_nothing_there(tmp_path):
    assert Store.open(tmp_path / "none", CONFIG) is None
    with pytest.raises(StoreError, match="there is nothing; expected a study"):
        open_study(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    assert Store.open(tmp_path / "empty", CONFIG) is None
    assert len(make(tmp_path / "empty")) == 12
    assert make(tmp_path / "new" / "parents" / "study").marked() == set()


def test_what_is_there_is_on_the_disk(tmp_path, monkeypatch):
    store, whole = make(tmp_path / "study"), numbers()
    synced, unsafe, fsync, replace, rename = set(), [], os.fsync, Path.replace, Path.rename

    def sync(handle):
        synced.add(os.fstat(handle).st_ino)
        return fsync(handle)

    def check(needed):
        unsafe.append([path for path in needed if path.stat().st_ino not in synced])
        synced.clear()

    def marking(self, target):
        if Path(target).parent.name == "chunks_done":
            data = [store.file(name, 4) for name in store.shapes]
            check([self, *data, *(file.parent for file in data)])  # the mark itself, the files, and their names
            assert self != target
        return replace(self, target)

    def creating(self, target):
        check([self, *self.rglob("*")])
        return rename(self, target)

    monkeypatch.setattr(os, "fsync", sync)
    monkeypatch.setattr(Path, "replace", marking)
    fill(store, whole, [4])
    assert unsafe == [[]]
    assert (store.path / "chunks_done").stat().st_ino in synced
    monkeypatch.setattr(Path, "rename", creating)
    make(tmp_path / "other")
    assert unsafe == [[], []]
    assert tmp_path.stat().st_ino in synced


def test_of_two_that_create_one_wins(tmp_path, monkeypatch):
    path, rename = tmp_path / "study", Path.rename
    written = []

    def late(self, target):
        monkeypatch.setattr(Path, "rename", rename)
        other = make(path, block={"observer": 1, "gamma": 3, "seed": 3})
        fill(other, numbers(), [0])
        written.append(files(path))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", late)
    store = make(path)
    assert store.block == {"observer": 1, "gamma": 3, "seed": 3}
    assert [files(path)] == written
    assert [one.name for one in tmp_path.iterdir()] == ["study"]


def test_litter_of_the_dead_is_removed_after_an_hour(tmp_path):
    store = make(tmp_path / "study")
    litter = [tmp_path / ".study.0a.creating" / "zarr.json", store.path / "rmse/c.0.1.0a.partial"]
    litter.append(store.path / "chunks_done/3.json.0a.partial")
    litter[0].parent.mkdir()
    for file in litter:
        file.write_text("")
    fill(store, numbers(), [0])
    Store.open(store.path, CONFIG)
    make(store.path)
    assert all(file.exists() for file in litter)
    old = time.time() - durable.ABANDONED - 1
    for file in (*litter, litter[0].parent):
        os.utime(file, (old, old))
    Store.open(store.path, CONFIG)
    make(store.path)
    assert not any(file.exists() for file in litter)
    assert store.done() == {0}


def test_arguments_that_do_not_fit(tmp_path, monkeypatch):
    store, whole = make(tmp_path / "study"), numbers()
    good = blocks(store, whole, 2)
    for blocks_given, region, message in [
        ({"rmse": good["rmse"]}, store.region(2), "blocks"),
        (good | {"rmse": np.float32(np.zeros_like(good["rmse"]))}, store.region(2), "float32"),
        (good | {"rmse": good["rmse"][..., :2]}, store.region(2), "blocks"),
        (good, store.region(1), "region"),
    ]:
        with pytest.raises(ValueError, match=message):
            store.write(2, region, blocks_given)
    with pytest.raises(ValueError, match="0 to 11"):
        store.region(12)
    assert store.marked() == set()
    flat = variables()
    whole_number = SimpleNamespace(dims=tuple(LANES), shape=tuple(LANES.values()), dtype=np.dtype(int), attrs={})
    for wrong, message in [
        ({"count": whole_number}, "given int64"),
        ({"chunks_done": flat["rmse"]}, "own name"),
        ({"rmse": SimpleNamespace(dims=("seed", "gamma"), shape=(5, 3), dtype=np.dtype(float), attrs={})}, "axes"),
        ({}, "at least one"),
    ]:
        with pytest.raises(ValueError, match=message):
            Store.create(tmp_path / "other", frame(), wrong, BLOCK, CONFIG)
    monkeypatch.setattr(creation, "LARGEST", 47)
    with pytest.raises(ValueError, match="48 bytes of rmse in one chunk"):
        make(tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_other_readers_see_a_plain_zarr(tmp_path):
    store, whole = make(tmp_path / "study"), numbers()
    fill(store, whole)
    group = zarr.open_group(store.path, mode="r")
    assert sorted(name for name, _ in group.arrays()) == ["alphas", "diverged_at", "gamma", "observer", "rmse"]
    assert bits(np.asarray(group["rmse"][...])) == bits(whole["rmse"])
