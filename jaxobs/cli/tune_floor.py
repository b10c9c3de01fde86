"""The floors beside the RMSE of a config's cases."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import noise
from jaxobs._module import refuse
from jaxobs.plants import AbstractFlowPlant
from jaxobs.studies import Seeds
from jaxobs.tuning.floors import disturbance_covariance, kalman_bound
from jaxobs.tuning.posterior_bound import posterior_cramer_rao

TRAJECTORIES, KEY = 200, 2  # of the posterior bound

WORDS = {
    "kalman": "floor: the Kalman filter that knows plant and noises, with y at the samples",
    "posterior": "floor: posterior Cramer-Rao bound of any estimator that knows plant, noises and start, with y at the samples",
    "none": "floor: none is known here",
}


def deviation(part: Any, where: str) -> float:
    """sigma of independent samples. ValueError for another noise, or none."""
    if isinstance(part, noise.Gaussian):
        return float(part.sigma)
    if isinstance(part, noise.Uniform):
        return float(part.width) / np.sqrt(3.0)
    given = "nothing" if part is None else type(part).__name__
    fix = 'Its covariance enters here: name = "Gaussian"; else take objective.kind = "monte_carlo" and check.floor = "none".'
    raise refuse("config", where, given, "Gaussian or Uniform noise", fix)


def floor_of(kind: str, plants: list[Any], around: dict[str, Any], dt: float, after: float) -> list[float]:
    """One number a state: the root of the mean of its square over the plants."""
    found = [_one(kind, plant, around, dt, after) for plant in plants]
    return np.sqrt(np.mean(np.square(found), axis=0)).tolist()


def _one(kind: str, plant: Any, around: dict[str, Any], dt: float, after: float) -> np.ndarray:
    flow = isinstance(plant, AbstractFlowPlant)
    var = deviation(around["noise"], "noise") ** 2 * np.eye(plant.p)
    if kind == "kalman":
        zero, u = jnp.zeros(plant.n), jnp.zeros(plant.m)
        if not flow:
            fix = 'Take floor = "posterior": for a linear step plant it is the Kalman filter.'
            raise refuse("config", "check.floor", "'kalman' for a step plant", "a flow plant", fix)
        a, c = (np.asarray(jax.jacfwd(f)(zero)) for f in (lambda x: plant.flow(jnp.zeros(()), x, u), lambda x: plant.h(x, u)))
        _require_linear(plant, a, u)
        e = np.asarray(plant.disturbance_matrix())
        process = deviation(around["disturbance"], "disturbance") ** 2 * e @ e.T
        return kalman_bound(a, c, process, var, dt=dt, held=True).rmse
    options = {"dt": dt, "held": False} if flow else {}
    x0 = np.asarray(around["x0"], float)
    x0 = x0[0] if x0.ndim == 2 else x0
    bound = posterior_cramer_rao(
        plant, ts=around["ts"], x0_mean=x0, x0_covariance=np.zeros((plant.n, plant.n)), noise_covariance=var,
        process_covariance=disturbance_covariance(plant, around["disturbance"], x=x0, **options),
        keys=Seeds(jax.random.key(KEY), TRAJECTORIES), signal=around["signal"],
        integrator=around["integrator"] if flow else None,
    )  # fmt: skip
    return bound.over(after)[0]


def _require_linear(plant: Any, a: np.ndarray, u: Any) -> None:
    x = jnp.cos(jnp.arange(plant.n, dtype=float)) + 1
    if not np.allclose(np.asarray(jax.jacfwd(lambda x: plant.flow(jnp.zeros(()), x, u))(x)), a, rtol=1e-9, atol=1e-12):
        fix = 'Take floor = "posterior".'
        raise refuse("config", "check.floor", f"'kalman' for {type(plant).__name__}", "a linear plant", fix)
