"""A study on disk: one Zarr (v3) data set, one file for each variable and chunk, and a log of the chunks that are done.

    DIR/zarr.json            attributes, config, all metadata (consolidated)
    DIR/NAME/c.0.3.0         one chunk of one variable
    DIR/chunks_done/7.json   chunk 7 is done: size and CRC-32 of its files (axes.json: those of the coordinates)

A chunk is done when its mark is there, and the mark is written after the files of the chunk are on the disk. So a kill, a full
disk or a loss of power costs the chunks in flight and nothing else, and workers share nothing that two of them write.
`xarray.open_zarr(DIR, chunks=None)` reads the data set without jaxobs; `open_study` also checks what it reads.
"""

import contextlib
import dataclasses
import functools
import json
import math
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

from jaxobs._module import refuse
from jaxobs.studies.config import FORMAT
from jaxobs.studies.config_diff import differences
from jaxobs.studies.creation import AXES, LOG, OWN, create, is_there
from jaxobs.studies.durable import StoreError, abandoned, explained, fingerprint, sync_file, sync_folder, write_whole
from jaxobs.studies.stored import Done

OTHER = "Give another directory; nothing was changed."


@dataclasses.dataclass(frozen=True)
class Store:
    """The study stored in the directory `path`: made by `Store.create`, opened by `Store.open` (to go on) or `Store.read`.

    block: the length of a chunk along every lane axis, in order. dims, shapes, dtypes: of every variable, lane axes first.
    Chunk i is the i-th box of that grid in C order, `region(i)` its slices.
    """

    path: Path
    config: dict[str, Any]
    dims: dict[str, tuple[str, ...]]
    shapes: dict[str, tuple[int, ...]]
    dtypes: dict[str, np.dtype]
    block: dict[str, int]

    @staticmethod
    def create(
        path: Path | str, frame: xr.Dataset, variables: Mapping[str, Any], block: Mapping[str, int], config: Mapping[str, Any]
    ) -> "Store":
        """An empty store, or the one that another worker has made there meanwhile (then as `Store.open`).

        frame: coordinates and attributes. variables: anything with dims, shape, dtype (a float) and attrs. config: what
        determines the numbers, as JSON. StoreError if there is something else, or nothing can be written.
        """
        create(Path(path).resolve(), frame, variables, dict(block), json.loads(json.dumps(config)))
        store = Store.open(path, config)
        if store is None or {name: tuple(v.shape) for name, v in variables.items()} != store.shapes:
            raise StoreError(f"store {path}: what is there is not what was written. {OTHER}")
        return store

    @staticmethod
    def open(path: Path | str, config: Mapping[str, Any]) -> "Store | None":
        """The store of this study; None if nothing is there. StoreError if it cannot be used, or holds another config."""
        if not is_there(Path(path).resolve()):
            return None
        store = Store.read(path)
        if found := differences(store.config, json.loads(json.dumps(config))):
            text = "".join(f"\n  {one}" for one in found[:8]) + (f"\n  and {len(found) - 8} more" if len(found) > 8 else "")
            fix = "Give the study that is stored, or another directory for this one; nothing was changed."
            raise StoreError(f"store {store.path}: holds another study. {fix}{text}")
        store.sweep()
        return store

    @staticmethod
    def read(path: Path | str) -> "Store":
        """The store in this directory, whatever its config. StoreError if there is none, or it cannot be read."""
        path = Path(path).resolve()
        attributes = _attributes(path)
        with explained(path, "reading"), _damaged_metadata(path):
            _check_axes(path)
            ds = xr.open_zarr(path, chunks=None, consolidated=True)
            found = {str(name): ds[name] for name in ds.data_vars}
            sizes = next(iter(found.values())).encoding["chunks"]
            return Store(
                path,
                json.loads(attributes["config"]),
                {name: tuple(map(str, one.dims)) for name, one in found.items()},
                {name: one.shape for name, one in found.items()},
                {name: one.dtype for name, one in found.items()},
                dict(zip(attributes["lane_dims"], sizes, strict=False)),
            )

    def dataset(self) -> xr.Dataset:
        """What is done by now: see `open_study`."""
        done = self.marked()
        with explained(self.path, "reading"), _damaged_metadata(self.path):
            ds = xr.open_zarr(Done(self, done), chunks=None, consolidated=True)
            text = [name for name, coord in ds.coords.items() if coord.dtype.kind == "T"]
            ds = ds.assign_coords({name: ds[name].astype(object).astype(np.str_) for name in text})  # as in memory
        del ds.attrs["lane_dims"]
        return ds.assign_attrs(complete=len(done) == len(self))

    @property
    def sizes(self) -> dict[str, int]:
        """The lengths of the lane axes."""
        return dict(zip(self.block, next(iter(self.shapes.values())), strict=False))

    @property
    def grid(self) -> tuple[int, ...]:
        """How many chunks each lane axis has."""
        return tuple(math.ceil(n / self.block[dim]) for dim, n in self.sizes.items())

    def __len__(self) -> int:
        """How many chunks there are."""
        return math.prod(self.grid)

    def region(self, chunk: int) -> dict[str, slice]:
        """Where chunk `chunk` lies on the lane axes."""
        place = zip(self._place(chunk), self.sizes.items(), strict=True)
        return {dim: slice(i * self.block[dim], min((i + 1) * self.block[dim], n)) for i, (dim, n) in place}

    def write(self, chunk: int, region: Mapping[str, slice], blocks: Mapping[str, np.ndarray]) -> None:
        """Store a chunk and mark it as done. blocks: for every variable its values on `region`, which is `region(chunk)`.

        When this returns they are on the disk. StoreError if they are not (a full disk, no permission): then it is not done.
        """
        if dict(region) != self.region(chunk):
            raise refuse("Store.write", "region", dict(region), f"{self.region(chunk)}", f"Chunk {chunk} lies there.")
        index = tuple(region.values())
        lanes = tuple(s.stop - s.start for s in index)
        found = {name: (one.dtype, one.shape) for name, one in blocks.items()}
        expected = {name: (self.dtypes[name], (*lanes, *shape[len(lanes) :])) for name, shape in self.shapes.items()}
        if found != expected:
            raise refuse("Store.write", "blocks", found, f"{expected}", "The store was created with these variables.")
        with explained(self.path, f"writing chunk {chunk} of {len(self)}"), _damaged_metadata(self.path):
            for name, values in blocks.items():
                self._arrays[name][(*index, ...)] = values
            files = {name: fingerprint(sync_file(self.file(name, chunk))) for name in blocks}
            for name in blocks:
                sync_folder(self.path / name)
            write_whole(self._mark(chunk), json.dumps({"chunk": chunk, "files": files}).encode())

    def marked(self) -> set[int]:
        """The chunks that the log calls done, their files unread."""
        with explained(self.path, "reading the log"):
            stems = [entry.stem for entry in (self.path / LOG).iterdir() if entry.suffix == ".json"]
        return {int(stem) for stem in stems if stem.isdecimal() and int(stem) < len(self)}

    def done(self, chunks: Iterable[int] | None = None) -> set[int]:
        """Which of these chunks (None: of all) are done, every file of theirs read again and found as it was written.

        A chunk whose mark or file is damaged or missing loses its mark, with a warning: it is to be computed again.
        """
        marked = self.marked()
        asked = marked if chunks is None else marked & set(chunks)
        return {chunk for chunk in sorted(asked) if self._intact(chunk)}

    def files_of(self, chunk: int) -> dict[str, list[int]] | None:
        """{variable: [bytes, CRC-32]} from the mark of a chunk; None if it has none, or one that is damaged."""
        with explained(self.path, f"reading the mark of chunk {chunk}"):
            try:
                mark = json.loads(self._mark(chunk).read_bytes())
                return mark["files"] if mark["chunk"] == chunk and set(mark["files"]) == set(self.shapes) else None
            except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError):
                return None

    def file(self, name: str, chunk: int) -> Path:
        """Where a chunk of a variable lies."""
        inner = len(self.shapes[name]) - len(self.block)
        return self.path / name / ".".join(["c", *map(str, self._place(chunk)), *["0"] * inner])

    def chunk_of(self, file: str) -> int:
        """The chunk to which the file of this name belongs."""
        place = [int(i) for i in file.split(".")[1 : 1 + len(self.block)]]
        return int(np.ravel_multi_index(place, self.grid)) if place else 0

    def sweep(self) -> None:
        """Remove what killed processes have left half-written, an hour after."""
        for name in (*self.shapes, LOG):
            for path in abandoned(self.path / name, "*.partial"):
                path.unlink(missing_ok=True)

    @functools.cached_property
    def _arrays(self) -> dict[str, zarr.Array]:
        arrays = {name: zarr.open_array(self.path / name, mode="r+", zarr_format=3) for name in self.shapes}
        # A chunk of nothing but NaN (every lane diverged) gets a file as any other.
        return {name: array.with_config({"write_empty_chunks": True}) for name, array in arrays.items()}

    def _place(self, chunk: int) -> list[int]:
        if not 0 <= chunk < len(self):
            raise refuse("Store", "chunk", chunk, f"0 to {len(self) - 1}", f"{self.path} has {len(self)} chunks.")
        return [int(i) for i in np.unravel_index(chunk, self.grid)] if self.grid else []

    def _mark(self, chunk: int) -> Path:
        return self.path / LOG / f"{chunk}.json"

    def _intact(self, chunk: int) -> bool:
        why = "its mark cannot be read"
        if (files := self.files_of(chunk)) is not None:
            why = ""
            with explained(self.path, f"reading chunk {chunk}"):
                for name, written in files.items():
                    file = self.file(name, chunk)
                    if not file.exists():
                        why = f"{file} is missing"
                    elif (found := fingerprint(file.read_bytes())) != written:
                        why = f"{file} has [bytes, CRC-32] = {found}, written were {written}"
        if why:
            with explained(self.path, f"removing the mark of chunk {chunk}"):
                self._mark(chunk).unlink(missing_ok=True)
            warnings.warn(f"store {self.path}: chunk {chunk} is damaged ({why}); it is to be computed again.", stacklevel=3)
        return not why


def open_study(path: Path | str) -> xr.Dataset:
    """The data set of the study stored at `path`; its values are read, and checked, when they are used.

    NaN where a chunk was not done when this was called; the attribute `complete` says whether all were. `.load()` brings all of
    it into memory. StoreError if there is no study there, and at use if a file is damaged (study() with this store repairs it).
    """
    return Store.read(path).dataset()


def _attributes(path: Path) -> dict[str, Any]:
    """The attributes of the store at `path`, checked to be of this format."""
    with explained(path, "reading"):
        try:
            text = (path / "zarr.json").read_bytes()
        except NotADirectoryError as error:
            raise StoreError(f"store {path}: is a file; expected a directory that holds a study. {OTHER}") from error
        except FileNotFoundError as error:
            found = "is a directory without zarr.json" if path.exists() else "there is nothing"
            raise StoreError(f"store {path}: {found}; expected a study. {OTHER}") from error
    try:
        attributes = json.loads(text)["attributes"]
    except (ValueError, KeyError, TypeError) as error:
        raise StoreError(f"store {path}: zarr.json cannot be read ({error!r}). {OTHER}") from error
    if not isinstance(attributes, dict) or not set(OWN) <= set(attributes):
        raise StoreError(f"store {path}: is a Zarr, but not one that jaxobs.study wrote. {OTHER}")
    if attributes["format"] != FORMAT:
        fix = "Read it with the version of jaxobs that wrote it, or give another directory."
        raise StoreError(f"store {path}: has format {attributes['format']}; expected {FORMAT}. {fix}")
    return attributes


def _check_axes(path: Path) -> None:
    """The coordinates are as they were written: Zarr itself takes a missing file for one of zeros."""
    for name, written in json.loads((path / LOG / AXES).read_bytes()).items():
        if not (path / name).exists() or fingerprint((path / name).read_bytes()) != written:
            fix = "Restore it, or give another directory: the chunks that are done are untouched."
            raise StoreError(f"store {path}: {name} is missing or damaged. {fix}")


@contextlib.contextmanager
def _damaged_metadata(path: Path) -> Iterator[None]:
    """What zarr and xarray raise over damaged metadata, as a StoreError."""
    try:
        yield
    except StoreError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, StopIteration) as error:
        fix = "Restore its zarr.json files, or give another directory: the chunks that are done are untouched."
        raise StoreError(f"store {path}: its metadata are damaged ({error!r}). {fix}") from error
