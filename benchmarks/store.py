"""What the store of a study costs: seconds for a chunk = overhead + bytes / bandwidth, for writing, checking and reading.

A lane has `rmse` of n states and `diverged_at`, of float32, with the digits of a Monte Carlo study (they hardly compress). Each
chunk is written as study() writes it: compressed, on the disk (fsync), marked as done. Checked: as a resumed study reads it.
The same with plain NumPy files, on the disk as well, tells what of it is the disk. Medians; the disk is that of DIR.
Run: .venv/bin/python benchmarks/store.py [DIR] [chunks of each size] [states]
"""

import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr

from jaxobs.studies.outputs import Variable
from jaxobs.studies.store import Store, open_study

WHERE = Path(sys.argv[1]) if len(sys.argv) > 1 else None
CHUNKS = int(sys.argv[2]) if len(sys.argv) > 2 else 8
STATES = int(sys.argv[3]) if len(sys.argv) > 3 else 2
SIZES = [2**k for k in (8, 12, 15, 18, 21)]  # lanes in a chunk
MANY = 2_000  # chunks, to see what a long log costs


def seconds(work) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def make(path: Path, lanes: int, chunks: int) -> Store:
    total = lanes * chunks
    variables = {
        "rmse": Variable(("seed", "state"), (total, STATES), np.dtype(np.float32), {}),
        "diverged_at": Variable(("seed",), (total,), np.dtype(np.float32), {}),
    }
    return Store.create(path, xr.Dataset(), variables, {"seed": lanes}, {"lanes": total})


def numbers(lanes: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(lanes)
    rmse = np.abs(rng.normal(0.1, 0.01, (lanes, STATES))).astype(np.float32)
    return {"rmse": rmse, "diverged_at": np.full(lanes, np.inf, np.float32)}


def plain(folder: Path, blocks: dict[str, np.ndarray], chunk: int) -> None:
    for name, values in blocks.items():
        with (folder / f"{name}.{chunk}").open("wb") as file:
            values.tofile(file)
            os.fsync(file.fileno())


def row(folder: Path, lanes: int) -> tuple[int, float, float, float, float, float]:
    """(bytes of a chunk in memory, bytes on disk, seconds to write, to write plainly, to check, to read it)."""
    store, blocks = make(folder / f"study{lanes}", lanes, CHUNKS), numbers(lanes)
    write, bare = [], []
    for chunk in range(CHUNKS):
        write.append(seconds(lambda chunk=chunk: store.write(chunk, store.region(chunk), blocks)))
        bare.append(seconds(lambda chunk=chunk: plain(folder, blocks, chunk)))
    check = [seconds(lambda chunk=chunk: store.done([chunk])) for chunk in range(CHUNKS)]
    read = [seconds(lambda chunk=chunk: open_study(store.path).isel(store.region(chunk)).load()) for chunk in range(CHUNKS)]
    kept = sum(store.file(name, 0).stat().st_size for name in blocks)
    memory = sum(values.nbytes for values in blocks.values())
    return memory, kept, *(statistics.median(times) for times in (write, bare, check, read))


def main() -> None:
    folder = Path(tempfile.mkdtemp(prefix="store-benchmark-", dir=WHERE))
    try:
        print(f"{folder}: {STATES} states, float32, {CHUNKS} chunks of each size")
        heads = ("lanes", "bytes", "on disk", "B/lane", "write ms", "chunks/s", "MB/s", "plain ms", "check ms", "read ms")
        print(" ".join(f"{head:>9}" for head in heads))
        rows = []
        for lanes in SIZES:
            memory, kept, write, bare, check, read = row(folder, lanes)
            rows.append((memory, write))
            print(
                f"{lanes:>9} {memory:>9} {kept / memory:>8.0%} {kept / lanes:>10.2f} {write * 1e3:>9.2f} {1 / write:>9.1f} "
                f"{memory / write / 1e6:>9.1f} {bare * 1e3:>8.2f} {check * 1e3:>9.2f} {read * 1e3:>8.2f}", flush=True,
            )  # fmt: skip
        (least, quick), (most, slow) = rows[0], rows[-1]
        print(f"a chunk: {quick * 1e3:.2f} ms + bytes / {(most - least) / (slow - quick) / 1e6:.0f} MB/s")
        store, blocks = make(folder / "many", 1, MANY), numbers(1)
        for chunk in range(MANY):
            store.write(chunk, store.region(chunk), blocks)
        print(f"{MANY} chunks: opened in {seconds(lambda: Store.open(store.path, store.config)) * 1e3:.0f} ms, ", end="")
        print(f"log read in {seconds(store.marked) * 1e3:.0f} ms, all checked in {seconds(store.done) * 1e3:.0f} ms")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
