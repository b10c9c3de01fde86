"""The study of `study_worker` on other devices, in several processes and on Dask: programs for test_study_distributed.

study_cluster.py devices N STORE        on N host devices
study_cluster.py process I N PORT STORE process I of N of jax.distributed ("none": without a store)
study_cluster.py dask STORE             on two Dask workers, one of which is killed while a chunk is on its way to the disk
"""

import os
import signal
import sys
from functools import partial
from pathlib import Path

import jax
import study_worker

import jaxobs


def say(_) -> None:
    print("computed", flush=True)


def devices(count: str, store: str) -> None:
    jax.config.update("jax_num_cpu_devices", int(count))
    study_worker.run(store)
    print(jax.local_device_count())


def process(index: str, count: str, port: str, store: str) -> None:
    jax.distributed.initialize(f"127.0.0.1:{port}", int(count), int(index))
    complete = study_worker.run(None if store == "none" else store, progress=say).attrs["complete"]
    print(jax.process_count(), complete)


def armed(flag: str) -> None:
    """On a Dask worker: the first to store three chunks dies in the third, its files written and not yet marked."""
    from jaxobs.studies import store

    written, write = [], store.write_whole

    def write_or_die(path: Path, data: bytes) -> None:
        written.append(path)
        if len(written) == 3:
            try:
                os.close(os.open(flag, os.O_CREAT | os.O_EXCL))
                os.kill(os.getpid(), signal.SIGKILL)
            except FileExistsError:
                pass
        write(path, data)

    store.write_whole = write_or_die


def dask(store: str) -> None:
    from distributed import Client, LocalCluster

    from jaxobs.studies.workers import study_on

    study = jaxobs.study
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        client.register_worker_callbacks(setup=partial(armed, f"{store}.killed"))
        seen = []
        jaxobs.study = lambda *args, part, **rest: study_on(client, *args, **(rest | {"progress": seen.append}))
        ds = study_worker.run(store)
        jaxobs.study = study
        assert ds.attrs["complete"]
        assert [one.done for one in seen] == [20 * (i + 1) for i in range(study_worker.CHUNKS)]
        assert seen[-1].left == 0
        print("died" if Path(f"{store}.killed").exists() else "lived")
        try:
            study_on(client, None, None, store=store, ts=[0.0, 1.0], metrics={}, x0=[0.0], xhat0=[0.0], tasks=2, retries=0)
        except ValueError as error:
            print(error)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)  # here only: Dask's workers take it from the call
    {"devices": devices, "process": process, "dask": dask}[sys.argv[1]](*sys.argv[2:])
