"""The empty store of a study: metadata, axes and config, written once beside its place and then renamed into it."""

import json
import math
import shutil
import uuid
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec, ZstdCodec

from jaxobs._module import refuse
from jaxobs.studies.config import FORMAT
from jaxobs.studies.durable import abandoned, explained, fingerprint, remove_tree, sync_folder, sync_tree

LOG = "chunks_done"
AXES = "axes.json"  # in the log: {file of a coordinate: [bytes, CRC-32]}
LARGEST = 2_000_000_000  # bytes of one variable in one chunk: the compressor's limit
OWN = ("format", "config", "lane_dims")  # attributes that make a Zarr a study


def create(path: Path, frame: xr.Dataset, variables: Mapping[str, Any], block: dict[str, int], config: Any) -> None:
    """Write the empty store beside `path` and rename it: it is there whole or not at all, and of two workers one wins."""
    _check(variables, block)
    with explained(path, "creating the store"):
        path.parent.mkdir(parents=True, exist_ok=True)
        for left in abandoned(path.parent, f".{path.name}.*.creating"):
            shutil.rmtree(left, ignore_errors=True)
        draft = path.with_name(f".{path.name}.{uuid.uuid4().hex}.creating")
        try:
            _write_empty(draft, frame, variables, block, config)
            sync_tree(draft)
            try:
                draft.rename(path)
            except OSError:
                if not is_there(path):  # else another worker was first
                    raise
            sync_folder(path.parent)
        finally:
            remove_tree(draft)  # Zarr writes with several threads, and stops at the first one that fails


def is_there(path: Path) -> bool:
    """Whether something stands at `path` (an empty directory does not count)."""
    with explained(path, "looking at it"):
        return path.exists() and not (path.is_dir() and not any(path.iterdir()))


def _write_empty(draft: Path, frame: xr.Dataset, variables: Mapping[str, Any], block: dict[str, int], config: Any) -> None:
    frame = frame.assign_attrs({"format": FORMAT, "config": json.dumps(config, sort_keys=True), "lane_dims": list(block)})
    text = [name for name, coord in frame.coords.items() if coord.dtype.kind == "U"]
    # Text of fixed length has no place in Zarr's specification.
    frame = frame.assign_coords({name: frame[name].astype(np.dtypes.StringDType()) for name in text})
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Consolidated metadata", UserWarning)
        checked = {name: {"compressors": [ZstdCodec(), Crc32cCodec()]} for name in frame.variables}
        frame.to_zarr(draft, zarr_format=3, consolidated=False, encoding=checked)
        group = zarr.open_group(draft, mode="r+", zarr_format=3)
        for name, variable in variables.items():
            group.create_array(
                name,
                shape=variable.shape,
                chunks=_chunk(variable, block),
                dtype=variable.dtype,
                fill_value=np.nan,
                compressors=[BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"), Crc32cCodec()],
                chunk_key_encoding={"name": "default", "separator": "."},  # one flat folder a variable
                dimension_names=variable.dims,
                attributes=dict(variable.attrs),
            )
        zarr.consolidate_metadata(draft)  # one file tells all; the folder of the log is then no riddle to readers
    data = [file for file in sorted(draft.rglob("*")) if file.is_file() and file.name != "zarr.json"]
    axes = {file.relative_to(draft).as_posix(): fingerprint(file.read_bytes()) for file in data}
    (draft / LOG).mkdir()
    (draft / LOG / AXES).write_text(json.dumps(axes))


def _chunk(variable: Any, block: dict[str, int]) -> tuple[int, ...]:
    """The lengths of one Zarr chunk: of the block along the lanes, whole along the rest."""
    return tuple(min(block.get(dim, size), size) for dim, size in zip(variable.dims, variable.shape, strict=True))


def _check(variables: Mapping[str, Any], block: dict[str, int]) -> None:
    if not variables:
        raise refuse("Store.create", "variables", "none", "at least one", "A study always has diverged_at.")
    lengths = {tuple(variable.shape[: len(block)]) for variable in variables.values()}
    for name, variable in variables.items():
        if tuple(variable.dims[: len(block)]) != tuple(block) or len(lengths) > 1 or 0 in variable.shape:
            given = f"dims {variable.dims}, shape {variable.shape}"
            fix = "Every variable has them, with the same lengths, at least 1."
            raise refuse("Store.create", name, given, f"the axes {tuple(block)} first", fix)
        if np.dtype(variable.dtype).kind != "f" or name == LOG:
            fix = f"What is missing is NaN, so it has to be a float; {LOG} is the store's own name."
            raise refuse("Store.create", name, f"{variable.dtype}", "a float of another name", fix)
        size = math.prod(_chunk(variable, block)) * np.dtype(variable.dtype).itemsize
        if size > LARGEST:
            fix = "Give a smaller chunk=, or a larger save=, so that a chunk holds less."
            raise refuse("study", "store", f"{size:,} bytes of {name} in one chunk", f"at most {LARGEST:,}", fix)
