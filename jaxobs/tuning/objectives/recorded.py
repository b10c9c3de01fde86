"""What a record says about an observer: with a reference sensor, or by its innovations alone."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._loop import time_grid
from jaxobs._module import Module, Scalar, concrete, dtype_of, param, refuse, require_instance, require_shape, static
from jaxobs._observe import Estimate, observe
from jaxobs.integrators import AbstractIntegrator
from jaxobs.tuning.objectives._points import root

Blocks = tuple[tuple[int, int], ...]


def _columns(values: Any) -> Array:
    """(T, columns), NaN allowed."""
    given = jnp.asarray(values)
    given = given if jnp.issubdtype(given.dtype, jnp.floating) else given.astype(jnp.result_type(float))
    return given[:, None] if given.ndim == 1 else given


def _pairs(blocks: Any) -> Blocks | None:
    return None if blocks is None else tuple((int(start), int(stop)) for start, stop in blocks)


class Innovation(Module):
    """log det(mean of nu nu') / 2, nu_k = y_k - predicted: the Gaussian log-likelihood of the innovations per sample, up to
    sign and a constant, their covariance concentrated out (the log of their RMS for one output). No truth is needed.

    ts (T,), ys (T, p), us (T, m) or none, xhat0 (n,), integrator: as for `observe`; NaN in ys marks a lost sample. blocks:
    pairs (start, stop) of samples that count, all if none are given; the observer runs from the first sample to the last stop.
    What is judged is the prediction one period ahead, not the estimate.
    Source: Ljung, System Identification, sections 7.4 and 15.2; Schweppe, IEEE Trans. Information Theory 11 (1965).
    """

    ts: Float[Array, " T"] = param()
    ys: Float[Array, "T p"] = eqx.field(converter=_columns)  # pyright: ignore[reportGeneralTypeIssues]: no default
    xhat0: Float[Array, " n"] = param()
    us: Float[Array, "T m"] | None = param(default=None)
    integrator: AbstractIntegrator | None = None
    blocks: Blocks | None = eqx.field(converter=_pairs, static=True, default=None)

    def __check_init__(self):
        _check_record(self)

    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        """The objective at this observer. No randomness: the key is not used."""
        found, counts = _estimates(self, observer)
        # A lost sample's innovation is zero and counts in no sum.
        pairs = counts[:, None, None] & found.valid[:, :, None] & found.valid[:, None, :]
        products = jnp.where(pairs, found.innovation[:, :, None] * found.innovation[:, None, :], 0)
        mean = jnp.sum(products, axis=0) / jnp.sum(pairs, axis=0).astype(products.dtype)
        return jnp.linalg.slogdet(mean)[1] / 2


class Recorded(Module):
    """sqrt(mean of |xhat_i - reference|^2), i in `states`, over the samples of the blocks, against a second sensor.

    reference (T,) or (T, s) for s states, NaN where it is missing; the rest as for Innovation.
    """

    ts: Float[Array, " T"] = param()
    ys: Float[Array, "T p"] = eqx.field(converter=_columns)  # pyright: ignore[reportGeneralTypeIssues]: no default
    xhat0: Float[Array, " n"] = param()
    reference: Float[Array, "T s"] = eqx.field(converter=_columns)  # pyright: ignore[reportGeneralTypeIssues]
    us: Float[Array, "T m"] | None = param(default=None)
    integrator: AbstractIntegrator | None = None
    states: tuple[int, ...] = static(default=(0,))
    blocks: Blocks | None = eqx.field(converter=_pairs, static=True, default=None)

    def __check_init__(self):
        _check_record(self)
        fix = "One column for each of `states`, one row for each time."
        require_shape(self, "reference", self.reference, (self.ts.shape[0], len(self.states)), fix)

    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        """The RMSE at this observer. No randomness: the key is not used."""
        if max(self.states) >= observer.n or min(self.states) < 0:
            fix = "They are counted from 0."
            raise refuse(self, "states", str(self.states), f"numbers from 0 to {observer.n - 1}", fix)
        found, counts = _estimates(self, observer)
        truth = self.reference[: found.ts.shape[0]].astype(found.xhat.dtype)
        known = counts[:, None] & jnp.isfinite(truth)
        error = jnp.where(known, found.xhat[:, jnp.asarray(self.states)] - jnp.where(known, truth, 0), 0)
        return root(jnp.sum(error**2) * len(self.states) / jnp.sum(known).astype(error.dtype))


def _check_record(record: Any) -> None:
    time_grid(type(record).__name__, record.ts, record.ts.dtype)
    count = record.ts.shape[0]
    require_shape(record, "ys", record.ys, (count, record.ys.shape[-1]), "One row for each time.")
    if record.integrator is not None:
        require_instance(record, "integrator", record.integrator, AbstractIntegrator, "e.g. jaxobs.integrators.RK4().")
    for start, stop in record.blocks or ():
        if not 0 <= start < stop <= count:
            fix = "Give pairs (start, stop) of sample numbers: blocks=[(200, 1756)]."
            raise refuse(record, "blocks", f"({start}, {stop})", f"0 <= start < stop <= {count}", fix)
    known = concrete(record.ys)
    if known is not None and not any(np.isfinite(known[a:b]).any() for a, b in record.blocks or ((0, count),)):
        raise refuse(record, "ys", "no finite sample in the blocks", "a record", "Every sample is lost.")


def _estimates(record: Any, observer: Any) -> tuple[Estimate, Array]:
    """The estimates up to the last stop, and which samples count."""
    blocks = record.blocks or ((0, record.ts.shape[0]),)
    last = max(stop for _, stop in blocks)
    counts = np.zeros(last, bool)
    for start, stop in blocks:
        counts[start:stop] = True
    us = None if record.us is None else record.us[:last]
    kept = (record.ts[:last], record.ys[:last].astype(dtype_of(observer)), us)
    return observe(observer, *kept, xhat0=record.xhat0, integrator=record.integrator), jnp.asarray(counts)
