"""How large every gain must be that does its work: a convex problem over the frozen parameters, and its dual as the proof."""

import numpy as np
import scipy.optimize

from jaxobs._module import refuse
from jaxobs.certificates import GainFloor
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.polytope import Polytope, as_tuples

VERTICES = 1024  # looked at, at most


def gain_floor(model: Polytope, *, rate: float = 0.0) -> tuple[float, GainFloor]:
    """min |L|:   all coefficients of det(s I - A(rho) - rate I + L C) are >= 0 at the corners of the box,

    which are affine in L for the one output C. (floor, certificate): |L| > floor for every gain with which the error decays
    faster than e^{-rate t} at all constant parameters, so for every gain that has a certificate of that decay. Infeasible where
    no positive floor is found.

    rate [1/s]. ValueError for more than one output. Source: see GainFloor; the dual of a least distance problem, Lawson and
    Hanson, Solving Least Squares Problems, 1974, chapter 23.
    """
    if model.p != 1:
        raise refuse("gain_floor", "model", f"{model.p} outputs", "one", "With more the coefficients are not affine in L.")
    points = model.parameters()
    if len(points) > VERTICES:
        points = points[np.sort(np.random.default_rng(0).choice(len(points), VERTICES, replace=False))]
    rows = np.array([_coefficients(model.at(rho) + rate * np.eye(model.n), model.output[0]) for rho in points])
    slopes, offsets = rows[:, :, 1:].reshape(-1, model.n), rows[:, :, 0].ravel()  # slopes L + offsets > 0
    sizes = np.maximum(np.linalg.norm(slopes, axis=1), np.finfo(float).tiny)
    unit = max(1.0, float(np.max(-offsets / sizes)))  # a gain of about this size
    table = np.vstack([slopes.T / sizes, -offsets / sizes / unit])
    weights, _ = scipy.optimize.nnls(table, np.append(np.zeros(model.n), 1.0), maxiter=30 * table.shape[1])
    weights = (weights / sizes).reshape(len(points), model.n)
    used = np.flatnonzero(np.any(weights > 0, axis=1))
    kept, weights = points[used], weights[used] / np.max(weights, initial=np.finfo(float).tiny)
    floor = np.sum(weights * -rows[used, :, 0]) / np.linalg.norm(np.einsum("ck,ckj->j", weights, rows[used, :, 1:]))
    for share in (1 - 1e-14, 1 - 1e-10, 1 - 1e-6):
        fields = model.fields() | {"points": as_tuples(kept), "weights": as_tuples(weights.ravel()), "rate": float(rate)}
        certificate = GainFloor(**fields, level=float(floor * share))
        if certificate.verify():
            return certificate.level, certificate
    raise Infeasible(
        "no positive floor was found", float(floor), "The coefficients are positive without a gain, or none does it."
    )


def _coefficients(a: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(alpha_k, C B_k) of det(s I - a + L C) = s^n + sum_k (alpha_k + C B_k L) s^{n-k}, (n, 1 + n)."""
    b, rows = np.eye(len(a)), []
    for k in range(1, len(a) + 1):
        alpha = -np.trace(a @ b) / k
        rows.append([alpha, *(c @ b)])
        b = a @ b + alpha * np.eye(len(a))
    return np.array(rows)
