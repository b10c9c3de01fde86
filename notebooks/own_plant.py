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
# # Your own plant
#
# From two functions to an estimate with a proof. The first plant is a chain already; the second one, a bioreactor, becomes
# triangular in other coordinates.

# %%
import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np

import jaxobs
from jaxobs import designs, plotting, structure
from jaxobs.observers import Luenberger, PulledBack
from jaxobs.plants import from_function

# %% [markdown]
# ## Two functions
#
# The state x = (angle, rate) of a damped pendulum under a torque u, of which the angle is measured. What is handed over as
# `parameters` can be varied, differentiated and tuned; numbers written into the functions cannot.


# %%
def f(x, u, c):
    return [x[1], -c["gravity"] * jnp.sin(x[0]) - c["damping"] * x[1] + u[0]]


def h(x, u, c):
    return x[0]


plant = from_function(f, h, n=2, m=1, parameters={"gravity": 1.0, "damping": 0.1})

# %% [markdown]
# ## What is it?
#
# The pattern of the Jacobian holds for every x and u: it is read off the formulas of f, not off samples. On a box the slopes are
# bounded as well, which gives the Lipschitz constant that a design asks for.

# %%
found = structure.forms(plant, states=([-np.inf] * 2, [np.inf] * 2), inputs=([-0.5], [0.5]))
print(found)

# %% [markdown]
# ## A design and its proof

# %%
observer, certificate = designs.riccati(found.chain, lipschitz=found.slopes.constant)
verdict = certificate.verify()
print(certificate.claim, "->", verdict.why)
assert verdict

# %% [markdown]
# ## A run
#
# The plant with a measured angle in noise, and the observer beside it.

# %%
ts = np.arange(0.0, 20.0, 0.01)
world = {"ts": ts, "signal": jaxobs.signals.Sine(0.5), "noise": jaxobs.noise.Gaussian(0.02)}
run = jaxobs.simulate(plant, observer, x0=[1.0, 0.0], xhat0=[0.0, 0.0], key=jax.random.key(0), **world)
print("RMSE after 5 s:", jaxobs.metrics.rmse(run.x[500:], run.xhat[500:]))
plotting.estimate(run, span=(0.0, 8.0), names=["angle [rad]", "rate [rad/s]"])

# %% [markdown]
# ## A plant that is in no form
#
# Biomass x1 and substrate x2 in a stirred tank with Contois growth, the dilution rate u is the input and the biomass is
# measured (Gauthier, Hammouri and Othman 1992).


# %%
def reactor(x, u):
    growth = x[0] * x[1] / (x[0] + x[1])
    return [growth - u[0] * x[0], -growth + u[0] * (0.1 - x[1])]


def biomass(x, u):
    return x[0]


tank = from_function(reactor, biomass, n=2, m=1)
print(structure.forms(tank))

# %% [markdown]
# ## Is it observable?
#
# y and its derivative along the flow tell the state where the Jacobian of the observability map has full rank. On this region
# interval arithmetic proves it, and the formulas prove that no input hides anything.

# %%
region = {"states": ([0.02, 0.02], [0.08, 0.08]), "inputs": ([0.0], [0.1])}
seen = structure.observability(tank, **region)
print(seen)
assert seen.regular == "proved"

# %% [markdown]
# ## Other coordinates
#
# In z = (y, y') at u = 0 the plant is triangular. A gain chosen for z runs in the coordinates of the plant: the correction is
# multiplied by the inverse of the Jacobian at the estimate, and no equation is solved for x.

# %%
form = structure.normal_form(tank, **region)
slopes = structure.normal_slopes(form, **region)
print(slopes)

theta = 1.0
tank_observer = PulledBack(Luenberger(form, [[2 * theta], [theta**2]]))
ts = np.arange(0.0, 40.0, 0.05)
flow = jaxobs.signals.Sine(0.02, 0.3, 0.0, 0.05)
run = jaxobs.simulate(tank, tank_observer, x0=[0.04, 0.06], xhat0=[0.04, 0.03], ts=ts, signal=flow)
error = np.abs(np.asarray(run.x - run.xhat))
print(f"error of the substrate: {error[0, 1]:.3g} at the start, {error[-1, 1]:.3g} at the end")
assert error[-1].max() < 1e-3 * error[0].max()
plotting.estimate(run, names=["biomass", "substrate"])

# %% [markdown]
# The observability of the tank is proved, and so are the bounds on its slopes; that this gain converges was only simulated. What
# a proof would need is a gain that dominates the slopes printed above, here in the coordinates z.
