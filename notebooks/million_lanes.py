# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A million lanes
#
# A Monte Carlo study as one compiled loop: plant, observer, noise and running metrics advance together, lanes are numbers of
# one array, and nothing is kept of the trajectories. Memory is lanes times states, however long the runs are.

# %%
import tempfile
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np

import jaxobs
from jaxobs import plotting

plant = jaxobs.astype(jaxobs.plants.Pendulum(), np.float32)
observer = jaxobs.astype(jaxobs.observers.HighGain(jaxobs.plants.Pendulum(), [3.0, 2.0], 6.0), np.float32)
gammas, sigmas = np.geomspace(2.0, 20.0, 16), np.geomspace(0.01, 0.1, 8)
family = jaxobs.grid(observer, gamma=gammas)
noise = jaxobs.grid(jaxobs.astype(jaxobs.noise.Gaussian(0.1), np.float32), sigma=sigmas)
SEEDS = 8192
print(f"{len(gammas)} gammas x {len(sigmas)} noise levels x {SEEDS:,} seeds = {len(gammas) * len(sigmas) * SEEDS:,} lanes")

# %% [markdown]
# Arguments of the study may be grids: the observer's gamma and the noise's sigma here, true plant and starts as well. Each axis
# gets its name in the data set. Axes that change shapes (q, n, the observer itself) compile once each, all others are lanes.

# %%
world = {
    "x0": [0.5, 0.0],
    "xhat0": [0.5, 0.0],
    "ts": np.arange(0.0, 4.0, 0.01),
    "signal": jaxobs.astype(jaxobs.signals.Sine(0.5), np.float32),
    "noise": noise,
    "metrics": {"rmse": jaxobs.metrics.RMSE(np.float32(2.0))},
}
seconds = {}
for seeds in (256, SEEDS):
    begin = time.perf_counter()
    ds = jaxobs.study(plant, family, keys=jaxobs.Seeds(jax.random.key(0), seeds), **world)
    seconds[seeds] = time.perf_counter() - begin
lanes = len(gammas) * len(sigmas)
rate = lanes * (SEEDS - 256) * (len(world["ts"]) - 1) / (seconds[SEEDS] - seconds[256])
print(
    f"{lanes * SEEDS:,} lanes x {len(world['ts'])} samples: {seconds[SEEDS]:.1f} s; {rate / 1e6:.0f} million lane-steps a second"
)
ds

# %%
plotting.noise_map(ds, rows="sigma", columns="gamma")

# %% [markdown]
# ## How many seeds were needed?
#
# The running mean and its 95 % band, over the seeds.

# %%
plotting.convergence(ds.isel(gamma=[0, 15], sigma=[7]).squeeze("sigma").isel(seed=slice(0, 2000)))

# %% [markdown]
# ## Kept, and resumed
#
# With `store=` each chunk is written when it is done. The same call again computes what is missing, after a crash too, and the
# result is the same to the last bit; another config is refused with the difference.

# %%
with tempfile.TemporaryDirectory() as folder:
    store = Path(folder) / "study.zarr"
    kept = jaxobs.study(plant, family, keys=jaxobs.Seeds(jax.random.key(0), 64), store=store, **world)
    begin = time.perf_counter()
    again = jaxobs.study(plant, family, keys=jaxobs.Seeds(jax.random.key(0), 64), store=store, **world)
    print(f"again: {time.perf_counter() - begin:.2f} s, equal to the last bit: {bool((kept.rmse == again.rmse).all())}")
    try:
        jaxobs.study(plant, family, keys=jaxobs.Seeds(jax.random.key(0), 128), store=store, **world)
    except Exception as error:
        print(type(error).__name__, "-", str(error)[:220])

# %% [markdown]
# One machine, many devices, a job array or a Dask cluster fill the same store: see [studies](../docs/studies.md). What hand-written
# C, numba, NumPy, diffrax and scipy need for the same is what `benchmarks/race.py` measures.
