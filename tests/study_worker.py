"""A small study in a process of its own, to be killed: study_worker.py STORE [I COUNT]. Prints a line for each chunk."""

import sys
import time
import warnings

import jax
import numpy as np

import jaxobs
from jaxobs import metrics, noise, signals
from jaxobs.observers import HighGain
from jaxobs.plants import Pendulum

CHUNKS = 24
PAUSE = 0.02  # s after a chunk: those it is to be stopped by would come too late on a fast machine


def run(store=None, part=None, progress=None):
    """2 observers x 3 gains x 2 noise levels x 40 seeds; at the last gain every lane diverges."""
    families = {
        name: jaxobs.grid(HighGain(Pendulum(), alphas=alphas, gamma=2.0), gamma=[2.0, 4.0, 1000.0])
        for name, alphas in {"fast": [3.0, 2.0], "slow": [1.5, 0.5]}.items()
    }
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=UserWarning)  # the step is too long for the last gain
        return jaxobs.study(
            Pendulum(), families, ts=np.linspace(0, 4, 401), metrics={"rmse": metrics.RMSE(1.0)}, x0=[0.5, 0.0],
            xhat0=[0.0, 0.0], keys=jaxobs.Seeds(jax.random.key(3), 40), signal=signals.Sine(0.5, 1.0),
            noise=jaxobs.grid(noise.Gaussian(0.1), sigma=[0.1, 0.2]), store=store, part=part, chunk=20, progress=progress,
        )  # fmt: skip


def report(_):
    print("computed", flush=True)
    time.sleep(PAUSE)


if __name__ == "__main__":
    where, *share = sys.argv[1:]
    jax.config.update("jax_enable_x64", True)
    run(where, (int(share[0]), int(share[1])) if share else None, report)
