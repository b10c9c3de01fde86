"""Several devices, several processes and Dask workers end with the data set of one process on one device, bit for bit."""

import importlib.util
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from study_processes import end, processes
from study_stores import bits
from study_worker import CHUNKS

import jaxobs
from jaxobs.studies.store import Store, open_study

LIMIT = 200  # s for one process
slow = pytest.mark.slow


@pytest.fixture(scope="module")
def start(tmp_path_factory):
    """Starts study_cluster.py, or study_worker.py with nothing but a store."""
    with processes(tmp_path_factory) as begin:
        yield lambda *words: begin("study_cluster.py" if words[1:] else "study_worker.py", *words)


@pytest.fixture(scope="module")
def undisturbed(start, tmp_path_factory):
    path = tmp_path_factory.mktemp("undisturbed") / "study"
    end(start(path))
    return open_study(path).load()


def assert_same(path: Path, undisturbed) -> None:
    found = open_study(path).load()
    assert found.attrs["complete"]
    assert found.attrs["fingerprint"] == undisturbed.attrs["fingerprint"]
    assert set(found.variables) == set(undisturbed.variables)
    for name, one in undisturbed.variables.items():
        assert bits(one.values) == bits(found[name].values), name


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@slow
@pytest.mark.parametrize("count", [2, 3])
def test_host_devices(count, tmp_path, start, undisturbed):
    assert end(start("devices", count, tmp_path / "study")).split()[-1] == str(count)
    assert_same(tmp_path / "study", undisturbed)


@slow
def test_two_processes_killed_and_started_again(tmp_path, start, undisturbed):
    """Each does its half; one is killed after its first chunk, and the cluster is started again with the same call."""
    path, port = tmp_path / "study", free_port()
    first, second = (start("process", i, 2, port, path) for i in range(2))
    assert second.stdout.readline() == "computed\n"
    second.kill()
    first.kill()
    rest = [process.communicate(timeout=LIMIT)[0] for process in (first, second)]
    done = len(Store.read(path).done())
    assert 0 < done < CHUNKS
    assert done <= 1 + sum(text.count("computed") for text in rest)
    port = free_port()
    told = [end(process) for process in [start("process", i, 2, port, path) for i in range(2)]]
    assert sum(text.count("computed") for text in told) == CHUNKS - done
    assert all(text.split()[-2] == "2" for text in told)
    assert "True" in {text.split()[-1] for text in told}  # whoever ends last sees all of it
    assert_same(path, undisturbed)


@slow
def test_several_processes_need_a_store(start):
    port = free_port()
    for process in [start("process", i, 2, port, "none") for i in range(2)]:
        _, errors = process.communicate(timeout=LIMIT)
        assert process.returncode != 0
        assert "ValueError: study.store: given None; expected a folder that all 2 processes see" in errors


@slow
@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="needs jaxobs[dask]")
def test_a_dask_worker_killed_while_it_writes(tmp_path, start, undisturbed):
    told = end(start("dask", tmp_path / "study"))
    assert told.splitlines()[0] == "died"
    assert re.search(r"study\.\w+: given", told.splitlines()[1])  # what is wrong with a call is said here
    assert_same(tmp_path / "study", undisturbed)


class Client:
    def submit(self):
        raise AssertionError


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"client": None}, r"study_on\.client: given None; expected a distributed\.Client.*jaxobs\[dask\]"),
        ({"part": (0, 2)}, r"study_on\.part: given \(0, 2\); expected nothing"),
        ({"tasks": 0}, r"study_on\.tasks: given 0"),
        ({"retries": -1}, r"study_on\.retries: given -1"),
        ({"progress": 3}, r"progress: given 3"),
    ],
)
@pytest.mark.usefixtures("as_users_have_it")
def test_bad_calls(given, message):
    client = given.pop("client", Client())
    with pytest.raises(ValueError, match=message):
        jaxobs.studies.study_on(client, None, None, store="nowhere", **given)


def test_dask_stays_out_until_it_is_used():
    code = "import sys, jaxobs; jaxobs.studies.study_on; print({'dask', 'distributed'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert done.stdout == "set()\n", done.stderr
