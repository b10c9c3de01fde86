"""Exact certificates for a gain of a chain, and exact proofs that there is none: `chain_lmi` rounded to stored numbers."""

from typing import Any

import numpy as np

from jaxobs.certificates import HighGainLmi, NoHighGainLmi
from jaxobs.designs import sdp
from jaxobs.designs.chain_lmi import corners, dominating, error_matrices, gain_constant, largest_lambda, scaled_gain
from jaxobs.designs.polytope import as_tuples


def certify(
    bounds: Any, j0: int, theta: float, gain: Any, *, sigma: float | None = None, constant: float | None = None
) -> HighGainLmi | None:
    """The exact certificate of (31)-(32) for the gain L (n,) that is carried out, at theta >= sigma; None if none is found."""
    pairs = np.asarray(bounds, float)
    sigma = theta if sigma is None else sigma
    powers = float(theta) ** np.arange(1, len(pairs) + 1)
    reach = largest_lambda(corners(pairs, j0, sigma), np.asarray(gain, float) / powers)
    if not reach.attained > 0:
        return None
    own = gain_constant(pairs, j0, theta) if constant is None else float(constant)
    for slack in (1e-10, 1e-8, 1e-6, 1e-4):  # witnesses a little inside the float ones
        certificate = HighGainLmi(
            gain=as_tuples(np.ravel(gain)),
            theta=float(theta),
            sigma=float(sigma),
            j0=j0,
            lower=as_tuples(pairs[:, 0]),
            upper=as_tuples(pairs[:, 1]),
            constant=own,
            p=as_tuples(reach.p),
            lam=reach.attained * (1 - slack),
            nu=1.0 + slack,
        )
        if certificate.verify():
            return certificate
    return None


def refute(bounds: Any, j0: int, theta: float, *, gain: Any = None, constant: float | None = None) -> NoHighGainLmi | None:
    """The exact proof that (31)-(32) have no solution at theta or less, for a gain K (n,) or for any; None if none is found."""
    pairs = np.asarray(bounds, float)
    n = len(pairs)
    k = None if gain is None else scaled_gain("refute", gain, n)
    rows = corners(pairs, j0, theta)
    own = gain_constant(pairs, j0, theta) if constant is None else float(constant)
    multipliers = largest_lambda(rows, k).multipliers if own > 0 else _of_the_homogeneous(rows, k)
    first = 1 if k is None else 0
    mass = float(np.einsum("cii->", multipliers))
    f = error_matrices(rows, k)
    for slack in (1e-12, 1e-10, 1e-8, 1e-6, 1e-4):  # strictly inside the cones, for the exact check
        x = multipliers / (mass if mass > 0 else 1.0)
        x[:, first:, first:] += slack / len(rows) * np.eye(n - first)
        w = (
            dominating(f, x) + 10 * slack * (np.linalg.norm(f, axis=(1, 2)).max() + 1) * np.eye(n)
            if own > 0
            else np.zeros((n, n))
        )
        certificate = NoHighGainLmi(
            gain=() if k is None else as_tuples(k),
            theta=float(theta),
            j0=j0,
            lower=as_tuples(pairs[:, 0]),
            upper=as_tuples(pairs[:, 1]),
            constant=own,
            multipliers=as_tuples(np.concatenate((x + x.transpose(0, 2, 1)) / 2)),
            w=as_tuples((w + w.T) / 2),
        )
        if certificate.verify():
            return certificate
    return None


def _of_the_homogeneous(rows: np.ndarray, gain: np.ndarray | None) -> np.ndarray:
    """Multipliers for (31) alone, where no constant limits P: from the largest common margin of P > 0, (31) and P < I."""
    f = error_matrices(rows, gain)
    n = rows.shape[1]
    first = 1 if gain is None else 0
    found = sdp.feasible(
        {"p": sdp.symmetric(n, reach=1.0)},
        lambda p: [p, np.eye(n) - p, *(-(p @ one + one.T @ p)[first:, first:] for one in f)],
    )
    multipliers = np.zeros((len(rows), n, n))
    if found.duals:
        multipliers[:, first:, first:] = np.stack(found.duals[2:])
    return multipliers
