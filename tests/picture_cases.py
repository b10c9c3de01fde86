"""Small runs, a study and proofs that the tests of pictures and of pages share, made once."""

import functools
import json

import jax
import numpy as np
import xarray as xr

import jaxobs
from jaxobs import designs, noise, signals
from jaxobs.designs.polytope import Polytope
from jaxobs.integrators import Euler
from jaxobs.observers import DiscreteKalman, HighGain
from jaxobs.plants import Discretised, IntegratorChain, Pendulum

PLANT = Pendulum()
TS = np.linspace(0, 2, 201)
STARTS = {"x0": [1.0, 0.0], "xhat0": [0.0, 0.0], "ts": TS, "signal": signals.Sine(0.5, 1.0)}
GAMMAS = (2.0, 4.0, 8.0)


def kalman() -> DiscreteKalman:
    """Of a mass that is pushed at random."""
    return DiscreteKalman(Discretised(IntegratorChain(2), Euler(), 0.01), np.array([[30.0]]), np.array([[0.0025]]), np.eye(2))


@functools.cache
def run():
    """One run with lost samples."""
    loud = noise.Sum((noise.Gaussian(0.05), noise.Dropout(0.1)))
    return jaxobs.simulate(PLANT, HighGain(PLANT, [3.0, 2.0], 6.0), noise=loud, key=jax.random.key(0), **STARTS)


@functools.cache
def filtered():
    """A Kalman run on a truth that is drawn as the filter believes."""
    observer, starts = kalman(), {"x0": [0.6, -0.8], "xhat0": [0.0, 0.0], "ts": TS, "key": jax.random.key(4)}
    pushed = noise.Gaussian(float(np.sqrt(30.0)))
    return jaxobs.simulate(observer.model, observer, noise=noise.Gaussian(0.05), disturbance=pushed, **starts)


@functools.cache
def batch():
    """Eight runs of one truth."""
    one = HighGain(PLANT, [3.0, 2.0], 6.0)
    keys = jax.random.split(jax.random.key(1), 8)
    return jax.vmap(lambda key: jaxobs.simulate(PLANT, one, noise=noise.Gaussian(0.05), key=key, **STARTS))(keys)


@functools.cache
def study():
    """q by gamma by 6 seeds, as jaxobs.study lays it out, with drawn numbers: a real one takes longer than all else."""
    rng, size = np.random.default_rng(0), (2, 3, 6)
    axes, times = ("q", "gamma", "seed"), TS[::20]
    level = np.array([[1.0, 2.0, 5.0], [1.5, 0.5, 3.0]])[:, :, None, None] * np.array([0.01, 0.3])
    truth = np.broadcast_to(np.stack([np.cos(times), -np.sin(times)], -1), (*size, len(times), 2))
    decay = np.exp(-times)[:, None] * np.array([1.0, -2.0])
    variables = {
        "diverged_at": (axes, np.full(size, np.inf), {"units": "s"}),
        "peak": ((*axes, "state"), 1 + rng.random((*size, 2)), {"units": "x"}),
        "rmse": ((*axes, "state"), level * np.exp(0.1 * rng.normal(size=(*size, 2))), {"units": "x"}),
        "x": ((*axes, "time", "state"), truth, {}),
        "xhat": ((*axes, "time", "state"), truth + decay * rng.uniform(0.5, 1, (*size, 1, 1)), {}),
    }
    coords = {"q": [0, 1], "gamma": list(GAMMAS), "seed": np.arange(6), "state": [0, 1], "time": times}
    config = json.dumps({"format": 1, "note": "</script><b>"})
    return xr.Dataset(variables, coords, {"jaxobs": jaxobs.__version__, "precision": "float64", "config": config})


@functools.cache
def rungs():
    """The ladder of the pendulum, with structure and slopes left unknown."""
    return designs.ladder(PLANT, alphas=[3.0, 2.0], lipschitz=1.5)


@functools.cache
def region():
    """The region of a Rayleigh oscillator, |x2| <= 2.5."""
    a, reach = np.array([[0.0, 1.0], [-1.0, 0.0]]), 2.5
    model = Polytope(a, np.eye(2)[:, 1:], np.eye(2)[1:], np.array([1 - 3 * reach**2]), np.array([1.0]), np.eye(1, 2))
    inner, outer = (np.array([-2.0, -1.4]), np.array([2.0, 1.4])), (np.array([-np.inf, -reach]), np.array([np.inf, reach]))
    return designs.regional(model, np.array([[6.0], [12.0]]), inner=inner, outer=outer, rate=0.3)
