"""A recorded signal in, its derivatives out."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxobs._loop import time_grid
from jaxobs._module import Module, Numbers, Scalar, concrete, refuse, require_integer
from jaxobs._observe import Estimate, observe
from jaxobs._series import Series, record
from jaxobs.observers import DiscreteTracker

CANDIDATES = 64


class Derivatives(Module):
    """The signal and its derivatives: xhat (T, order + 1) in units of y per s^i; the rate mu [1/s] that made them.

    innovation, valid (T,): y - predicted, zero where y was lost. diverged_at [s]: infinity unless xhat stops being finite.
    """

    ts: Float[Array, " T"]
    xhat: Float[Array, "T orders"]
    innovation: Float[Array, " T"]
    valid: Bool[Array, " T"]
    diverged_at: Scalar
    mu: Scalar


def differentiate(
    ts: Numbers | Series,
    y: Numbers | Series | None = None,
    *,
    order: int = 1,
    q: int = 0,
    mu: Numbers | None = None,
    extra: int = 1,
) -> Derivatives:
    """Estimates of y, y', ..., y^(order), the columns of `.xhat`, by the discrete tracker without delay: causal for a given mu.

    ts (T,) evenly spaced [s]; y (T,), NaN where a sample was lost; or in the place of both a record that carries its times, a
    pandas Series or an xarray DataArray. mu [1/s] is the rate of all poles: large follows fast, small
    smooths. Without mu it is chosen so that the tracker predicts the next sample best, among 64 rates from 4/duration to
    3/period: no truth is needed, it is right when the noise is white, and the whole record takes part, so the estimates are
    then not causal through mu (`.mu` tells it). q integrators help against tones far above mu, and cost tracking. The tracker
    has order + 1 + extra states (10 with q at most); extra = 1 follows a constant y^(order + 1) without bias.
    """
    require_integer("differentiate", "order", order, 1, "It is the highest derivative wanted.")
    require_integer("differentiate", "extra", extra, 0, "It counts states beyond the highest derivative.")
    ts, y = record("differentiate", "y", ts, y)
    grid = time_grid("differentiate", ts, jnp.result_type(float))
    y = jnp.asarray(y, grid.ts.dtype)
    if y.shape != grid.ts.shape:
        raise refuse("differentiate", "y", f"shape {y.shape}", f"{grid.ts.shape}", "Give one sample for each time.")
    n = order + 1 + extra
    if n + q > 10:
        fix = "Lower the order: higher derivatives drown in rounding."
        raise refuse("differentiate", "order", f"order + 1 + extra + q = {n + q} states", "10 at most", fix)
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
        rates = jnp.geomspace(4 / (grid.spacing * (len(y) - 1)), 3 / grid.spacing, CANDIDATES)
        errors = jax.lax.map(lambda rate: jnp.mean(track(rate).innovation[2 * (n + q) :] ** 2), rates, batch_size=CANDIDATES)
        mu = rates[jnp.nanargmin(errors)]
    mu = jnp.asarray(mu, y.dtype)
    found = track(mu)
    return Derivatives(grid.ts, found.xhat[:, : order + 1], found.innovation[:, 0], found.valid[:, 0], found.diverged_at, mu)
