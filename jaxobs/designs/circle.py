"""The circle-criterion observer: the nonlinearity is corrected by the measurement as well, with a gain of its own."""

from typing import Any, Literal

import jax.numpy as jnp
import numpy as np

from jaxobs._module import dtype_of
from jaxobs.certificates import AbstractCertificate
from jaxobs.designs.analysis import prove_level
from jaxobs.designs.lpv_model import Channels, lpv_model, slope_entries
from jaxobs.designs.objectives import Gain, Objective
from jaxobs.designs.synthesis import synthesize
from jaxobs.observers import InnerInjection
from jaxobs.plants import AbstractLipschitz


def circle(
    plant: AbstractLipschitz,
    *,
    bounds: Channels | tuple[Any, Any],
    objective: Objective | None = None,
    rate: float = 0.0,
    cover: Literal["multiplier", "lazy", "corners"] = "lazy",
) -> tuple[InnerInjection, AbstractCertificate]:
    """L and K of z' = A z + B f(z + K (y - C z)) + g(y, u) + L (y - C z), with the certificate for its error

        e' = (A - L C + sum_k rho_k B left_k right_k' (I - K C)) e,     lower_k <= rho_k <= upper_k.

    bounds: as for `lpv_lmi`, on the slopes of f where x and z + K (y - C z) are. objective, rate, cover: as for `synthesize`.
    Both gains are found together: first by the multiplier inequality, which is linear in P, P L, tau and tau K, then by
    descent. Infeasible, ValueError: as there. Source: Arcak and Kokotovic, Automatica 37 (2001), 1923-1930.
    """
    channels = bounds if isinstance(bounds, Channels) else slope_entries(*bounds)
    objective = Gain() if objective is None else objective
    model, dtype = lpv_model(plant, channels), dtype_of(plant)
    above = rate * (1 + 1e3 * float(jnp.finfo(dtype).eps))  # for what the gains lose in the precision of the plant
    found = synthesize(model, objective=objective, rate=above, cover=cover, inner=True, origin=channels.origin)
    assert found.inner is not None
    gain, k = (jnp.asarray(part, dtype) for part in (found.gain, np.linalg.pinv(model.c) @ found.inner))
    carried, inner = np.asarray(gain, float), model.c @ np.asarray(k, float)
    certificate = prove_level(model, carried, objective=objective, rate=rate, cover=cover, inner=inner, origin=channels.origin)
    return InnerInjection(plant, gain, k), certificate
