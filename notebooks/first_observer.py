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
# # A first observer
#
# A pendulum of which the angle is measured and the rate is not. An observer is a copy of the plant, run beside it and pulled
# towards the measurement,
#
# $$\hat x' = f(\hat x, u) + L\,(y - h(\hat x)),$$
#
# and the whole question is L. This page takes a plant to an estimate, to a proof that it converges, to the price of noise.

# %%
import jax

jax.config.update("jax_enable_x64", True)

import numpy as np

import jaxobs
from jaxobs import plotting

plant = jaxobs.plants.Pendulum()  # x1' = x2, x2' = sin x1 + u cos x1, y = x1
plant

# %% [markdown]
# ## A gain with a proof
#
# `designs.riccati` takes coefficients of a Hurwitz polynomial, a scale gamma and a Lipschitz constant of
# $\varphi = \sin x_1 + u \cos x_1$, and proves that the error decays: with $|u| \le 1/2$ the constant is
# $\sqrt{1 + 1/4} \approx 1.118$, and 3/2 is on the safe side.
#
# It returns the observer and a certificate: the numbers of the proof. `verify` decides them in exact rational arithmetic.

# %%
observer, certificate = jaxobs.designs.riccati(plant, alphas=[3.0, 2.0], gamma=6.0, lipschitz=1.5)
print("gain L =", observer.gain())
print(certificate.claim)
print(certificate.verify().why)

# %% [markdown]
# Would less do? Each kind of proof asks for something else about $\varphi$, and the more it is told, the smaller the gain that
# it certifies. Solid is where that proof certifies the gain; hatched is where it has no answer, which is not the same as unstable.

# %%
slopes = [(-1.118034, 1.118034), (0.0, 0.0)]
ladder = jaxobs.designs.ladder(plant, alphas=[3.0, 2.0], lipschitz=1.118034, states=[1], slopes=slopes)
plotting.proof_ladder(ladder, at=6.0)

# %% [markdown]
# ## Run it
#
# `simulate` integrates plant and observer together; the noise is sampled on the grid and held. The observer starts at zero,
# the plant does not.

# %%
ts = np.arange(0.0, 20.0, 0.01)
world = {"x0": [1.0, 0.0], "xhat0": [0.0, 0.0], "ts": ts, "signal": jaxobs.signals.Sine(0.5)}
run = jaxobs.simulate(plant, observer, noise=jaxobs.noise.Gaussian(0.05), key=jax.random.key(0), **world)
plotting.estimate(run, span=(0.0, 10.0), names=["angle [rad]", "rate [rad/s]"])

# %%
print("RMSE of angle and rate after 10 s:", np.round(jaxobs.metrics.rmse(run.x[1000:], run.xhat[1000:]), 4))

# %% [markdown]
# ## Fast or quiet
#
# An observer is a pytree and gamma one of its leaves: a grid over it is a batch, and one compiled loop runs all members under
# all seeds. Fast observers forget their start sooner, and pass more noise on.

# %%
gammas = np.geomspace(2.0, 30.0, 8)
clean = {f"gamma = {g:.3g}": jaxobs.observers.HighGain(plant, [3.0, 2.0], g) for g in (2.0, 6.0, 18.0)}
plotting.peaking({name: jaxobs.simulate(plant, one, **world) for name, one in clean.items()}, until=4.0)

# %%
table = jaxobs.study(
    plant,
    jaxobs.grid(observer, gamma=gammas),
    noise=jaxobs.noise.Gaussian(0.05),
    metrics={"rmse": jaxobs.metrics.RMSE(10.0)},
    keys=jaxobs.Seeds(jax.random.key(1), 200),
    **world,
)
plotting.noise_curve(table)

# %% [markdown]
# ## And its derivative
#
# Everything is differentiable: how the error changes with gamma and with each coefficient, at this observer.


# %%
def loss(observer, key):
    """RMSE of the rate after 10 s."""
    rmse = {"rmse": jaxobs.metrics.RMSE(10.0)}
    return jaxobs.score(plant, observer, metrics=rmse, noise=jaxobs.noise.Gaussian(0.05), key=key, **world)["rmse"][1]


slope = jax.grad(loss)(observer, jax.random.key(0))
print("d RMSE / d gamma =", slope.gamma, "  d RMSE / d alphas =", slope.alphas)

# %% [markdown]
# From here: the [papers](papers.py) behind these gains, [noise](noise.py) and how integrators buy it down, [proofs](proofs.py)
# of every kind, [tuning](tuning.py) along these derivatives, and [your own plant](own_plant.py).
