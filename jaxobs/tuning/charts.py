"""Parametrisations: smooth maps from unconstrained numbers to the gains that are allowed, each with its inverse.

    value = chart.decode(theta),      theta = chart.encode(value)

A chart is a small pytree; `decode` is jittable and differentiable, `encode` takes concrete values and refuses those outside.
"""

import abc
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Array, Float

from jaxobs import hurwitz
from jaxobs._module import Module, Numbers, Scalar, as_param, param, refuse, require_nonnegative, require_shape, static


class AbstractChart(Module):
    """decode(theta) -> value, for any real theta; encode(value) -> theta, its inverse. ValueError for values outside."""

    @abc.abstractmethod
    def decode(self, theta: Array) -> Array: ...

    @abc.abstractmethod
    def encode(self, value: Numbers) -> Array: ...


class LogQ(AbstractChart):
    """alphas whose weights are q_i = exp(theta_i): all that satisfy (10), each once. theta (n,). See `jaxobs.hurwitz`."""

    def decode(self, theta):
        return hurwitz.alphas_from_log_q(theta)

    def encode(self, value):
        q = np.asarray(hurwitz.q_from_alphas(value))
        if not (np.all(q > 0) and hurwitz.is_hurwitz(value)):
            fix = "Start from jaxobs.hurwitz.binomial(n), or take the chart PoleSector, which needs no more than a Hurwitz one."
            raise refuse(self, "value", np.asarray(value).tolist(), "Hurwitz coefficients with (10), all q_i > 0", fix)
        return jnp.log(jnp.asarray(q))


class PoleSector(AbstractChart):
    """alphas of polynomials whose poles lie in the sector |Im s| <= tan(angle) |Re s + slowest|, Re s <= -slowest:

        alpha(s) = beta(s + slowest),   beta(s) = prod_k (s^2 + 2 z_k w_k s + w_k^2) [(s + w)],   z_k = damping + exp(theta_2k),

    damping = cos(angle), w_k = exp(theta_{2k-1}). theta (n,). damping in [0, 1[: 0 is the half plane, 0.7 a sector of 45
    degrees on either side. slowest >= 0, in the unit of the poles. z_k > 1 are two real poles, so that the chart has no seam.
    """

    damping: Scalar = param(default=0.0)
    slowest: Scalar = param(default=0.0)

    def __check_init__(self):
        require_nonnegative(self, "slowest", self.slowest, "It is the decay that every pole has, at least.")
        if not 0 <= float(self.damping) < 1:
            raise refuse(self, "damping", float(self.damping), "a number in [0, 1[", "It is the cosine of the sector's angle.")

    def decode(self, theta):
        coefficients = jnp.ones((1,), theta.dtype)
        for k in range(0, theta.shape[0] - 1, 2):
            w, z = jnp.exp(theta[k]), self.damping.astype(theta.dtype) + jnp.exp(theta[k + 1])
            coefficients = jnp.convolve(coefficients, jnp.stack([jnp.ones_like(w), 2 * z * w, w**2]))
        if theta.shape[0] % 2:
            coefficients = jnp.convolve(coefficients, jnp.stack([jnp.ones_like(theta[0]), jnp.exp(theta[-1])]))
        return hurwitz.moved(coefficients[1:], self.slowest.astype(theta.dtype))

    def encode(self, value):
        roots = np.roots(np.concatenate([[1.0], np.asarray(value, np.float64)])) + float(self.slowest)
        complex_, real = roots[roots.imag > 0], np.sort(roots[roots.imag == 0].real)
        pairs = [(abs(s), -s.real / abs(s)) for s in complex_]
        pairs += [(float(np.sqrt(a * b)), -(a + b) / (2 * np.sqrt(a * b))) for a, b in zip(real[0::2], real[1::2], strict=False)
                  if a < 0 and b < 0]  # fmt: skip
        odd = real[-1:] if len(real) % 2 else real[:0]
        if len(pairs) * 2 + len(odd) < len(roots) or np.any(odd >= 0) or any(z <= float(self.damping) for _, z in pairs):
            expected = f"poles with damping > {float(self.damping):.4g} about {-float(self.slowest):.4g}"
            raise refuse(self, "value", np.asarray(value).tolist(), expected, "Widen the sector, or start elsewhere.")
        flat = [part for w, z in pairs for part in (np.log(w), np.log(z - float(self.damping)))]
        return jnp.asarray([*flat, *np.log(-odd)])


class Positive(AbstractChart):
    """value = exp(theta), of any shape."""

    def decode(self, theta):
        return jnp.exp(theta)

    def encode(self, value):
        given = as_param(value)
        if not np.all(np.asarray(given) > 0):
            raise refuse(self, "value", np.asarray(given).tolist(), "positive numbers", "Take the chart Box, or Affine.")
        return jnp.log(given)


class Box(AbstractChart):
    """value = lower + (upper - lower) / (1 + exp(-theta)): strictly between the bounds, which broadcast."""

    lower: Array = param()
    upper: Array = param()

    def __check_init__(self):
        if not np.all(np.asarray(self.lower) < np.asarray(self.upper)):
            given = f"lower = {np.asarray(self.lower).tolist()}, upper = {np.asarray(self.upper).tolist()}"
            raise refuse(self, "lower", given, "lower < upper", "A number with equal bounds is no parameter.")

    def decode(self, theta):
        return self.lower + (self.upper - self.lower) * jax.nn.sigmoid(theta)

    def encode(self, value):
        share = (np.asarray(value) - np.asarray(self.lower)) / (np.asarray(self.upper) - np.asarray(self.lower))
        if not np.all((share > 0) & (share < 1)):
            raise refuse(self, "value", np.asarray(value).tolist(), "numbers strictly between the bounds", "Widen the box.")
        return jnp.asarray(np.log(share) - np.log1p(-share))


class Affine(AbstractChart):
    """value = centre + scale theta: any number, in units in which the parameters are alike. scale broadcasts, without zeros."""

    centre: Array = param()
    scale: Array = param()

    def __check_init__(self):
        if np.any(np.asarray(self.scale) == 0):
            raise refuse(self, "scale", np.asarray(self.scale).tolist(), "numbers other than 0", "Leave fixed numbers out.")

    def decode(self, theta):
        return self.centre + self.scale * theta

    def encode(self, value):
        return (as_param(value) - self.centre) / self.scale


class Lyapunov(AbstractChart):
    """P = R R' > 0 (n, n), R lower triangular with the diagonal exp(theta_i): theta (n (n + 1) / 2,), the diagonal first.

    Searched together with a gain under -sum log det of the inequalities it makes the joint (L, P) search of a certificate.
    """

    n: int = static()

    def root(self, theta: Float[Array, " k"]) -> Float[Array, "n n"]:
        """R."""
        rows, columns = np.tril_indices(self.n, -1)
        lower = jnp.zeros((self.n, self.n), theta.dtype).at[rows, columns].set(theta[self.n :])
        return lower + jnp.diag(jnp.exp(theta[: self.n]))

    def decode(self, theta):
        root = self.root(theta)
        return root @ root.T

    def encode(self, value):
        p = np.asarray(value, np.float64)
        require_shape(self, "value", p, (self.n, self.n), "One row and one column a state.")
        try:
            root = scipy.linalg.cholesky((p + p.T) / 2, lower=True)
        except np.linalg.LinAlgError:
            raise refuse(self, "value", p.tolist(), "a matrix > 0", "Solve a Lyapunov equation for a first one.") from None
        return jnp.asarray(np.concatenate([np.log(np.diagonal(root)), root[np.tril_indices(self.n, -1)]]))


def is_chart(x: Any) -> bool:
    return isinstance(x, AbstractChart)


def decode(charts: Any, theta: Any) -> Any:
    """A pytree of charts, and the thetas at its leaves -> the values there."""
    return jax.tree.map(lambda chart, part: chart.decode(part), charts, theta, is_leaf=is_chart)


def encode(charts: Any, values: Any) -> Any:
    """The inverse of `decode`."""
    return jax.tree.map(lambda chart, part: chart.encode(part), charts, values, is_leaf=is_chart)
