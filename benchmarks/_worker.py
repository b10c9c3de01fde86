"""One contender in a process of its own, so that memory, threads and flags are its own; it answers commands over a pipe.

python benchmarks/_worker.py MODULE     one JSON object a line in, one out:
{"prepare": job} -> {"first": s}        builds the study and runs it once: compilation and first result
{"run": repeats} -> {"seconds": s}      wall time of one run, the mean of `repeats` in a row
{"save": path}   -> {"peak": MB}        writes rmse and lanes of the last run; peak memory since prepare, beyond idle
"""

import importlib
import json
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np
from _job import Job

STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def memory(what: str) -> float:
    """VmRSS or VmHWM (the peak) in MB; without /proc the peak over all time stands for both."""
    if not STATUS.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 1024)
    return next(int(line.split()[1]) for line in STATUS.read_text().splitlines() if line.startswith(what)) / 1024


class Worker:
    def __init__(self, module: str):
        self.contender = importlib.import_module(module)
        self.study, self.result, self.idle = None, None, memory("VmRSS")

    def prepare(self, job: dict) -> dict:
        self.study = self.result = None
        if FORGET.exists():
            FORGET.write_text("5")  # the peak is forgotten
        begin = time.perf_counter()
        self.study = self.contender.prepare(Job(**job))
        self.result = self.study()
        return {"first": time.perf_counter() - begin}

    def run(self, repeats: int) -> dict:
        begin = time.perf_counter()
        for _ in range(repeats):
            self.result = self.study()
        return {"seconds": (time.perf_counter() - begin) / repeats}

    def save(self, path: str) -> dict:
        peak = memory("VmHWM") - self.idle
        rmse, lanes = self.result
        np.savez(path, rmse=rmse, lanes=np.arange(rmse.shape[1]) if lanes is None else lanes)
        return {"peak": peak}


def main() -> None:
    answers, sys.stdout = os.fdopen(os.dup(1), "w"), sys.stderr
    os.dup2(2, 1)  # whatever a contender prints does not get between the answers
    worker = None
    for line in sys.stdin:
        ((command, argument),) = json.loads(line).items()
        try:
            worker = worker or Worker(sys.argv[1])
            answer = getattr(worker, command)(argument)
        except Exception as error:  # any failure of a contender is an answer, not the end of the race
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
