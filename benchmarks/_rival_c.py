"""The C reference as a contender; the race has compiled it before."""

import math
import os
from pathlib import Path

from _c import Reference
from _job import ALPHAS, Job

VARIANT = os.environ.get("RACE_VARIANT", "vector")


def prepare(job: Job):
    path = Path(os.environ["RACE_LIBRARIES"]) / f"{job.workload}-{job.precision}-{VARIANT}.so"
    reference, study, gains = Reference(path, job.precision), job.study, job.lane_gains().astype(job.dtype)
    common = {"dt": study.dt, "samples": job.steps, "first": job.first, "sigma": job.sigma, "seed": job.seed}
    start = (*study.x0, *study.xhat0)
    if job.workload == "pendulum":
        return lambda: (reference.pendulum(gamma=gains, alphas=ALPHAS, start=start, **common)[0], None)
    if job.workload == "chain":
        substeps = int(os.environ.get("RACE_SUBSTEPS", study.substeps))
        alphas = [math.comb(5, i) for i in range(1, 6)]
        return lambda: (reference.chain(gamma=gains, alphas=alphas, start=start, substeps=substeps, **common), None)
    return lambda: (reference.tracker(mu=gains, start=start, **common), None)
