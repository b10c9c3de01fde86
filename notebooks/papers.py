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
# # The papers, and what of them holds
#
# Five papers stand behind this package: two by Ibrir (000 on high-gain observers from an algebraic Riccati equation, 001 on
# trackers and algebraic observers), two by Zemouche and co-authors (002 on the HG/LMI observer, 004 on LPV/LMI designs by the
# differential mean value theorem), one by Dufour, Flila and Hammouri (003 on triangular systems and inputs). Each printed number
# and each statement that can be computed is computed again; the verdict and the reason stand beside it.

# %%
import collections

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
import pandas as pd

import jaxobs
from jaxobs import linalg, papers, plotting

rows = list(papers.reproduce("000", short=True))
columns = ["claim", "printed", "ours", "verdict", "why"]
table = pd.DataFrame([[getattr(row, name) for name in columns] for row in rows], columns=columns)
print(dict(collections.Counter(row.verdict for row in rows)))
table.style.hide(axis="index").set_properties(**{"text-align": "left", "vertical-align": "top", "white-space": "normal"})

# %% [markdown]
# `jaxobs reproduce` prints all five, with the claims that take longer; `--figures DIR` draws the figures again.
#
# ## One false step: which poles condition (10) allows
#
# Theorem 1 of paper 000 builds its gain on $Q = \mathrm{diag}(q_i) > 0$, and says that this is no restriction on the Hurwitz
# coefficients. The map from alphas to q, corrected, says which ones are allowed: at n = 2 it is $q_1 = \alpha_1^2 - 2\alpha_2 > 0$,
# so complex poles have to lie within 45 degrees of the real axis.

# %%
allowed, refused = np.array([3.0, 2.0]), np.array([1.0, 2.0])
for alphas in (allowed, refused):
    print(alphas, "poles", np.round(np.roots([1, *alphas]), 3), " q =", np.round(jaxobs.hurwitz.q_from_alphas(alphas), 3))
plotting.poles({"(3, 2)": allowed, "(1, 2)": refused})

# %% [markdown]
# ## The gain does not prove what it could
#
# For the pendulum with alphas (3, 2) and a Lipschitz constant of 3/2, condition (5) asks for a gamma of

# %%
print("smallest gamma of condition (5):", jaxobs.designs.riccati_gamma(alphas=[3.0, 2.0], lipschitz=1.5))
print("the same plant by its slopes:", jaxobs.designs.corners_gamma(alphas=[3.0, 2.0], slopes=[(-1.5, 1.5), (0.0, 0.0)]))

# %% [markdown]
# The observer at the second gamma is as well proved as the one in the paper, by another inequality. What that saves in noise is
# the factor $(\gamma_1 / \gamma_2)^{3/2}$ in the rate:

# %%
slow, fast = (jaxobs.designs.corners_gamma(alphas=[3.0, 2.0], slopes=[(-1.5, 1.5), (0.0, 0.0)]), 6.0)
covariance = linalg.noise_covariance(jnp.array([3.0, 2.0]), 0)
print("noise of x2 in units of sigma sqrt(dt):")
for gamma in (1.05 * slow, fast):
    print(f"  gamma = {gamma:.3g}: {np.sqrt(gamma**3 * covariance[1, 1]):.3g}")

# %% [markdown]
# ## Figure 1 of paper 000, recomputed
#
# The paper's experiment: the pendulum under u = sin(3t/4)/2, gains 18 and 72.

# %%
observer = jaxobs.observers.HighGain(jaxobs.plants.Pendulum(), [3.0, 2.0], 6.0)
ts = np.arange(0.0, 20.0, 0.01)
world = {"x0": [1.0, 0.0], "xhat0": [0.0, 0.0], "ts": ts, "signal": jaxobs.signals.Sine(0.5, 0.75)}
plotting.estimate(jaxobs.simulate(jaxobs.plants.Pendulum(), observer, **world), span=(0.0, 5.0))

# %% [markdown]
# What holds, as a count over all that was computed above:

# %%
table.groupby("verdict").size().rename("claims").to_frame()
