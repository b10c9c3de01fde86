"""Chain observers certified by the S-lemma instead of condition (5): the same gains alphas_i gamma^i, far smaller gamma.

e' = (A - L C + M F N) e with |F| <= 1: V = e'Xe decreases for all such F exactly when, for some tau > 0 (and K = A - L C),

    [-K'X - X K - 2 rate X - tau N'N,  -X M;  -M'X,  tau I] > 0.

With X = P(gamma)^-1, the metric of condition (5), only tau is sought; with X free it is the bounded real lemma, decided by the
eigenvalues of a Hamiltonian matrix, and X is the solution of a Riccati equation. Neither needs a semidefinite program.

Source: Boyd, El Ghaoui, Feron and Balakrishnan, Linear Matrix Inequalities in System and Control Theory, 1994 (the
S-procedure, the bounded real lemma, quadratic stability); the Hamiltonian test: Boyd, Balakrishnan and Kabamba, 1989.
"""

import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxobs._module import Numbers, dtype_of, refuse
from jaxobs.certificates import Corners
from jaxobs.designs._chain_gain import chain_error, metric, require_alphas, require_positive, warn_large_gain
from jaxobs.designs._euler_lmi import Coordinates
from jaxobs.designs._multiplier import best_multiplier
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.norm_bounded import NormBounded, require_plant
from jaxobs.designs.polytope import as_tuples
from jaxobs.observers import HighGain, IntegralHighGain
from jaxobs.plants import AbstractChain

DEFAULT_EXCESS = 1.1  # gamma over the smallest certified one, when none is asked for
ON_AXIS = 1e-7  # real parts below it count as zero: a double eigenvalue is good to the root of the machine precision


def s_lemma(
    plant: AbstractChain, *, alphas: Numbers, slope: NormBounded, gamma: float | None = None, q: int = 0, rate: float = 0.0
) -> tuple[HighGain | IntegralHighGain, Corners]:
    """The observer with L_i = alphas_i gamma^i, and X > 0, tau > 0 that prove |e(t)| <= sqrt(cond X) e^{-rate t} |e(0)|:

        [-K'X - X K - 2 rate X - tau N'N,  -X M;  -M'X,  tau I] > 0,      K = A - L C,

    which some X and tau solve exactly when K + rate I is Hurwitz and |N (s - rate - K)^-1 M|_inf < 1.

    slope: M (n, r) and N (s, n) of B dphi/dx = M F N, |F| <= 1. alphas (n + q,), Hurwitz. gamma [1/s], 1.1 times the smallest
    certified one if not given. q: integrators between innovation and injection. rate [1/s] >= 0.

    Infeasible, with `smallest_gamma`, where no X will do. ValueError for a plant that is no chain or that `slope` does not fit
    (another n, or phi changes with a state outside N), alphas of another number or not Hurwitz, gamma <= 0. Source: Boyd et
    al., 1994, sections 2.6.3, 2.7.3, 5.1.
    """
    return _designed("s_lemma", plant, alphas, slope, gamma, q, rate)


def s_lemma_riccati(
    plant: AbstractChain, *, alphas: Numbers, slope: NormBounded, gamma: float | None = None, q: int = 0, rate: float = 0.0
) -> tuple[HighGain | IntegralHighGain, Corners]:
    """The inequality of s_lemma with X = P(gamma)^-1 of condition (5), and tau > 0 alone sought:

        A P + P A' - P C'C P + Q = 0,      P(gamma) C' = (alphas_i gamma^i)      (paper 000, (6)).

    Arguments and errors as for s_lemma; Infeasible, too, where alphas violate (10), which P > 0, Q > 0 need. Source: paper 000,
    (6), (10); Boyd et al., 1994, section 2.6.3 (S-procedure).
    """
    return _designed("s_lemma_riccati", plant, alphas, slope, gamma, q, rate)


def s_lemma_gamma(*, alphas: Numbers, slope: NormBounded, q: int = 0) -> float:
    """The infimum of the gamma [1/s] that s_lemma certifies at rate 0, by bisection in log gamma:

        inf {gamma > 0: K = A - L C Hurwitz, |N (s - K)^-1 M|_inf < 1},      L_i = alphas_i gamma^i.

    alphas (n + q,); slope: M (n, r), N (s, n) of a chain, M F N = B dphi/dx. ValueError for alphas of another number or not
    Hurwitz. Source: Boyd et al., 1994; Boyd, Balakrishnan and Kabamba, 1989.
    """
    return _smallest("s_lemma", require_alphas("s_lemma_gamma", alphas, slope.n + q), slope, q)


def s_lemma_riccati_gamma(*, alphas: Numbers, slope: NormBounded, q: int = 0) -> float:
    """The infimum of the gamma [1/s] that s_lemma_riccati certifies at rate 0, by bisection in log gamma: with X = P(gamma)^-1

        inf {gamma > 0: [-K'X - X K - tau N'N,  -X M;  -M'X,  tau I] > 0 for some tau > 0}.

    Arguments, errors and source as for s_lemma_gamma; Infeasible where alphas violate (10).
    """
    return _smallest("s_lemma_riccati", require_alphas("s_lemma_riccati_gamma", alphas, slope.n + q), slope, q)


def _designed(name, plant, alphas, slope, gamma, q, rate):
    require_plant(name, plant, slope)
    a = require_alphas(name, alphas, slope.n + q)
    if not rate >= 0:
        raise refuse(name, "rate", repr(rate), "a number >= 0", "It is the decay rate in 1/s that is to be proved.")
    smallest = None
    if gamma is None:
        smallest = _smallest(name, a, slope, q, rate)
        gamma = DEFAULT_EXCESS * smallest
    require_positive(name, "gamma", gamma, "The gain scale is a rate in 1/s.")
    dtype = dtype_of(plant)
    coefficients, scale = jnp.asarray(a, dtype), jnp.asarray(gamma, dtype)
    observer = HighGain(plant, coefficients, scale) if q == 0 else IntegralHighGain(plant, coefficients, scale, q)
    gain = np.asarray(observer.gain(), float)
    for found in _solutions(name, np.asarray(coefficients, float), float(scale), slope, q, rate):
        x, tau = found
        certificate = Corners(
            **chain_error(gain, slope=slope, q=q), p=as_tuples(x), tau=float(tau), rate=float(rate), origin=slope.origin
        )
        if certificate.verify():
            warn_large_gain(name, gain)
            return observer, certificate
    smallest = _smallest(name, a, slope, q, rate) if smallest is None else smallest
    kind = "X = P(gamma)^-1" if name == "s_lemma_riccati" else "any X"
    reason = f"the S-lemma with {kind} fails at gamma = {gamma:.6g}"
    change = f"It holds for gamma > {smallest * (1 + 1e-6):.8g}; or name the states that enter phi."
    raise Infeasible(reason, gamma / smallest - 1, change, smallest, tried=(f"S-lemma, {kind}",))


def _solutions(name, a, gamma, slope, q, rate):
    """(X, tau) in the original coordinates, the roomiest first."""
    if name == "s_lemma_riccati":
        here, tau, margin = _with_metric(a, gamma, slope, q, rate)
        if margin > 0:
            yield here.back(np.eye(here.size)), tau / (here.balance * here.unit)
        return
    here = Coordinates.make(slope, q, 1 / gamma)
    k = _closed(here, a, gamma) + rate / gamma * np.eye(here.size)
    if not _is_bounded_real(k, here):
        return
    for excess in (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        load = here.n.T @ here.n
        weight = load + excess * max(np.linalg.norm(load, 2), 1e-3) * np.eye(here.size)
        try:
            x = scipy.linalg.solve_continuous_are(k, here.m, weight, -np.eye(here.m.shape[1]))
        except (np.linalg.LinAlgError, ValueError):
            continue
        yield here.back(x), 1 / (here.balance * here.unit)  # time is counted in units here


def _smallest(name: str, a: np.ndarray, slope: NormBounded, q: int, rate: float = 0.0) -> float:
    """Bisection in log gamma: in scaled coordinates M F N shrinks as gamma grows, so what is certified once stays so."""
    if name == "s_lemma_riccati":
        metric(name, a)

    def holds(log_gamma: float) -> bool:
        gamma = float(np.exp(log_gamma))
        if name == "s_lemma_riccati":
            return _with_metric(a, gamma, slope, q, rate, enough=0.0)[2] > 0
        here = Coordinates.make(slope, q, 1 / gamma)
        return _is_bounded_real(_closed(here, a, gamma) + rate / gamma * np.eye(here.size), here)

    low, high = -1.0, 1.0
    while holds(low):
        low -= 2.0
    while not holds(high):
        high += 2.0
    while high - low > 1e-13 * max(1.0, abs(high)):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        low, high = (low, middle) if holds(middle) else (middle, high)
    return float(np.exp(high))


def _closed(here: Coordinates, a: np.ndarray, gamma: float) -> np.ndarray:
    """K = A - L C with L = (alphas_i gamma^i), in these coordinates."""
    gain = a * gamma ** np.arange(1.0, len(a) + 1)
    return here.a - here.unit * np.linalg.solve(here.t, gain[:, None]) @ here.c


def _with_metric(a, gamma, slope, q, rate, enough=np.inf) -> tuple[Coordinates, float, float]:
    """The coordinates in which P(gamma)^-1 is I, the best tau there and its margin."""
    here = Coordinates.make(slope, q, 1 / gamma, np.linalg.inv(metric("s_lemma_riccati", a)))
    k = _closed(here, a, gamma)
    size, r = here.m.shape
    decrease = -(k + k.T) - 2 * rate / gamma * np.eye(size)
    f0 = np.block([[decrease, -here.m], [-here.m.T, np.zeros((r, r))]])
    f1 = np.block([[-here.n.T @ here.n, np.zeros((size, r))], [np.zeros((r, size)), np.eye(r)]])
    tau, margin = best_multiplier(f0, f1, enough=enough)
    return here, tau, margin


def _is_bounded_real(k: np.ndarray, here: Coordinates) -> bool:
    """Whether K is Hurwitz and |N (s - K)^-1 M|_inf < 1: no eigenvalue of [[K, MM'], [-N'N, -K']] is imaginary."""
    if np.max(np.linalg.eigvals(k).real) >= 0:
        return False
    hamiltonian = np.block([[k, here.m @ here.m.T], [-here.n.T @ here.n, -k.T]])
    roots = np.linalg.eigvals(hamiltonian)
    return bool(np.min(np.abs(roots.real)) > ON_AXIS * np.max(np.abs(roots)))
