"""Programs of this folder as processes of their own, for the tests of stores that several of them fill."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


@contextlib.contextmanager
def processes(tmp_path_factory):
    """begin(program, *words, before=()) starts one; those that come later find its compiled loop on the disk, none lives on."""
    cache = os.environ.get("JAX_COMPILATION_CACHE_DIR") or str(tmp_path_factory.mktemp("cache"))
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": cache, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    started = []

    def begin(program: str, *words, before=()) -> subprocess.Popen[str]:
        command = [*before, sys.executable, str(HERE / program), *map(str, words)]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment))
        return started[-1]

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def end(process, limit: float = 200) -> str:
    """What a process that ends well, within so many seconds, still had to print."""
    out, errors = process.communicate(timeout=limit)
    assert process.returncode == 0, errors
    return out
