"""The noise that an observer lets through in steady state, in closed form."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxobs._module import Module, OptionalScalar, Scalar, param, require_positive, static
from jaxobs.plants import AbstractFlowPlant, AbstractStepPlant
from jaxobs.tuning.linear_error import covariance
from jaxobs.tuning.objectives._points import check_points, linear_errors, root, weight_matrix


class SteadyNoise(Module):
    """sqrt(mean over operating points of tr(E cov E')), cov the steady covariance of xhat - x (`covariance`), E = weight.

    plant: the true one, points (S, n) states of it, inputs (S, m). noise: standard deviation of the measurement noise, or V;
    process: that of the disturbance through plant.disturbance_matrix(), or W (none if not given); see `linearise`. Without dt
    both are intensities of white noise. dt [s]: samples of measurement noise, held for dt as in `simulate`; with process_held
    the disturbance, too. Leave dt out for a step observer. weight (n,) or (s, n), all states if not given. with_bias adds the
    square of the steady error that the observer's own model makes at the point, |E bias|^2: without it, or process noise, less
    gain is always better.

    Exact for a linear error, first order in the noise otherwise. Infinite where the linear error is not stable. With dt, poles
    beyond 2 / dt look quiet, since the held sample is followed at once; no fixed step follows them: cap them by `Weighted`.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    points: Float[Array, "S n"] = param()
    noise: Float[Array, "..."] = param(default=1.0)
    process: Float[Array, "..."] | None = param(default=None)
    weight: Float[Array, "..."] | None = param(default=None)
    dt: OptionalScalar = param(default=None)
    inputs: Float[Array, "S m ..."] | None = param(default=None)
    process_held: bool = static(default=False)
    with_bias: bool = static(default=False)

    def __check_init__(self):
        check_points(self)
        if self.dt is not None:
            require_positive(self, "dt", self.dt, "It is the period for which a sample is held, in seconds.")

    @eqx.filter_jit
    def __call__(self, observer: Any, key: Any = None) -> Scalar:
        """The weighted RMSE at this observer. No randomness: the key is not used."""
        errors = linear_errors(self, observer, self.process, self.noise)

        def at(error) -> Scalar:
            e = weight_matrix(self.weight, error.output.shape[0], error.f.dtype)
            found = covariance(error, self.dt, process_held=self.process_held)
            # An infinite covariance is infinite whatever the weights: 0 times infinity is no number.
            good = jnp.all(jnp.isfinite(found), where=jnp.any(e != 0, axis=0)[:, None] & jnp.any(e != 0, axis=0)[None, :])
            total = jnp.where(good, jnp.sum((e @ jnp.where(jnp.isfinite(found), found, 0)) * e), jnp.inf)
            return total + jnp.sum((e @ error.bias()) ** 2) if self.with_bias else total

        return root(jnp.mean(jax.vmap(at)(errors)))
