"""What the Kalman observers share: the array forms of both updates, and their checks. P = U'U, U upper triangular."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxobs._module import Module, concrete, refuse, require_finite, require_instance, require_shape
from jaxobs.linalg import triangularise
from jaxobs.plants import AbstractPlant


def root(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """U with U'U = matrix."""
    return jnp.linalg.cholesky(matrix).T


def measurement_update(
    xhat: Float[Array, " n"],
    u: Float[Array, "n n"],
    c: Float[Array, "p n"],
    noise: Float[Array, "p p"],
    innovation: Float[Array, " p"],
) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """xhat + P C'(C P C' + R)^-1 innovation and the root of P - P C'(C P C' + R)^-1 C P, with R = noise'noise:

    triangularise [[noise, 0], [U C', U]] = [[X, Y], [0, U+]],     xhat+ = xhat + Y'X'^-1 innovation.
    """
    p = c.shape[0]
    rows = jnp.block([[noise, jnp.zeros_like(c)], [u @ c.T, u]])
    r = triangularise(rows)
    scaled = jax.scipy.linalg.solve_triangular(r[:p, :p].T, innovation, lower=True)
    return xhat + r[:p, p:].T @ scaled, r[p:, p:]


def time_update(u: Float[Array, "n n"], f: Float[Array, "n n"], *driven: Float[Array, "n w"]) -> Float[Array, "n n"]:
    """The root of F P F' + sum_i G_i G_i'."""
    return triangularise(jnp.concatenate([u @ f.T, *(g.T for g in driven)]))


def process_root(model: AbstractPlant, q: Float[Array, "w w"]) -> Float[Array, "n w"]:
    """G with G G' = E q E', E the disturbance matrix of the model."""
    return model.disturbance_matrix().astype(q.dtype) @ jnp.linalg.cholesky(q)


def check_kalman(observer: Module, model: AbstractPlant, kind: type, fix: str) -> None:
    """The model is of its kind; q (w, w), r (p, p) and start (n, n) are symmetric and positive definite, where concrete."""
    require_instance(observer, "model", model, kind, fix)
    w = model.disturbance_matrix().shape[1]
    covariances = (
        ("q", w, f"It is the process noise on the {w} column(s) of model.disturbance_matrix(): q=0.1 * jnp.eye({w})."),
        ("r", model.p, f"It is the measurement noise on {model.p} output(s): r=0.01 * jnp.eye({model.p})."),
        ("start", model.n, f"It is the covariance of the first guess: start=jnp.eye({model.n})."),
    )
    for name, size, what in covariances:
        value = getattr(observer, name)
        require_shape(observer, name, value, (size, size), what)
        require_finite(observer, name, value)
        known = concrete(value)
        if known is None:
            continue
        known = known.astype(np.float64)
        if not np.allclose(known, known.T, rtol=1e-6, atol=0):
            raise refuse(observer, name, known.tolist(), "a symmetric matrix", what)
        d = np.sqrt(np.abs(np.diag(known)))
        lowest = np.linalg.eigvalsh(known / np.outer(d, d))[0] if np.all(np.diag(known) > 0) else -np.inf
        if not lowest > 0:
            given = f"{known.tolist()} with the smallest eigenvalue {np.linalg.eigvalsh(known)[0]:.4g}"
            raise refuse(observer, name, given, "a positive definite matrix", what)
