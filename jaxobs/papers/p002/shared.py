"""Results that several claims need, computed once."""

import dataclasses
import functools

import jax.numpy as jnp
import numpy as np

from jaxobs.certificates import HighGainLmi, NoHighGainLmi
from jaxobs.designs import chain_lmi, chain_proofs
from jaxobs.designs.chain_lmi import SmallestTheta
from jaxobs.designs.high_gain_lmi import high_gain_lmi
from jaxobs.papers.claims import half_digit
from jaxobs.papers.p002.paper import TABLE, N, Printed
from jaxobs.plants import SineChain


def bounds(k_f: float | int, n: int = N) -> np.ndarray:
    """Of the slopes of f = k_f/n sum sin(x_i): each in [-k_f/n, k_f/n]."""
    return np.array([[-k_f / n, k_f / n]] * n)


def plant(k_f: float | int = 1.0) -> SineChain:
    """The example of section IV."""
    return SineChain(jnp.asarray(float(k_f)), N)


def printed_constant(row: Printed) -> float:
    """k_j0 = k_f (5 - j0) / 5."""
    return row.k_f * (N - row.j0) / N


def row(j0: int, k_f: int) -> Printed:
    return next(one for one in TABLE if (one.j0, one.k_f) == (j0, k_f))


def gain(one: Printed) -> np.ndarray:
    """L = T(theta) K with the printed theta and K."""
    return np.array(one.gain) * float(one.theta) ** np.arange(1, N + 1)


@functools.cache
def needed(one: Printed, sharp: bool = False) -> SmallestTheta:
    """The smallest theta = sigma for the printed K, all corners, with the paper's constant or the sharp one."""
    return chain_lmi.smallest_theta(bounds(one.k_f), one.j0, gain=one.gain, constant=None if sharp else printed_constant(one))


@functools.cache
def smallest(one: Printed, sharp: bool = False) -> SmallestTheta:
    """The infimum of theta = sigma over all K."""
    return chain_lmi.smallest_theta(bounds(one.k_f), one.j0, constant=None if sharp else printed_constant(one))


@functools.cache
def refuted(one: Printed, own_gain: bool, sharp: bool = False) -> NoHighGainLmi | None:
    """The exact proof that (31)-(32) fail at the largest theta that rounds to the printed one, for the printed K or for any."""
    theta = sum(half_digit(one.theta))
    constant = None if sharp else printed_constant(one)
    return chain_proofs.refute(bounds(one.k_f), one.j0, theta, gain=one.gain if own_gain else None, constant=constant)


@functools.cache
def full_box(one: Printed) -> HighGainLmi | NoHighGainLmi | None:
    """A proof for the printed L at all 2^5 corners with any P, or a proof that there is none."""
    theta = float(one.theta)
    proof = chain_proofs.certify(bounds(one.k_f), N, theta, gain(one))
    return proof or chain_proofs.refute(bounds(one.k_f), N, theta, gain=one.gain)


def nominal(one: Printed) -> float:
    """max Re of A - K C, in units of theta."""
    return float(np.linalg.eigvals(chain_lmi.error_matrices(np.zeros((1, N)), np.array(one.gain))[0]).real.max())


def frozen(one: Printed) -> float:
    """The largest real part with the printed L at psi = 0 and the 32 frozen corners [1/s]."""
    rows = np.concatenate([np.zeros((1, N)), chain_lmi.corners(bounds(one.k_f), N, float(one.theta))])
    return float(one.theta) * float(np.linalg.eigvals(chain_lmi.error_matrices(rows, np.array(one.gain))).real.max())


def one_corner(one: Printed) -> float:
    """theta that (31)-(32) ask of the printed K at the printed sigma, when (31) is imposed at psi = (+, ..., +) alone."""
    sigma = float(one.sigma or one.theta)
    reach = chain_lmi.largest_lambda(chain_lmi.corners(bounds(one.k_f), one.j0, sigma)[-1:], np.array(one.gain))
    least = (2 * printed_constant(one) / reach.attained) ** (1 / (1 + one.j0))
    return max(float(one.sigma or 1), least)


@functools.cache
def design(j0: int) -> HighGainLmi:
    """The certificate of `high_gain_lmi` for the example with k_f = 1."""
    return high_gain_lmi(plant(), bounds=bounds(1), j0=j0)[1]


@functools.cache
def at_one(k_f: int) -> HighGainLmi:
    """The LPV/LMI design (j0 = n) at a power of two, carried over to theta = sigma = 1 without rounding."""
    theta = 2.0 ** np.ceil(np.log2(1 + k_f / N))
    _, proof = high_gain_lmi(plant(k_f), bounds=bounds(k_f), j0=N, theta=float(theta))
    t = theta ** np.arange(1, N + 1)
    p = np.array(proof.p) / np.outer(t, t)
    lam = proof.lam * theta / t[-1] ** 2  # of theta T^-1 lam T^-1 >= theta lam theta^-2n I
    moved = tuple(tuple(map(float, row)) for row in p)
    return dataclasses.replace(proof, theta=1.0, sigma=1.0, p=moved, lam=float(lam))
