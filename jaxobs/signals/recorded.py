"""Inputs known by their samples: held between them, or joined by straight lines."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import concrete, param, refuse, require_finite
from jaxobs.signals.base import AbstractSignal


class Held(AbstractSignal):
    """u(t) = values[k] for ts[k] <= t < ts[k+1]; the first value before, the last one after."""

    ts: Float[Array, " T"] = param()
    values: Float[Array, "T m"] = param()

    def __check_init__(self):
        _check_samples(self)

    @property
    def m(self):
        return self.values.shape[1]

    def __call__(self, t):
        k = jnp.searchsorted(self.ts, t, side="right") - 1
        return self.values[jnp.clip(k, 0, self.ts.shape[0] - 1)]


class Recorded(AbstractSignal):
    """u(t) on the polygon through the samples (ts, values); constant outside."""

    ts: Float[Array, " T"] = param()
    values: Float[Array, "T m"] = param()

    def __check_init__(self):
        _check_samples(self)

    @property
    def m(self):
        return self.values.shape[1]

    def __call__(self, t):
        return jnp.stack([jnp.interp(t, self.ts, self.values[:, i]) for i in range(self.m)])


def _check_samples(signal: Held | Recorded) -> None:
    if signal.values.ndim != 2 or signal.ts.shape != signal.values.shape[:1]:
        given = f"ts {signal.ts.shape} and values {signal.values.shape}"
        raise refuse(
            signal,
            "values",
            given,
            "(T,) and (T, m)",
            "Give one row of inputs for each time, values[:, None] if m = 1.",
        )
    require_finite(signal, "values", signal.values)
    known = concrete(signal.ts)
    if known is not None and not np.all(np.diff(known) > 0):
        row = int(np.argmin(np.diff(known) > 0)) + 1
        raise refuse(signal, "ts", f"ts[{row}] <= ts[{row - 1}]", "increasing times", "Sort the record, drop doubled rows.")
