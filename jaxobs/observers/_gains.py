"""What the observers with gains alphas_i gamma^i share: their checks and the powers of gamma."""

import jax.numpy as jnp
import numpy as np
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Float

from jaxobs import hurwitz
from jaxobs._module import (
    Module,
    Scalar,
    concrete,
    refuse,
    require_finite,
    require_instance,
    require_positive,
    require_shape,
)
from jaxobs.plants import AbstractChain


def powers(gamma: Scalar, count: int) -> Float[Array, " count"]:
    """(gamma, gamma^2, ..., gamma^count)."""
    return gamma ** jnp.arange(1, count + 1, dtype=gamma.dtype)


def named(gain: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """The gain itself, named in the traced program: exported code keeps it as a table, which a certificate is read against."""
    return checkpoint_name(gain, "gain")


def scaled_poles(alphas: Float[Array, " N"], gamma: Scalar) -> np.ndarray | None:
    """gamma times the roots of s^N + alphas_1 s^{N-1} + ... + alphas_N, where the numbers are concrete."""
    known, scale = concrete(alphas), concrete(gamma)
    if known is None or scale is None or known.ndim != 1:
        return None
    return float(np.max(scale)) * np.roots(np.concatenate([[1.0], known.astype(float)]))


def require_chain(observer: Module, model: object) -> None:
    """x' = A x + B phi(x, u), y = x_1: ValueError unless `model` is an AbstractChain."""
    fix = "Give a plant in chain form, write yours as a subclass, or use Luenberger."
    require_instance(observer, "model", model, AbstractChain, fix)


def check_gains(observer: Module, alphas: Float[Array, " N"], gamma: Scalar, count: int, what: str) -> None:
    """Shapes always; the values where they are concrete: finite, gamma > 0, alphas Hurwitz (the bad roots are named)."""
    fix = f"It needs {what}, e.g. jaxobs.hurwitz.binomial({count})."
    require_shape(observer, "alphas", alphas, (count,), fix)
    require_shape(
        observer, "gamma", gamma, (), "A grid of gammas goes through jaxobs.grid(observer, gamma=...) and jaxobs.over."
    )
    require_finite(observer, "alphas", alphas)
    require_finite(observer, "gamma", gamma)
    require_positive(observer, "gamma", gamma, "The gain scale is a rate in 1/s; larger is faster and noisier.")
    known = concrete(alphas)
    if known is not None and not hurwitz.is_hurwitz(known):
        roots = np.roots(np.concatenate([[1.0], known.astype(float)]))
        bad = ", ".join(f"{root:.4g}" for root in roots[roots.real >= 0])
        raise refuse(
            observer,
            "alphas",
            f"{known.tolist()} with the root(s) {bad}",
            "all roots of s^N + alpha_1 s^(N-1) + ... + alpha_N in the open left half plane",
            f"Try jaxobs.hurwitz.binomial({count}), or jaxobs.hurwitz.alphas_from_log_q.",
        )
