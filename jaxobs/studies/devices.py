"""The devices of a study: one for each core of a CPU, for whoever asks, and the compiler's options for its loops."""

import functools
import os
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxobs._module import refuse

# Loops that share their operands become one: a step of a study is then one pass over its lanes.
FLAGS = "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion"


def use_all_cores(count: int | None = None, *, fuse: bool = False) -> int:
    """One CPU device for each core this process may use, or `count`; returns how many. To be called before JAX computes.

    fuse: loops that share their operands become one, an experimental pass of XLA that makes studies at fixed steps faster. It
    is set for the whole process, and XLA has been seen to stop the process over other programs (adaptive steps under vmap): for
    processes that do studies at fixed steps and little else. The command line does both, fuse where the steps are fixed; a
    library call leaves JAX as it is. RuntimeError once JAX has started its devices.
    """
    count = len(os.sched_getaffinity(0)) if count is None and hasattr(os, "sched_getaffinity") else count or os.cpu_count() or 1
    if count < 1:
        raise refuse("use_all_cores", "count", count, "an integer >= 1", "Leave it out for all cores of this process.")
    given = os.environ.get("XLA_FLAGS", "")
    try:
        jax.config.update("jax_num_cpu_devices", count)
    except RuntimeError as error:
        given = f"{jax.local_device_count()} device(s) already in use"
        fix = "Call it right after importing jaxobs, before the first array is made."
        raise RuntimeError(f"use_all_cores: given {given}; expected a JAX that has not started. {fix}") from error
    if fuse and "xla_backend_extra_options" not in given:
        os.environ["XLA_FLAGS"] = f"{given} {FLAGS}".strip()
    return count


def compile_cache(directory: str | Path | None = None) -> Path:
    """Keeps what JAX compiles in `directory` (default: the user's cache), so that a later process starts at once."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    place = Path(directory) if directory is not None else base / "jaxobs"
    jax.config.update("jax_compilation_cache_dir", str(place))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    return place


def mesh() -> Any:
    """All local devices along the axis "lanes"."""
    return jax.sharding.Mesh(np.asarray(jax.local_devices()), ("lanes",))


@functools.cache
def compiler_options() -> dict[str, Any] | None:
    """For the loops of a study: on CPUs, registers as wide as there are."""
    return {"xla_cpu_prefer_vector_width": 512} if jax.default_backend() == "cpu" else None
