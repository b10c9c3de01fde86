"""The numerical procedure of paper 002, section III: a walk over sigma, keeping the smallest gain that is met."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import HighGainLmi
from jaxobs.designs.chain_lmi import corners, gain_constant, largest_lambda, require_index, slope_bounds
from jaxobs.designs.high_gain_lmi import EXCESS, design_at, require_chain
from jaxobs.designs.infeasible import Infeasible
from jaxobs.observers import Luenberger
from jaxobs.plants import AbstractChain


@dataclasses.dataclass(frozen=True)
class Visit:
    """One grid point: tau, sigma = tau / (1 - tau), theta and |L| there (infinite where no solution of (31) was found)."""

    tau: float
    sigma: float
    theta: float
    size: float


def gridding(
    plant: AbstractChain, *, bounds: Any, j0: int, step: float = 0.02, constant: float | None = None
) -> tuple[Luenberger, HighGainLmi, tuple[Visit, ...]]:
    """The algorithm of section III with its step (iv) mended: after every grid point it goes on to (iii), the next tau.

        tau = 1/2, 1/2 + step, ... < 1:   sigma = tau / (1 - tau);   if (31) has a solution:
            theta = max(sigma, (2 k_j0 lambda_max(P) / lam)^{1/(1+j0)}),   L = T(theta) K,   and the smallest |L| is kept.

    As printed, (iv) returns to (ii) with the same tau. What (ii) leaves open: P is the best one for (32), theta 1.1 times what
    it needs, and K that of `high_gain_lmi`. Returns the observer, its certificate, and all visits. Bisection at theta = sigma
    (`smallest_theta`) needs no grid. Arguments and errors as in `high_gain_lmi`; 0 < step < 1/2.
    """
    if not 0 < step < 0.5:
        raise refuse("gridding", "step", step, "a number in ]0, 1/2[", "tau runs from 1/2 to 1 in these steps.")
    require_chain("gridding", plant)
    pairs = slope_bounds("gridding", bounds, plant.n)
    require_index("gridding", j0, plant.n)
    best, visits = None, []
    for tau in np.arange(0.5, 1.0, step):
        sigma = float(tau / (1 - tau))
        theta, found = np.inf, None
        lam = largest_lambda(corners(pairs, j0, sigma)).attained if 1 - tau > step / 2 else 0.0
        if lam > 1e-9:
            k = gain_constant(pairs, j0) if constant is None else constant
            theta = max(1.0, sigma, EXCESS * (2 * k / lam) ** (1 / (1 + j0)))
            found = design_at(plant, pairs, j0, theta=theta, sigma=sigma, constant=constant)
        size = np.inf if found is None else float(np.linalg.norm(np.asarray(found[0].gain, float)))
        visits.append(Visit(float(tau), sigma, theta, size))
        if found is not None and (best is None or size < min(v.size for v in visits[:-1])):
            best = found
    if best is None:
        reason = f"no grid point of tau has a solution of (31)-(32) with j0 = {j0}, step {step:.6g}"
        raise Infeasible(reason, -np.inf, "Take a smaller step: sigma then gets larger before tau reaches 1.")
    return *best, tuple(visits)
