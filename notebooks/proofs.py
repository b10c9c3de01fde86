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
# # Proofs that a stranger can check
#
# Each design of jaxobs ends in a file: the gain, the bounds, the witnesses, the claim and what it assumes. Whether the claim
# follows from the numbers is decided in exact rational arithmetic by short programs of the standard library, `checker.py` and
# those beside it (`checker_more.py` knows all theorems). This notebook designs observers, writes their certificates into
# `certificates/` and has the checkers judge them in a Python that has no jaxobs.
#
# Written anew by `python notebooks/proofs.py`; open it as a notebook with jupytext.

# %%
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np

import jaxobs
from jaxobs import designs, plants
from jaxobs.certificates.bounds import with_bounds
from jaxobs.designs import corner_lmi
from jaxobs.designs.lpv_from import lpv_from
from jaxobs.designs.polytope import Polytope

HERE = Path(__file__).parent if "__file__" in globals() else Path()
FOLDER = Path(os.environ.get("JAXOBS_CERTIFICATES", HERE / "certificates"))
FOLDER.mkdir(parents=True, exist_ok=True)


def write(name, certificate):
    """The file of a certificate that holds."""
    verdict = certificate.verify()
    assert verdict, verdict.why
    certificate.to_json(FOLDER / f"{name}.json")
    print(f"{name}: {getattr(certificate, 'claim', verdict.why)}")


# %% [markdown]
# ## The pendulum, proved in four ways
#
# Paper 000 asks for condition (5), from a Lipschitz constant of phi alone. The S-lemma with a free Lyapunov matrix knows that
# only the angle enters phi, and proves far smaller gains.

# %%
PENDULUM = plants.Pendulum()
write("condition5", designs.riccati(PENDULUM, alphas=jnp.array([3.0, 2.0]), gamma=6.0, lipschitz=1.5)[1])
SLOPE = designs.NormBounded.lipschitz(2, 1.5, [1])
write("s_lemma", designs.s_lemma(PENDULUM, alphas=jnp.array([3.0, 2.0]), slope=SLOPE)[1])
write("euler_model", designs.euler_riccati(PENDULUM, alphas=jnp.array([3.0, 2.0]), gamma=6.0, dt=0.01, slope=SLOPE)[1])

# %% [markdown]
# The bounds can travel too: formulas of the Jacobian and a bisection of the box that proves them, which
# `checker_bounds.py` checks again with interval arithmetic of its own.

# %%
ANGLES, INPUTS = (np.array([-4.0, -np.inf]), np.array([4.0, np.inf])), (np.array([-0.5]), np.array([0.5]))
PROVED = lpv_from(PENDULUM, None, ANGLES, inputs=INPUTS)
GAIN = np.array([[6.0], [9.0]])
CERTIFICATE = corner_lmi.prove(PROVED.model, GAIN, rate=1.0, origin=PROVED.origin)
FLOW = lambda x, u: PENDULUM.flow(jnp.zeros(()), x, u)  # noqa: E731
BOX = [np.concatenate(ends) for ends in zip(ANGLES, INPUTS, strict=True)]
write("proved_bounds", with_bounds(CERTIFICATE, FLOW, *BOX, relax=0.01))

# %% [markdown]
# ## Bounds on slopes: corners, high gain, least noise

# %%
CHAIN = plants.IntegratorChain(n=3)
BOUNDS = np.array([[-1.0, 1.0], [-0.5, 1.0], [-1.0, 0.0]])
write("high_gain_lmi", designs.high_gain_lmi(CHAIN, bounds=BOUNDS, j0=1)[1])

SHIFT, LAST, FIRST = np.eye(3, k=1), np.eye(3)[:, -1:], np.eye(1, 3)
MODEL = Polytope(SHIFT, LAST, np.full((1, 3), 0.5), np.array([-1.0]), np.array([1.0]), FIRST)
NOISE = {"weight": LAST.T, "process": LAST, "noise": np.array([[0.1]])}
for name, objective in (("h2", designs.H2(**NOISE)), ("l2", designs.L2(**NOISE)), ("least_gain", designs.Gain())):
    found = designs.synthesize(MODEL, objective=objective, rate=0.5)
    write(name, found.certificate)
    print(f"    level {found.level:.6g}, gain {np.ravel(found.gain)}")

# %% [markdown]
# ## Samples, a wrong model, a region
#
# On the continuous plant with the innovation held between samples; with a disturbance that the model lacks; and for slopes
# that are bounded on a box only.

# %%
SWING = Polytope(np.eye(2, k=1), np.eye(2)[:, -1:], np.eye(1, 2), np.array([-1.5]), np.array([1.5]), np.eye(1, 2))
write("sampled", designs.sampled_data(SWING, GAIN, delta=0.05))
write("mismatch", designs.ultimate_bound(SWING, GAIN, disturbance=np.eye(2)[:, -1:], size=0.1, noise_size=0.01))
A = np.array([[0.0, 1.0], [-1.0, 0.0]])
SPRING = Polytope(A, np.eye(2)[:, -1:], np.eye(1, 2), np.array([-12.0]), np.array([0.0]), np.eye(1, 2))
INNER, OUTER = np.array([[-1.0, -np.inf], [1.0, np.inf]]), np.array([[-2.0, -np.inf], [2.0, np.inf]])
SETS = {"inner": tuple(INNER), "outer": tuple(OUTER), "rate": 0.5}
write("regional", designs.regional(SPRING, np.array([[12.0], [30.0]]), **SETS))

# %% [markdown]
# ## What cannot be
#
# Negative answers are proved as well: a gain without a common quadratic Lyapunov function, parameters at which no gain helps,
# floors under every gain and under every filter.

# %%
UNSTABLE = np.array([[1.0], [0.5]])
write("no_gain", designs.no_gain(SWING, UNSTABLE, rate=1.0))
FLOOR, PROOF = designs.gain_floor(SWING, rate=1.0)
write("gain_floor", PROOF)
write("kalman_floor", designs.kalman_floor(MODEL, NOISE["weight"], NOISE["process"], NOISE["noise"]))
BLIND = Polytope(np.diag([-1.0, 0.5]), np.eye(2)[:, :1], np.eye(2)[1:], np.array([-1.0]), np.array([1.0]), np.eye(1, 2))
write("undetectable", designs.undetectable(BLIND).certificate)
write("frozen_instability", designs.audit(SWING, UNSTABLE).counterexample)

# %% [markdown]
# ## The judges, alone
#
# These programs in an empty folder, in a Python without site-packages.

# %%
with tempfile.TemporaryDirectory() as empty:
    for checker in Path(jaxobs.certificates.__file__).parent.glob("checker*.py"):
        shutil.copy(checker, empty)
    files = sorted(map(str, FOLDER.resolve().glob("*.json")))
    alone = [sys.executable, "-E", "-s", "-S"]
    judged = subprocess.run([*alone, "checker_more.py", *files], cwd=empty, capture_output=True, text=True, check=True)
    bounds = [file for file in files if Path(file).stem == "proved_bounds"]
    travelled = subprocess.run([*alone, "checker_bounds.py", *bounds], cwd=empty, capture_output=True, text=True, check=True)
print("\n".join(line for line in judged.stdout.splitlines() if not line.startswith("  ")))
print(travelled.stdout)
