"""The ladder of certificates of one chain observer: the more is known about phi, the smaller the gain that can be proved."""

import dataclasses
import warnings
from collections.abc import Sequence

import numpy as np
import scipy.linalg

from jaxobs._module import Numbers, refuse, require_integer
from jaxobs.certificates import AbstractCertificate, Corners
from jaxobs.designs import corner_lmi, sdp
from jaxobs.designs._chain_gain import LargeGain, chain_error, require_alphas, require_positive
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.norm_bounded import (
    NormBounded,
    first_state_outside,
    require_lipschitz,
    require_plant,
    require_state_numbers,
)
from jaxobs.designs.polytope import Polytope, as_tuples
from jaxobs.designs.riccati import riccati, riccati_gamma
from jaxobs.designs.s_lemma import DEFAULT_EXCESS, s_lemma, s_lemma_gamma, s_lemma_riccati, s_lemma_riccati_gamma
from jaxobs.plants import AbstractChain

SPREAD = 1e-8  # of the bisection in log gamma


@dataclasses.dataclass(frozen=True)
class Rung:
    """One kind of certificate, what it takes as known, and what it gives for the gains alphas_i gamma^i.

    smallest_gamma [1/s]: the infimum of the certified gamma, 0 where every gamma > 0 is; None where what it needs is not
    known, or no gamma is certified. gamma: where `certificate` was made; None without one. upward: whether every larger gamma
    is certified as well: scaled by gamma^{j-n} the slopes shrink into the set that they scale, if it holds 0. Corners of a
    box without 0 say nothing of larger ones, and the observer may be unstable there.
    """

    name: str
    needs: str
    smallest_gamma: float | None
    gamma: float | None
    certificate: AbstractCertificate | None
    upward: bool = True


def ladder(
    plant: AbstractChain,
    *,
    alphas: Numbers,
    lipschitz: float,
    states: Sequence[int] | None = None,
    slopes: Numbers | None = None,
    gamma: float | None = None,
    q: int = 0,
) -> tuple[Rung, ...]:
    """One V = e'X e for e' = (A - L C + B psi(t)') e, L_i = alphas_i gamma^i, behind q integrators, by what is known of psi:

        condition (5), or (44)     |psi| <= rho                      X = P(gamma)^-1
        S-lemma, same P            |psi| <= rho                      X = P(gamma)^-1, with the best multiplier
        S-lemma, free P            |psi| <= rho                      X free
        structure                  the same, and psi_j = 0 for the x_j outside `states`
        box corners                lower_j <= psi_j <= upper_j       X free
        output injection           psi = 0: phi(y, u) is known       X free

    alphas (n + q,), Hurwitz. lipschitz: rho of phi. states: the numbers of the x_j that enter phi, if not all do. slopes
    (n, 2): for each state an interval (lower, upper) that holds dphi/dx_j. gamma [1/s]: where the certificates are made; for
    each rung 1.1 times its smallest one if not given (1 for output injection). A rung that fails there has no certificate: it
    never means "unstable".

    ValueError for a plant that is no chain, a phi that is seen to change with a state that is not named, slopes that a probe
    refutes, alphas of another number or not Hurwitz, lipschitz or gamma <= 0. Source: paper 000, (5), (44); Boyd et al., Linear
    Matrix Inequalities in System and Control Theory, 1994, section 5.1 (S-lemma); papers 002, (31) at j0 = n, and 004, (7)
    (corners); Krener and Isidori, 1983 (output injection).
    """
    require_integer("ladder", "q", q, 0, "It counts the integrators between innovation and injection.")
    require_plant("ladder", plant)
    require_lipschitz("ladder", lipschitz)
    a = require_alphas("ladder", alphas, plant.n + q)
    if gamma is not None:
        require_positive("ladder", "gamma", gamma, "The gain scale is a rate in 1/s.")
    everywhere = NormBounded.lipschitz(plant.n, lipschitz)
    rungs = [
        _condition5(plant, a, lipschitz, gamma, q),
        _s_lemma("S-lemma, same P", s_lemma_riccati, s_lemma_riccati_gamma, plant, a, everywhere, gamma, q),
        _s_lemma("S-lemma, free P", s_lemma, s_lemma_gamma, plant, a, everywhere, gamma, q),
    ]
    if states is None:
        rungs.append(Rung("structure", "which states enter phi", None, None, None))
    else:
        inside = NormBounded.lipschitz(plant.n, lipschitz, require_state_numbers("ladder", plant.n, states))
        rungs.append(_s_lemma("structure", s_lemma, s_lemma_gamma, plant, a, inside, gamma, q))
    if slopes is None:
        rungs.append(Rung("box corners", "bounds on each slope of phi", None, None, None))
    else:
        rungs.append(_corners(plant, a, _box(plant, slopes), gamma, q))
    return (*rungs, _output_injection(plant, a, states, gamma, q))


def corners_gamma(*, alphas: Numbers, slopes: Numbers, q: int = 0) -> float | None:
    """The infimum of the gamma [1/s] for which one quadratic form decreases at all corners psi of the box of slopes:

        inf {gamma > 0: some P > 0 has (A - L C + B psi')'P + P (A - L C + B psi') < 0 at all psi},      L_i = alphas_i gamma^i.

    alphas (n + q,), Hurwitz; slopes (n, 2): rows (lower, upper) of dphi/dx_j; q: integrators. Bisection, in floats, between a
    gamma that is certified and one that is not; where the box holds 0 nothing is certified below it and every gamma above it
    is, else neither need be so. 0 if 1e-12 still is, None if none is found up to 1e12. ValueError for alphas of another number
    or not Hurwitz. Source: papers 002, (31) at j0 = n, and 004, (7); Boyd et al., 1994, section 5.1.
    """
    box = np.asarray(slopes, float)
    a = require_alphas("corners_gamma", alphas, len(box) + q)
    high = 1.0
    while not _is_certified(a, box, high, q):
        high *= 4
        if high > 1e12:
            return None
    low = high / 4
    while _is_certified(a, box, low, q):
        low, high = low / 4, low
        if low < 1e-12:
            return 0.0
    while high / low > 1 + SPREAD:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if _is_certified(a, box, middle, q) else (middle, high)
    return high


def _is_certified(a: np.ndarray, box: np.ndarray, gamma: float, q: int) -> bool:
    """P > 0 with F'P + P F < 0 at all corners, in the coordinates e_i = gamma^{i-1} zeta_i and the time gamma t."""
    model = _model(a, box * gamma ** np.arange(-len(box), 0.0)[:, None], 1.0, q)
    size = len(a)
    closed = model.closed(a[:, None])

    def lmis(p):
        return [p, *(-(f.T @ p + p @ f) for f in closed)]

    return sdp.feasible({"p": sdp.symmetric(size, trace=1.0)}, lmis).is_feasible


def _model(a: np.ndarray, box: np.ndarray, speed: float, q: int) -> Polytope:
    """The chain behind q integrators with its slopes as channels; those that are exactly zero are left out."""
    size = len(a)
    moving = [j for j in range(len(box)) if np.any(box[j] != 0)]
    b = np.repeat(np.eye(size)[:, -1:], len(moving), axis=1)
    c = np.eye(size)[[q + j for j in moving]]
    return Polytope(speed * np.eye(size, k=1), b, c, box[moving, 0], box[moving, 1], np.eye(1, size))


def _condition5(plant, a, lipschitz, gamma, q) -> Rung:
    name, needs = "condition (5)" if q == 0 else "condition (44)", "a Lipschitz constant of phi"
    smallest = riccati_gamma(alphas=a, lipschitz=lipschitz)
    if not np.isfinite(smallest):
        return Rung(name, needs + "; alphas with (10)", None, None, None)
    return _made(name, needs, smallest, gamma, lambda g: riccati(plant, lipschitz=lipschitz, alphas=a, gamma=g, q=q))


def _s_lemma(name, design, infimum, plant, a, slope, gamma, q) -> Rung:
    needs = "a Lipschitz constant of phi" + ("" if name != "structure" else ", and which states enter it")
    try:
        smallest = infimum(alphas=a, slope=slope, q=q)
    except Infeasible:  # (10), which the metric of condition (5) needs
        return Rung(name, needs + "; alphas with (10)", None, None, None)
    return _made(name, needs, smallest, gamma, lambda g: design(plant, alphas=a, slope=slope, gamma=g, q=q))


def _corners(plant, a, box, gamma, q) -> Rung:
    name, needs = "box corners", "bounds on each slope of phi"
    smallest = corners_gamma(alphas=a, slopes=box, q=q)
    if smallest is None:
        return Rung(name, needs, None, None, None)

    def prove(g):
        model = _model(a, box, 1.0, q)
        return None, corner_lmi.prove(model, (a * g ** np.arange(1.0, len(a) + 1))[:, None])

    upward = bool(np.all((box[:, 0] <= 0) & (box[:, 1] >= 0)))
    return dataclasses.replace(_made(name, needs, smallest, gamma, prove), upward=upward)


def _output_injection(plant, a, states, gamma, q) -> Rung:
    name, needs = "output injection", "phi(y, u): that y alone enters phi; without integrators"
    if q > 0 or states is None or list(states) != [1]:
        return Rung(name, needs, None, None, None)
    size, scale = len(a), 1.0 if gamma is None else gamma
    k = np.eye(size, k=1) - a[:, None] @ np.eye(1, size)
    x = scipy.linalg.solve_continuous_lyapunov(k.T, -np.eye(size))
    s = scale ** -np.arange(size, dtype=float)
    gain = a * scale ** np.arange(1.0, size + 1)
    origin = "none needed: phi knows y alone and is evaluated at the measured y, so that the error is linear"
    certificate = Corners(**chain_error(gain), p=as_tuples((x + x.T) / 2 * np.outer(s, s)), rate=0.0, origin=origin)
    return Rung(name, needs, 0.0, scale, certificate) if certificate.verify() else Rung(name, needs, 0.0, None, None)


def _made(name, needs, smallest, gamma, design) -> Rung:
    """The rung with its certificate, where there is one at this gamma."""
    at = max(DEFAULT_EXCESS * smallest, 1e-6) if gamma is None else gamma
    if at <= smallest:
        return Rung(name, needs, smallest, None, None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LargeGain)  # no observer is handed out here
        try:
            return Rung(name, needs, smallest, at, design(at)[1])
        except Infeasible:  # at the edge, where floats end
            return Rung(name, needs, smallest, None, None)


def _box(plant: AbstractChain, slopes: Numbers) -> np.ndarray:
    box = np.asarray(slopes, float)
    if box.shape != (plant.n, 2) or not np.all(np.isfinite(box)) or np.any(box[:, 0] > box[:, 1]):
        fix = "Give (0, 0) for a state that does not enter phi."
        raise refuse(
            "ladder", "slopes", np.asarray(slopes).tolist(), f"{plant.n} pairs (lower <= upper) of finite numbers", fix
        )
    j = first_state_outside(plant, [j for j in range(plant.n) if np.any(box[j] != 0)])
    if j is not None:
        fix = f"Bound the slope of phi along x_{j + 1}."
        raise refuse("ladder", "slopes", f"(0, 0) for x_{j + 1}", f"an interval: phi changes with x_{j + 1}", fix)
    return box
