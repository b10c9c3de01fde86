"""Observers that correct f as well, f(z + K (y - C z)): what that makes of the error dynamics e' = (A(rho) - G(rho) C) e."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.designs.polytope import Polytope, as_tuples


@dataclasses.dataclass(frozen=True)
class Injected:
    """model: of the plant; gain L (n, p); inner (r, p), what the k-th channel sees of the innovation, zeros if nothing."""

    model: Polytope
    gain: np.ndarray
    inner: np.ndarray

    @staticmethod
    def make(owner: str, field: str, model: Polytope, gain: Any, inner: Any) -> "Injected":
        """ValueError for a gain or an inner gain that does not fit."""
        gain = np.asarray(gain, float)
        model.closed(gain)
        own = np.zeros((model.r, model.p)) if inner is None else np.asarray(inner, float)
        if own.shape != (model.r, model.p) or not np.all(np.isfinite(own)):
            fix = "One row a channel, one column an output: right @ K for an inner gain K of f."
            raise refuse(owner, field, f"shape {own.shape}", f"finite numbers of shape {(model.r, model.p)}", fix)
        return Injected(model, gain, own)

    @property
    def seen(self) -> Polytope:
        """The model whose closed loop with L is F(rho) = a + b diag(rho) (c - inner output) - L output."""
        return dataclasses.replace(self.model, c=self.model.c - self.inner @ self.model.output)

    @property
    def closed(self) -> np.ndarray:
        """F at the corners, (corners, n, n)."""
        return self.seen.corners() - self.gain @ self.model.output

    @property
    def injections(self) -> np.ndarray:
        """G(rho) = L + b diag(rho) inner at the corners, (corners, n, p)."""
        return self.gain + (self.model.b * self.model.parameters()[:, None, :]) @ self.inner

    def fields(self) -> dict[str, Any]:
        """What certificates store."""
        inner = {"inner": as_tuples(self.inner)} if np.any(self.inner) else {}
        return self.model.fields() | {"gain": as_tuples(self.gain)} | inner
