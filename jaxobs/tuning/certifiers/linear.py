"""Decay of an error that is linear: trackers, chains in discrete time, observers of linear models, whatever their formula."""

import dataclasses
import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxobs import linalg
from jaxobs._module import refuse, require_instance
from jaxobs.certificates import Corners, StepCorners
from jaxobs.designs import Infeasible
from jaxobs.designs._dynamics import balancing, centred
from jaxobs.designs._proofs import unit_size
from jaxobs.designs.polytope import as_tuples
from jaxobs.observers import AbstractStepObserver
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant
from jaxobs.tuning.certifiers.base import AbstractCertifier, Start, minus_log_det
from jaxobs.tuning.linear_error import linearise

SHORT = 1e-3  # by which a Lyapunov matrix is made for a little less than the slowest pole allows
ORIGIN = "the error dynamics of the observer itself, linear and constant once its gain is open; no plant is involved"


@dataclasses.dataclass(frozen=True, eq=False)
class Linear(AbstractCertifier):
    """Decay of eps' = F eps (eps+ = F eps) at `rate`, F = d flow/dz of the observer itself, as `linearise` has it.

    plant: a linear one with the observer's n and p: the chain of integrators that a tracker follows, or the observer's model.
    step: for step observers; the rate is then the factor a step. The certificate is about the F that the numbers of the
    observer make, in floats. ValueError for an F that changes with x. Source: Lyapunov's equation, Boyd et al., 1994, section
    5.1.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    step: bool = False

    def __post_init__(self):
        kinds = AbstractFlowPlant | AbstractStepPlant
        require_instance(self, "plant", self.plant, kinds, "E.g. jaxobs.plants.IntegratorChain(3).")

    @property
    def unit(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        return "a step" if self.step else "1/s"

    def start(self, observer, rate):
        if isinstance(observer, AbstractStepObserver) != self.step:
            given = f"{type(observer).__name__} with step={self.step}"
            raise refuse(self, "step", given, "True for step observers, False for flow observers", "Say step=True.")
        f = np.asarray(self._f(observer), float)
        elsewhere = np.asarray(linearise(observer, self.plant, np.cos(np.arange(self.plant.n)) + 1.0).f, float)
        if not np.allclose(f, elsewhere, rtol=1e-9, atol=1e-9 * np.max(np.abs(f))):
            fix = "Bound its slopes, and take Quadratic."
            raise refuse(self, "observer", type(observer).__name__, "an observer whose error is linear", fix)
        poles = np.linalg.eigvals(f)
        reached = float(np.max(np.abs(poles))) if self.step else -float(np.max(poles.real))
        near = reached * (1 + SHORT) if self.step else reached - SHORT * float(np.linalg.norm(f, 2))
        slower = rate > near if self.step else rate < near  # away from the poles: where they meet, P is singular to rounding
        p = _lyapunov(f, (near + rate) / 2 if slower else near, self.step)
        t = centred(p)
        speed = 1.0 if self.step else max(float(np.linalg.norm(np.linalg.solve(t, f @ t), 2)), 1e-300)
        fixed = {"t": t, "inverse": np.linalg.inv(t), "speed": np.asarray(speed)}  # coordinates in which F is of size one
        return Start(jax.tree.map(jnp.asarray, fixed), (), reached)

    def barrier(self, observer, fixed, free, rate):
        """log det P / N of (F + rate)'P + P (F + rate) + I = 0, or F'P F / factor^2 - P + I = 0: P > 0 if and only if every
        pole lies inside; like -log of the distance where one comes close."""
        f = (fixed["inverse"] @ self._f(observer) @ fixed["t"]) / (rate if self.step else fixed["speed"])
        one = jnp.eye(len(f), dtype=f.dtype)
        p = linalg.stein(f.T, one) if self.step else linalg.lyapunov(f.T + rate / fixed["speed"] * one, one)
        return -minus_log_det(p[None]) / len(f)

    def prove(self, observer, fixed, free, rate):
        f = np.asarray(self._f(observer), float)
        n = len(f)
        none = as_tuples(np.zeros((n, 0)))
        fields: dict[str, Any] = {"a": as_tuples(f), "b": none, "c": (), "lower": (), "upper": (), "origin": ORIGIN}
        fields |= {"output": as_tuples(np.zeros((1, n))), "gain": as_tuples(np.zeros((n, 1)))}
        poles = np.linalg.eigvals(f)
        reached = float(np.max(np.abs(poles))) if self.step else -float(np.max(poles.real))
        for share in (0.5, 0.8, 0.95, 0.2):  # between the rate and the slowest pole
            between = rate + share * (reached - rate)
            p = as_tuples(unit_size(_lyapunov(f, between, self.step))[0])
            own = StepCorners(**fields, p=p, factor=rate) if self.step else Corners(**fields, p=p, rate=rate)
            if own.verify():
                return own
        reason = f"the slowest pole allows {reached:.6g} {self.unit}, and no P was found that proves {rate:.6g}"
        raise Infeasible(reason, -0.0, "Ask for a little less.", best=reached)

    def _f(self, observer: Any) -> Any:
        return linearise(observer, self.plant, jnp.zeros(self.plant.n)).f


def _lyapunov(f: np.ndarray, rate: float, step: bool) -> np.ndarray:
    """P of the error at a rate short of its slowest pole, in balanced coordinates."""
    t = np.diagonal(balancing(f))
    inside, n = f / t[:, None] * t, len(f)
    with warnings.catch_warnings():  # poles close to the rate: the exact check decides
        warnings.simplefilter("ignore", RuntimeWarning)
        if step:
            p = scipy.linalg.solve_discrete_lyapunov((inside / rate).T, np.eye(n))
        else:
            p = scipy.linalg.solve_continuous_lyapunov((inside + rate * np.eye(n)).T, -np.eye(n))
    return (p + p.T) / 2 / np.outer(t, t)
