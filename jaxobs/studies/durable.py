"""Files that are there whole or not at all, also after a kill or a loss of power, and errors that say what to do."""

import contextlib
import errno
import os
import shutil
import time
import uuid
import zlib
from collections.abc import Iterator
from pathlib import Path

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}
ABANDONED = 3600.0  # s; a temporary file this old belongs to a process that died


class StoreError(OSError, ValueError):
    """The store of a study cannot be used: the message names the path, what was found there, and what to do."""


@contextlib.contextmanager
def explained(path: Path, doing: str) -> Iterator[None]:
    """An error of the file system, raised again as a StoreError that names `path`, what failed and the way out."""
    try:
        yield
    except StoreError:
        raise
    except OSError as error:
        if error.errno in FULL:
            fix = "Free space, or move the store, and give the same call again: the chunks that are done are kept."
        elif error.errno in FORBIDDEN:
            fix = "Give this user the right to read and write there, or another directory."
        else:
            fix = "Repair it and give the same call again (the chunks that are done are kept), or give another directory."
        where = "" if error.filename is None else f" at {error.filename}"
        raise StoreError(f"store {path}: {doing} failed: {error.strerror or error}{where}. {fix}") from error


def write_whole(path: Path, data: bytes) -> None:
    """`path` holds `data`, and is on the disk, or it is as it was: temporary file, fsync, rename, fsync of the folder."""
    temporary = path.with_name(f"{path.name}.{uuid.uuid4().hex}.partial")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def fingerprint(data: bytes) -> list[int]:
    """[size in bytes, CRC-32]."""
    return [len(data), zlib.crc32(data)]


def sync_file(path: Path) -> bytes:
    """What the file holds; it is on the disk when this returns."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
        return file.read()


def sync_tree(folder: Path) -> None:
    """Every file and folder below `folder`, and itself, are on the disk when this returns."""
    for root, _, names in os.walk(folder):
        for name in names:
            sync_file(Path(root, name))
        sync_folder(Path(root))


def sync_folder(folder: Path) -> None:
    """The names in `folder` are on the disk when this returns (Windows cannot, and does not need it)."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove_tree(folder: Path) -> None:
    """Remove a folder to which another thread may still be writing."""
    for _ in range(50):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(0.02)


def abandoned(folder: Path, pattern: str) -> list[Path]:
    """The temporary files or folders of processes that died: those that match and have not changed for `ABANDONED` seconds."""
    found = []
    for path in folder.glob(pattern):
        with contextlib.suppress(FileNotFoundError):  # its owner lives, and has just renamed it
            if time.time() - path.stat().st_mtime > ABANDONED:
                found.append(path)
    return found
