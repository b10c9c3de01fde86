"""The contenders of a race: their processes, one for each precision, and what their results are held against."""

import dataclasses
import json
import os
import select
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from _job import Job

PATIENCE = 120.0  # [s] for one answer
HERE = Path(__file__).parent


@dataclasses.dataclass(frozen=True)
class Contender:
    """label in the table, module, what makes it available, further environment."""

    label: str
    module: str
    needs: str = ""
    environment: tuple[tuple[str, str], ...] = ()
    precisions: tuple[str, ...] = ("float32", "float64")
    workloads: tuple[str, ...] = ("pendulum",)
    other_method: tuple[tuple[str, float], ...] = ()  # workload: how far another integrator may be off, relative


EVERY = ("pendulum", "chain", "tracker")
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
CONTENDERS = (
    Contender("C", "_rival_c", "a C compiler", workloads=EVERY),
    Contender("jaxobs", "_rival_jaxobs", workloads=EVERY, other_method=(("chain", 1e-2),)),
    Contender(
        "jaxobs loop", "_rival_jaxobs", environment=(("RACE_PART", "loop"),), workloads=EVERY, other_method=(("chain", 1e-2),)
    ),
    Contender("C, libmvec", "_rival_c", "glibc", (("RACE_VARIANT", "libm"),)),
    Contender("C, scalar", "_rival_c", "a C compiler", (("RACE_VARIANT", "scalar"),), workloads=EVERY),
    # the fewest substeps that are of use on the chain: with 3 the result is off by a third
    Contender(
        "C, 4 steps",
        "_rival_c",
        "a C compiler",
        (("RACE_SUBSTEPS", "4"),),
        workloads=("chain",),
        other_method=(("chain", 0.1),),
    ),
    Contender("numba", "_rival_numba", "numba: pip install -e '.[bench]'"),
    Contender("NumPy", "_rival_numpy"),
    Contender("diffrax", "_rival_diffrax", workloads=EVERY[:2]),
    Contender("scipy", "_rival_scipy", precisions=("float64",), other_method=(("pendulum", 1e-5),)),
)


class Failed(Exception):
    """A contender answered with an error, or died."""


class Entry:
    """The process of one contender in one precision, by itself or under a command such as valgrind's; patience in seconds."""

    def __init__(
        self, contender: Contender, precision: str, libraries: Path, under: tuple[str, ...] = (), patience: float = PATIENCE
    ):
        self.contender, self.under, self.patience = contender, under, patience
        environment = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
        environment |= {"RACE_LIBRARIES": str(libraries), "JAX_ENABLE_X64": str(int(precision == "float64"))}
        self.environment = environment | dict(contender.environment)
        self.process = self._start()

    def _start(self) -> subprocess.Popen[str]:
        command = [*self.under, sys.executable, str(HERE / "_worker.py"), self.contender.module]
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=self.environment)

    def ask(self, command: str, argument: Any) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            print(json.dumps({command: argument}), file=self.process.stdin, flush=True)
            ready, _, _ = select.select([self.process.stdout], [], [], self.patience)
            line = self.process.stdout.readline() if ready else self.give_up()
        except BrokenPipeError:
            line = ""
        if not line:
            line = json.dumps({"error": f"the process ended with {self.process.wait()}"})
        if self.process.poll() is not None:
            self.process = self._start()  # the next job may fare better
        answer = json.loads(line)
        if "error" in answer:
            raise Failed(answer["error"])
        return answer

    def give_up(self) -> str:
        self.process.kill()
        self.process.wait()
        return json.dumps({"error": f"no answer within {self.patience:g} s"})

    def prepare(self, job: Job) -> float:
        return self.ask("prepare", dataclasses.asdict(job))["first"]

    def close(self) -> None:
        if self.process.stdin is not None:
            self.process.stdin.close()
        self.process.wait()


@dataclasses.dataclass(frozen=True)
class Agreement:
    """How far a contender's numbers are from the reference's, in the unit of `measure`, and whether that is close enough."""

    measure: str
    value: float
    close: bool

    def __str__(self) -> str:
        return f"{'yes' if self.close else 'NO'}, {self.measure} {self.value:.2g}"


TOLERANCES = {"float32": 2e-4, "float64": 1e-9}
Z_LIMIT = 4.0


def compare(job: Job, rmse: np.ndarray, lanes: np.ndarray, reference: np.ndarray, allowed: float) -> Agreement:
    """Without noise lane by lane, relative to the reference; with noise the z-score of the mean over lanes.

    Lanes of one seed may share their noise over all gains, so the mean over gains is taken first and the spread over seeds
    counts; what another method may be off is taken away. A few lanes only: each against the spread of the reference over the
    seeds of its gain.
    """
    rmse, reference = rmse.astype(np.float64), reference.astype(np.float64)
    difference = rmse - reference[:, lanes]
    if job.sigma == 0:
        worst = float(np.max(np.abs(difference) / reference[:, lanes]))
        return Agreement("relative difference", worst, worst <= max(allowed, TOLERANCES[job.precision]))
    by_gain = reference.reshape(len(reference), -1, job.seeds)
    if len(lanes) == job.lanes:
        by_seed = difference.reshape(by_gain.shape).mean(axis=1)
        beyond = np.maximum(np.abs(by_seed.mean(axis=1)) - allowed * reference.mean(axis=1), 0)
        scores = beyond / (by_seed.std(axis=1, ddof=1) / np.sqrt(job.seeds))
    else:
        which = lanes // job.seeds
        spread, mean = by_gain.std(axis=2, ddof=1)[:, which], by_gain.mean(axis=2)[:, which]
        scores = ((rmse - mean) / spread).mean(axis=1) * np.sqrt(len(lanes))
    worst = float(np.max(np.abs(scores)))
    return Agreement("z-score", worst, worst <= Z_LIMIT)
