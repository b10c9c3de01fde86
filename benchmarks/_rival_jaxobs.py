"""jaxobs: the study as a user writes it; with RACE_PART=loop its compiled loop alone, without the checks and the data set.

Lanes with one start and no disturbance share their plant, which jaxobs then integrates once for all of them. The race is about
equal work: x0 is given as an axis of one member, so that every lane has a plant of its own. RACE_SHARED=1 lets it share.
"""

import os

import jax
import jax.numpy as jnp
import numpy as np
from _job import ALPHAS, Job

import jaxobs
from jaxobs.integrators import RK4, Exponential
from jaxobs.studies.devices import use_all_cores
from jaxobs.studies.groups import make_groups
from jaxobs.studies.kernel import compile_group

use_all_cores(fuse=True)


def prepare(job: Job):
    plant, family, integrator, signal = (jaxobs.astype(part, job.dtype) for part in _parts(job))
    noise = jaxobs.astype(jaxobs.noise.Gaussian(job.sigma), job.dtype) if job.sigma else None
    keys = jaxobs.Seeds(jax.random.key(job.seed), job.seeds) if job.sigma else None
    x0 = job.study.x0 if os.environ.get("RACE_SHARED") else [job.study.x0]
    metrics, start = {"rmse": jaxobs.metrics.RMSE(job.after)}, {"x0": x0, "xhat0": job.study.xhat0}
    what = {"ts": job.times(), "metrics": metrics, "keys": keys, "signal": signal, "noise": noise, "integrator": integrator}

    def study():
        rmse = jaxobs.study(plant, family, **what, **start)["rmse"]
        return rmse.to_numpy().reshape(job.lanes, -1).T, None

    if os.environ.get("RACE_PART") != "loop":
        return study
    _, (group,) = make_groups(plant, family, **what, **start, disturbance=None, hold_innovation=False, save=None)
    run = compile_group(group, chunk=job.lanes)
    return lambda: (np.asarray(run(0)["rmse"]).T, None)


def _parts(job: Job):
    """(plant, observers, integrator, signal)"""
    if job.workload == "pendulum":
        plant = jaxobs.plants.Pendulum()
        observer, name = jaxobs.observers.HighGain(plant, np.asarray(ALPHAS), 1.0), "gamma"
        integrator, signal = RK4(), jaxobs.signals.Sine(0.5)
    elif job.workload == "chain":
        plant = jaxobs.plants.SineChain(1.0, 5)
        observer, name = jaxobs.observers.HighGain(plant, jaxobs.hurwitz.binomial(5), 1.0), "gamma"
        integrator, signal = Exponential(), None
    else:
        plant = jaxobs.plants.SampledChain(3, job.study.dt)
        observer, name = jaxobs.observers.DiscreteTracker(3, 1, 1.0, job.study.dt), "mu"
        integrator, signal = None, None
    values = jnp.asarray(job.gains(), job.dtype)
    return plant, jaxobs.Family(jaxobs.astype(observer, job.dtype), (values,), (name,)), integrator, signal
