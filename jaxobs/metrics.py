"""How well an observer did: numbers over a whole run, and the same numbers as running updates.

A running metric is three functions of a small state, so that a study needs memory for lanes x states and none for time:

    state = metric.init(n, p, dtype);    state = metric.update(state, moment);    value = metric.result(state)

`evaluate(metric, trajectory)` folds one over a stored trajectory.
"""

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxobs._module import (
    Module,
    Numbers,
    Scalar,
    param,
    refuse,
    require_instance,
    require_integer,
    require_positive,
    require_shape,
    static,
)


class Moment(NamedTuple):
    """One sample of a run: t [s], x and xhat (n,), the innovation and its validity (p,)."""

    t: Scalar
    x: Float[Array, " n"]
    xhat: Float[Array, " n"]
    innovation: Float[Array, " p"]
    valid: Bool[Array, " p"]


class AbstractMetric(Module):
    """init, update, result: see the module.

    `dims` names the axes of the result in a study's data set, `units` its units ("x" are those of the state, "y" of the
    output), each by key where the result is a dict; without them the axes are numbered.
    """

    dims: ClassVar[tuple[str, ...] | Mapping[str, tuple[str, ...]] | None] = None
    units: ClassVar[str | Mapping[str, str] | None] = None

    @abc.abstractmethod
    def init(self, n: int, p: int, dtype: Any) -> Any: ...

    @abc.abstractmethod
    def update(self, state: Any, moment: Moment) -> Any: ...

    @abc.abstractmethod
    def result(self, state: Any) -> Any: ...


class RMSE(AbstractMetric):
    """sqrt(mean of (xhat_i - x_i)^2 over t >= after), shape (n,). NaN if the run never reaches `after`."""

    dims = ("state",)
    units = "x"
    after: Scalar = param(default=0.0)

    def init(self, n, p, dtype):
        return jnp.zeros((n,), dtype), jnp.zeros((), dtype)

    def update(self, state, moment):
        total, count = state
        counts = moment.t >= self.after
        return total + jnp.where(counts, moment.xhat - moment.x, 0) ** 2, count + counts.astype(count.dtype)

    def result(self, state):
        total, count = state
        return jnp.where(count > 0, _root(total / jnp.maximum(count, 1)), jnp.nan)


class Peak(AbstractMetric):
    """max over t of |xhat_i - x_i|, shape (n,)."""

    dims = ("state",)
    units = "x"

    def init(self, n, p, dtype):
        return jnp.zeros((n,), dtype)

    def update(self, state, moment):
        return jnp.maximum(state, jnp.abs(moment.xhat - moment.x))

    def result(self, state):
        return state


class SettlingTime(AbstractMetric):
    """The time [s] from the start after which |xhat_i - x_i| <= tolerance for good, shape (n,); infinity if never.

    It is the time of the last sample outside; 0 if there is none.
    """

    dims = ("state",)
    units = "s"
    tolerance: Scalar = param()

    def __check_init__(self):
        require_positive(self, "tolerance", self.tolerance, "It is a distance in the units of the states.")

    def init(self, n, p, dtype):
        return jnp.full((n,), jnp.nan, dtype), jnp.full((2,), jnp.nan, dtype)

    def update(self, state, moment):
        last, (start, _) = state
        inside = jnp.abs(moment.xhat - moment.x) <= self.tolerance  # NaN is outside
        return jnp.where(inside, last, moment.t), jnp.stack([jnp.where(jnp.isnan(start), moment.t, start), moment.t])

    def result(self, state):
        last, (start, end) = state
        return jnp.where(jnp.isnan(last), 0, jnp.where(last < end, last - start, jnp.inf))


class NoiseGain(AbstractMetric):
    """RMSE over t >= after, divided by the standard deviation of the measurement noise, shape (n,), units x_i / y."""

    dims = ("state",)
    units = "x / y"
    sigma: Scalar = param()
    after: Scalar = param(default=0.0)

    def __check_init__(self):
        require_positive(self, "sigma", self.sigma, "A noise gain needs noise: give its standard deviation.")

    def init(self, n, p, dtype):
        return RMSE(self.after).init(n, p, dtype)

    def update(self, state, moment):
        return RMSE(self.after).update(state, moment)

    def result(self, state):
        return RMSE(self.after).result(state) / self.sigma


class Whiteness(AbstractMetric):
    """Autocorrelations r_1..r_lags of the innovation, (p, lags), and the p-value of the Ljung-Box test, (p,).

    Q = T (T + 2) sum_l r_l^2 / (T - l) is chi-square with `lags` degrees of freedom if the innovation is white (its mean is
    taken as zero: a bias shows as correlation). Lost samples count as zeros; T <= lags gives NaN. Ljung and Box, Biometrika
    65 (1978).
    """

    dims = {"autocorrelation": ("output", "lag"), "p_value": ("output",)}  # noqa: RUF012
    units = "1"
    lags: int = static(default=20)

    def __check_init__(self):
        require_integer(self, "lags", self.lags, 1, "It is the number of autocorrelations tested.")

    def init(self, n, p, dtype):
        zeros = jnp.zeros((p, self.lags + 1), dtype)
        return zeros, zeros, jnp.zeros((), dtype)  # the last lags + 1 innovations (newest first), sums of products, count

    def update(self, state, moment):
        recent, products, count = state
        new = jnp.where(moment.valid, moment.innovation, 0)
        recent = jnp.concatenate([new[:, None], recent[:, :-1]], axis=1)
        return recent, products + recent * new[:, None], count + 1

    def result(self, state):
        _, products, count = state
        r = jnp.where(count > self.lags, products[:, 1:] / products[:, :1], jnp.nan)
        lag = jnp.arange(1, self.lags + 1, dtype=r.dtype)
        statistic = count * (count + 2) * jnp.sum(r**2 / (count - lag), axis=1)
        half = jnp.asarray(self.lags / 2, r.dtype)
        return {"autocorrelation": r, "p_value": jax.scipy.special.gammaincc(half, statistic / 2)}


class Consistency(AbstractMetric):
    """The mean of innovation^2 / variance over valid samples with t >= after, (p,): 1 when the predicted variance is right.

    Known as the normalised innovation squared; Bar-Shalom, Li and Kirubarajan, Estimation with Applications, section 5.4.
    """

    dims = ("output",)
    units = "1"
    variance: Scalar = param()
    after: Scalar = param(default=0.0)

    def __check_init__(self):
        require_positive(self, "variance", self.variance, "It is the innovation's variance as the design predicts it.")

    def init(self, n, p, dtype):
        return jnp.zeros((p,), dtype), jnp.zeros((p,), dtype)

    def update(self, state, moment):
        total, count = state
        counts = moment.valid & (moment.t >= self.after)
        return total + jnp.where(counts, moment.innovation**2 / self.variance, 0), count + counts.astype(count.dtype)

    def result(self, state):
        total, count = state
        return jnp.where(count > 0, total / jnp.maximum(count, 1), jnp.nan)


def evaluate(metric: AbstractMetric, run: Any, x: Numbers | None = None) -> Any:
    """A running metric over a stored run: a Trajectory, or an Estimate with the truth x (T, n) beside it."""
    require_instance("evaluate", "metric", metric, AbstractMetric, "Build it first, e.g. jaxobs.metrics.RMSE().")
    truth = getattr(run, "x", None) if x is None else x
    if truth is None:
        fix = "A record has no truth of its own: evaluate(metric, estimate, x)."
        raise refuse("evaluate", "x", "None", f"the true states, shape {run.xhat.shape}", fix)
    require_shape("evaluate", "x", truth, run.xhat.shape, "One row for each time of the run, one column for each state.")
    moments = Moment(run.ts, jnp.asarray(truth, run.xhat.dtype), run.xhat, run.innovation, run.valid)
    start = metric.init(run.xhat.shape[1], run.innovation.shape[1], run.xhat.dtype)
    return metric.result(jax.lax.scan(lambda state, moment: (metric.update(state, moment), None), start, moments)[0])


def rmse(x: Float[Array, "T *n"], xhat: Float[Array, "T *n"]) -> Float[Array, "*n"]:
    """sqrt(mean_t (xhat - x)^2): RMSE() in one expression, for slices that are at hand."""
    require_shape("rmse", "xhat", xhat, np.shape(x), "Compare like with like: cut both to the same times and states.")
    return _root(jnp.mean((xhat - x) ** 2, axis=0))


def _root(mean: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The square root, with the gradient 0 at 0."""
    positive = mean > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, mean, 1)), mean)
