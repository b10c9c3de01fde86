"""Observers of the Euler model and their largest sampling periods: (62), (63) and (65) of paper 000, with any number of
integrators.

x+ = x + dt (A x + B phi(x, u)), y = x_1, B dphi/dx = M F N with |F| <= 1, and xhat+ = the same + L (y - xhat_1): the observers
(51), (53), (64) differ only in how L is found, so all of them are StepLuenberger on Discretised(plant, Euler(), dt), or
behind q integrators StepIntegral. With K = I + dt A - L C, the error tends to zero if for some X > 0, epsilon > 0

    [X - epsilon N'N,  -K'X,  0;  -X K,  X,  -dt X M;  0,  -dt M'X,  epsilon I] > 0.                                       (62)

Everything is solved in the coordinates e_i = unit^{1-i} zeta_i, where a chain of any length is well scaled, and what is found
is decided exactly for the floats that the observer carries. All of it concerns the Euler model, not the plant it replaces.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np

from jaxobs._module import Numbers, dtype_of, refuse, require_integer
from jaxobs.certificates import StepCorners
from jaxobs.designs import sdp
from jaxobs.designs._chain_gain import chain_error, metric, require_alphas, require_positive, warn_large_gain
from jaxobs.designs._euler_lmi import Coordinates, attempt
from jaxobs.designs._multiplier import best_multiplier
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.norm_bounded import NormBounded, require_plant
from jaxobs.designs.polytope import as_tuples
from jaxobs.integrators import Euler
from jaxobs.observers import StepIntegral, StepLuenberger
from jaxobs.plants import AbstractChain, Discretised

StepObserver = StepLuenberger | StepIntegral
SPREAD = 1e-9  # of the bisection in log dt
ROUNDING = 10.0 ** np.arange(-11, -3)  # by which a solver's optimum may miss the feasible side, relative


@dataclasses.dataclass(frozen=True)
class Period:
    """dt [s]: the longest period found feasible. refuted [s]: no longer one is, by the duals of the program, in floats
    (infinite where they do not say). x (N, N), epsilon: the solution of (62) at dt; for (65), X = P^-1 / dt and epsilon =
    tau.
    """

    dt: float
    refuted: float
    x: np.ndarray
    epsilon: float


def euler_riccati(
    plant: AbstractChain, *, alphas: Numbers, gamma: float, dt: float, slope: NormBounded, q: int = 0
) -> tuple[StepObserver, StepCorners]:
    """(63): L = dt P(gamma) C', that is l_i = dt alphas_i gamma^i; X = P(gamma)^-1 / dt, and tau the best multiplier.

    alphas (n + q,) with (10), gamma [1/s], dt [s]. Infeasible, with the largest period in `best`, where no tau will do.
    """
    name = "euler_riccati"
    require_plant(name, plant, slope)
    a = _alphas(name, alphas, gamma, slope, q)
    require_positive(name, "dt", dt, "It is the sampling period in seconds.")
    here = Coordinates.make(slope, q, 1 / gamma)
    step, x = gamma * dt, np.linalg.inv(metric(name, a)) / (gamma * dt)
    f0, f1 = (here.matrix(x, here.c.T, epsilon, dt) for epsilon in (0.0, 1.0))
    tau, margin = best_multiplier(f0, f1 - f0)
    gain = dt * a * float(gamma) ** np.arange(1.0, len(a) + 1)
    found = _proved(name, plant, gain, dt, slope, q, here.back(x), tau / here.balance, 1.0) if margin > 0 else None
    if found is not None:
        return found
    largest = euler_riccati_period(alphas=a, gamma=gamma, slope=slope, q=q).dt
    reason = f"(63) has no solution tau at gamma = {gamma:.6g}, dt = {dt:.6g} s: gamma dt = {step:.4g} is too large"
    change = f"It has one for dt < {largest:.8g} s, by (65); or look for another gain: euler_tied, euler_free."
    raise Infeasible(reason, min(margin, 0.0), change, best=largest, tried=("(63)",))


def euler_tied(
    plant: AbstractChain, *, dt: float, slope: NormBounded, q: int = 0, unit: float | None = None, factor: float = 1.0
) -> tuple[StepObserver, StepCorners]:
    """(62) as printed: L = X^-1 C', so that X K = X + dt X A - C'C, for the X of the largest margin:

        [factor^2 X - epsilon N'N,  -(X + dt X A - C'C)',  0;  *,  X,  -dt X M;  0,  *,  epsilon I] > 0.

    dt [s]. slope: M (n, r), N (s, n). q: integrators. unit [s]: the errors of unit^{i-1} x_i are weighed alike; dt if not
    given, for gains that settle within a few samples; longer units are slower and quieter. factor in ]0, 1]: also |e_k| <= c
    factor^k (the paper has 1).

    Infeasible, with the largest period for factor = 1 in `best`. ValueError for a plant that is no chain or that changes with a
    state outside `slope`, dt or unit <= 0, a factor outside ]0, 1]. Source: paper 000, (62).
    """
    return _designed("euler_tied", plant, dt, slope, q, unit, factor)


def euler_free(
    plant: AbstractChain, *, dt: float, slope: NormBounded, q: int = 0, unit: float | None = None, factor: float = 1.0
) -> tuple[StepObserver, StepCorners]:
    """(62) with the gain set free, L = X^-1 Y: Y = X L (N, 1) is an unknown of its own in place of C',

        [factor^2 X - epsilon N'N,  -(X + dt X A - Y C)',  0;  *,  X,  -dt X M;  0,  *,  epsilon I] > 0,

    so every L that has some X is within reach. Arguments and errors as for euler_tied. Source: paper 000, (62), with the change
    of variables of Boyd et al., Linear Matrix Inequalities in System and Control Theory, 1994.
    """
    return _designed("euler_free", plant, dt, slope, q, unit, factor)


def euler_riccati_period(*, alphas: Numbers, gamma: float, slope: NormBounded, q: int = 0) -> Period:
    """(65): the largest dt = 1/alpha for which (63) holds, by one program, linear in alpha and tau together; with X =
    P(gamma)^-1

        min alpha:   [alpha X - tau N'N,  -(alpha X + X A - C'C)',  0;  *,  alpha X,  -X M;  0,  *,  tau I] > 0.

    Every smaller dt will do as well. Infeasible if no dt does.
    """
    name = "euler_riccati_period"
    a = _alphas(name, alphas, gamma, slope, q)
    here = Coordinates.make(slope, q, 1 / gamma, np.linalg.inv(metric(name, a)))
    x = np.eye(here.size)  # of these coordinates

    def lmis(alpha, tau):
        return [here.blocks(alpha * x, alpha * x + here.a - here.c.T @ here.c, here.m, tau)]

    unknowns = {"alpha": sdp.scalar(), "tau": sdp.scalar()}
    found = sdp.optimise(unknowns, lmis, maximise=lambda alpha, tau: -alpha, margin=0.0)
    refuted = 1 / (-found.bound * gamma) if found.bound < 0 else np.inf
    for excess in (0.0, *ROUNDING) if found.values else ():  # the solver ends at the edge, on either side of it
        alpha = float(found.values["alpha"]) * (1 + excess)
        f0, f1 = (lmis(alpha, tau)[0] for tau in (0.0, 1.0))
        tau, margin = best_multiplier(f0, f1 - f0)
        if margin > 0:
            return Period(1 / (alpha * gamma), refuted, here.back(alpha * x), tau / here.balance)
    reason = f"(65) has no solution at gamma = {gamma:.6g}, however small the period"
    raise Infeasible(reason, min(found.margin, 0.0), "Raise gamma, or name the states that enter phi.", tried=("(65)",))


def euler_tied_period(*, slope: NormBounded, q: int = 0) -> Period:
    """The largest dt for which (62) has a solution with L = X^-1 C'. With X at dt0, (dt0 / dt) X is one at a smaller dt."""
    return _largest("euler_tied_period", slope, q)


def euler_free_period(*, slope: NormBounded, q: int = 0) -> Period:
    """The largest dt for which (62) has a solution with some gain.

    Where x_1 alone enters phi and q = 0 it is rho^{-1/n}: at the slopes +-rho the determinants of K differ by 2 rho dt^n,
    whatever L is, and both have to lie in ]-1, 1[.
    """
    return _largest("euler_free_period", slope, q)


def _largest(name: str, slope: NormBounded, q: int) -> Period:
    """Bisection in log dt: each step has a point of positive margin, or counts as a failure, which its duals may confirm."""
    require_integer(name, "q", q, 0, "It counts the integrators between innovation and injection.")
    tied, refuted = name == "euler_tied_period", np.inf

    def solved(dt: float) -> Period | None:
        nonlocal refuted
        one = attempt(tied, slope, q, dt, dt, 1.0)
        if one.bound < 0:
            refuted = min(refuted, dt)
        return Period(dt, np.inf, one.x, one.epsilon) if one.margin > 0 else None

    low = 1 / float(np.sqrt(np.linalg.norm(slope.left, 2) * np.linalg.norm(slope.right, 2)))
    high, best = low, None
    while (longer := solved(high)) is not None:
        best, low, high = longer, high, 2 * high
    shortest = 1e-9 * low
    while best is None:  # a short enough period has one: M F N fades against the chain
        low, high = low / 2, low
        if low < shortest:
            reason = f"(62) has no solution that floats can find, down to dt = {low:.6g} s"
            raise Infeasible(reason, 0.0, "Give time and the states units in which their numbers are about 1.")
        best = solved(low)
    while high / low > 1 + SPREAD:
        middle = float(np.sqrt(low * high))
        found = solved(middle)
        best, low, high = (found, middle, high) if found else (best, low, middle)
    return dataclasses.replace(best, refuted=refuted)


def _designed(
    name: str, plant: AbstractChain, dt: float, slope: NormBounded, q: int, unit: float | None, factor: float
) -> tuple[StepObserver, StepCorners]:
    require_plant(name, plant, slope)
    require_integer(name, "q", q, 0, "It counts the integrators between innovation and injection.")
    require_positive(name, "dt", dt, "It is the sampling period in seconds.")
    require_positive(name, "unit", dt if unit is None else unit, "A time in seconds; dt is the default.")
    if not 0 < factor <= 1:
        raise refuse(name, "factor", factor, "a number in ]0, 1]", "1 asks for convergence alone, smaller ones for speed.")
    tied = name == "euler_tied"
    one = attempt(tied, slope, q, dt, dt if unit is None else unit, factor)
    found = _proved(name, plant, one.gain, dt, slope, q, one.x, one.epsilon, factor) if one.margin > 0 else None
    if found is not None:
        return found
    gain = "L = X^-1 C'" if tied else "any gain"
    largest = (euler_tied_period if tied else euler_free_period)(slope=slope, q=q).dt
    reason = f"(62) with {gain} has no solution at dt = {dt:.6g} s" + (f" for factor = {factor:.6g}" if factor < 1 else "")
    change = f"For factor = 1 it has one for dt < {largest:.8g} s."
    if tied:
        change += " The gain may also be set free: euler_free."
    raise Infeasible(reason, min(one.margin, 0.0), change, best=largest, tried=(f"(62), {gain}",))


def _proved(name, plant, gain, dt, slope, q, x, epsilon, factor) -> tuple[StepObserver, StepCorners] | None:
    """The observer in the plant's precision, and the certificate of the floats it carries if the exact check accepts it."""
    dtype = dtype_of(plant)
    gain, period = jnp.asarray(gain, dtype), jnp.asarray(dt, dtype)
    if q == 0:
        observer = StepLuenberger(Discretised(plant, Euler(), period), gain[:, None])
    else:
        observer = StepIntegral(plant, gain, period, q)
    carried = np.asarray(gain, float)
    origin = f"{slope.origin}; F is the error of the Euler model with dt = {float(period)!r}, not of the plant itself"
    fields = chain_error(carried, slope=slope, q=q, dt=float(period))
    certificate = StepCorners(**fields, p=as_tuples(x), tau=float(epsilon), factor=float(factor), origin=origin)
    if not certificate.verify():
        return None
    warn_large_gain(name, carried)
    return observer, certificate


def _alphas(name: str, alphas: Numbers, gamma: float, slope: NormBounded, q: int) -> np.ndarray:
    require_integer(name, "q", q, 0, "It counts the integrators between innovation and injection.")
    require_positive(name, "gamma", gamma, "The gain scale is a rate in 1/s.")
    return require_alphas(name, alphas, slope.n + q)
