"""A recorded signal in, its derivatives out."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._loop import time_grid
from jaxobs._module import Numbers, concrete, refuse, require_integer
from jaxobs._observe import Estimate, observe
from jaxobs.observers import DiscreteTracker

CANDIDATES = 64


def differentiate(
    ts: Numbers, y: Numbers, *, order: int = 1, q: int = 0, mu: Numbers | None = None, extra: int = 1
) -> Estimate:
    """Causal estimates of y, y', ..., y^(order), the columns of `.xhat`, by the discrete tracker without delay.

    ts (T,) evenly spaced [s]; y (T,), NaN where a sample was lost. mu [1/s] is the rate of all poles: large follows fast, small
    smooths. Without mu it is chosen so that the tracker predicts the next sample best, among 64 rates from 4/duration to
    3/period: no truth is needed, and it is right when the noise is white. q integrators help against tones far above mu, and
    cost tracking. The tracker has order + 1 + extra states; extra = 1 follows a constant y^(order + 1) without bias.
    """
    require_integer("differentiate", "order", order, 1, "It is the highest derivative wanted.")
    require_integer("differentiate", "extra", extra, 0, "It counts states beyond the highest derivative.")
    grid = time_grid("differentiate", ts, jnp.result_type(float))
    y = jnp.asarray(y, grid.ts.dtype)
    if y.shape != grid.ts.shape:
        raise refuse("differentiate", "y", f"shape {y.shape}", f"{grid.ts.shape}", "Give one sample for each time.")
    n = order + 1 + extra
    if y.shape[0] <= 2 * (n + q):
        raise refuse(
            "differentiate", "y", f"{y.shape[0]} samples", f"more than {2 * (n + q)}", "Record longer, or lower the order."
        )
    known = concrete(y)
    if known is not None and not np.isfinite(known).any():
        raise refuse("differentiate", "y", "no finite sample", "a signal", "Every sample is lost.")
    first = jnp.where(jnp.isfinite(y), y, 0)[jnp.argmax(jnp.isfinite(y))]
    start = jnp.zeros((n,), y.dtype).at[0].set(first)

    def track(mu) -> Estimate:
        # From a weak prior the gain opens by itself: a steady gain would answer the unknown slope with a peak.
        return observe(DiscreteTracker(n, q, mu, grid.spacing, weak), ts, y, xhat0=start)

    weak = 1e-3 * grid.spacing
    if mu is None:
        rates = jnp.geomspace(4 / (grid.ts[-1] - grid.ts[0]), 3 / grid.spacing, CANDIDATES)
        errors = jax.lax.map(lambda rate: jnp.mean(track(rate).innovation[2 * (n + q) :] ** 2), rates, batch_size=CANDIDATES)
        mu = rates[jnp.nanargmin(errors)]
    found = track(mu)
    return dataclasses.replace(found, xhat=found.xhat[:, : order + 1])
