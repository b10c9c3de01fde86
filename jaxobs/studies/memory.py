"""How much memory a study may use at once: a share of what is free, whatever limits the process."""

import os
from pathlib import Path

import jax

SHARE = 4  # a quarter of the free memory: compiled code and other processes want some too
UNKNOWN = 2**30  # where nothing can be found out


def free_memory(root: Path = Path("/")) -> int:
    """Bytes: of the accelerator if JAX uses one, else the least of MemAvailable and what the control group leaves."""
    device = jax.local_devices()[0]
    statistics = device.memory_stats() if device.platform != "cpu" else None
    if statistics and "bytes_limit" in statistics:
        return statistics["bytes_limit"] - statistics.get("bytes_in_use", 0)
    known = [size for size in (_available(root), _group_v2(root), _group_v1(root)) if size is not None]
    return max(0, min(known)) if known else UNKNOWN


def _available(root: Path) -> int | None:
    try:
        lines = (root / "proc/meminfo").read_text().splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError):
        names = getattr(os, "sysconf_names", {})
        name = next((name for name in ("SC_AVPHYS_PAGES", "SC_PHYS_PAGES") if name in names), None)
        return os.sysconf(name) * os.sysconf("SC_PAGE_SIZE") if name else None


def _group_v2(root: Path) -> int | None:
    """The limit of every control group above this process, less what it uses."""
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
        own = next(line.removeprefix("0::/") for line in lines if line.startswith("0::"))
    except (OSError, StopIteration):
        return None
    top = root / "sys/fs/cgroup"
    folders = [top, *(top.joinpath(*own.split("/")[:i]) for i in range(1, own.count("/") + 2))] if own else [top]
    left = [_left(folder / "memory.max", folder / "memory.current") for folder in folders]
    return min((size for size in left if size is not None), default=None)


def _group_v1(root: Path) -> int | None:
    folder = root / "sys/fs/cgroup/memory"
    return _left(folder / "memory.limit_in_bytes", folder / "memory.usage_in_bytes")


def _left(limit: Path, used: Path) -> int | None:
    try:
        return int(limit.read_text()) - int(used.read_text())
    except (OSError, ValueError):  # no such group, or the limit "max"
        return None
