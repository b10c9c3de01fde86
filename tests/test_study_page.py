"""The programs of docs/studies.md run as printed, but for fewer seeds, another folder and the address of the scheduler."""

import importlib.util
import os
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jaxobs.studies.store import open_study

PAGE = (Path(__file__).parent.parent / "docs/studies.md").read_text()
BIN = Path(sys.executable).parent
LIMIT = 200  # s for one program
pytestmark = pytest.mark.slow


def block(language: str, containing: str) -> str:
    (found,) = (text for text in re.findall(rf"```{language}\n(.*?)```", PAGE, flags=re.DOTALL) if containing in text)
    return found


@pytest.fixture
def run(tmp_path):
    """Writes a Python program of the page into a folder and runs it there."""

    def running(name: str, **changes: str) -> str:
        for containing in ("mystudy.py", name):
            text = block("python", f"# {containing}").replace("1_000", "3").replace("/shared/", "")
            for old, new in changes.items():
                text = text.replace({"address": '"tcp://scheduler:8786"', "initialize": "distributed.initialize("}[old], new)
            (tmp_path / containing).write_text(text)
        command = [sys.executable, "-W", "error", name]
        done = subprocess.run(command, cwd=tmp_path, env=environment(), capture_output=True, text=True, timeout=LIMIT)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return running


def environment(**more: str) -> dict[str, str]:
    return os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}", **more}


def complete(path: Path) -> bool:
    ds = open_study(path)
    return ds.attrs["complete"] and bool(ds.diverged_at.notnull().all())


def test_on_a_laptop(run, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert run("mystudy.py").count(".") == 16
    assert complete(tmp_path / "pendulum.study")


def test_with_jax_distributed(run, tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert run("cluster.py", initialize=f'distributed.initialize("127.0.0.1:{port}", 1, 0, ').split() == ["0", "True"]
    assert complete(tmp_path / "pendulum.study")


def test_as_a_job_array(tmp_path):
    script = block("bash", "#SBATCH").replace("100000", "2").replace("study_pendulum", "study_pendulum --set observer.q=0")
    for index in "01":
        slurm = {"SLURM_ARRAY_TASK_ID": index, "SLURM_ARRAY_TASK_COUNT": "2", "STORE": str(tmp_path / "study")}
        done = subprocess.run(["bash", "-c", script], env=environment(**slurm), capture_output=True, text=True, timeout=LIMIT)
        assert done.returncode == 0, done.stderr
    assert complete(tmp_path / "study")


@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs jaxobs[dask]")
def test_on_dask(run, tmp_path):
    scheduler, worker = block("bash", "dask worker").splitlines()
    where, quiet = tmp_path / "scheduler.json", "--no-dashboard --scheduler-file scheduler.json"
    commands = [f"exec {scheduler} --host 127.0.0.1 --port 0 {quiet}"]
    commands += [f"exec {worker.replace('tcp://scheduler:8786', '')} {quiet}"]
    given = {"env": environment(), "cwd": tmp_path, "stderr": subprocess.DEVNULL}
    started = []
    try:
        for command in commands:
            started.append(subprocess.Popen(["bash", "-c", command], **given))
            begun = time.monotonic()
            while not where.exists() and time.monotonic() - begun < LIMIT:
                time.sleep(0.1)
        told = run("on_dask.py", address='scheduler_file="scheduler.json"').split()
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait(timeout=LIMIT)
    assert told[0] == "True"
    assert complete(tmp_path / "pendulum.study")
