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
# # The recorded walk
#
# A person walks with a sensor on the shank. The angle comes from a magnetometer and accelerometer; its rate is wanted. A
# gyroscope recorded the rate as well: no observer on this page sees it at run time, all are judged by it.

# %%
import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
import pandas as pd
import xarray as xr

import jaxobs
from jaxobs import plotting
from jaxobs.demo.walk import LAST, TRAIN, stride
from jaxobs.observers import DiscreteTracker

walk = jaxobs.datasets.shank_walk()
dt = float(np.mean(np.diff(walk.ts)))
print(f"{len(walk.ts)} samples, one every {1e3 * dt:.3g} ms; a stride takes {stride(walk.rate[TRAIN]) * dt:.2f} s")

# %% [markdown]
# ## One line
#
# `differentiate` needs no model and no gyroscope: its rate mu is the one that predicts the next sample best. The record may be a
# pandas series; lost samples may be NaN.

# %%
record = pd.Series(walk.angle, index=walk.ts, name="angle").where(np.arange(len(walk.ts)) % 97 > 2)  # 3 of 97 samples lost
found = jaxobs.differentiate(record)
error = np.asarray(found.xhat[:, 1]) - walk.rate
print(f"mu = {float(found.mu):.3g} /s; RMSE of the rate in the last quarter: {np.sqrt(np.mean(error[LAST] ** 2)):.3f} rad/s")
plotting.estimate(found, x=np.stack([walk.angle, walk.rate], axis=1), names=["angle [rad]", "rate [rad/s]"], span=(12.0, 16.0))

# %% [markdown]
# ## Which rate?
#
# A grid of trackers over the record is one `vmap`. The first half of the record chooses, the last quarter judges; causal means
# that mu may not look ahead.

# %%
rates = np.geomspace(5.0, 150.0, 40)
start = np.array([walk.angle[0], 0.0, 0.0])


def rate_of(mu):
    return jaxobs.observe(DiscreteTracker(3, 0, mu, dt), walk.ts, walk.angle, xhat0=start).xhat[:, 1]


every = np.asarray(jax.jit(jax.vmap(rate_of))(rates))
rmse = xr.Dataset(
    {
        "first half": ("mu", np.sqrt(np.mean((every - walk.rate)[:, TRAIN] ** 2, axis=1))),
        "last quarter": ("mu", np.sqrt(np.mean((every - walk.rate)[:, LAST] ** 2, axis=1))),
    },
    {"mu": rates},
)
chosen = float(rmse["first half"].idxmin())
for block in rmse:
    print(
        f"{block}: RMSE at mu = {chosen:.3g} /s is {float(rmse[block].sel(mu=chosen)):.3f} rad/s, least {float(rmse[block].min()):.3f}"
    )

# %% [markdown]
# ## What the innovations say
#
# If the model were right, the innovations were white. They are not: a tracker takes the highest derivative for a constant, and a
# leg swings. That is why the demo's observers, which carry the tones of the stride, do better.

# %%
best = jaxobs.observe(DiscreteTracker(3, 0, chosen, dt), walk.ts, walk.angle, xhat0=start)
plotting.innovation(best, after=2.0)

# %% [markdown]
# ## The full comparison
#
# `jaxobs demo` tunes more than twenty observers and references on the first half, chooses between them on the next quarter and
# looks at the last quarter once; `jaxobs tune tune_walk` proves the decay of the one that it tunes. Here is a quick version of
# the former, with a tenth of the steps.

# %%
from jaxobs.demo.walk import study_walk

study = study_walk(quick=True)
keys = ["name", "tuned", "free", "rmse", "rmse_low", "rmse_high", "delay_ms"]
rows = sorted(study.rows, key=lambda row: row.rmse)
pd.DataFrame([[getattr(row, key) for key in keys] for row in rows], columns=keys).round(3)
