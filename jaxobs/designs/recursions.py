"""Error dynamics of observers that correct by something else than L (y - C z): models for corner_lmi and sampled_data."""

import math

import numpy as np
from jaxtyping import Float

from jaxobs._module import Numbers, refuse, require_integer, require_positive
from jaxobs.designs.polytope import Polytope


def current_form(model: Polytope) -> Polytope:
    """e+ = (I - K C)(a + sum_k rho_k b_k c_k') e, of CurrentLuenberger: the same with the output C a, where C b = 0.

    model: of z+ = f(z) + L (y - C z). The gain K takes the place of L. ValueError if an uncertain channel enters an output.
    Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, section 8.2.
    """
    if np.any(model.output @ model.b):
        given = f"C b = {(model.output @ model.b).tolist()}"
        fix = "The channels then have other directions for every gain; take StepLuenberger."
        raise refuse("current_form", "model", given, "uncertain channels that do not enter an output in the same step", fix)
    return Polytope(model.a, model.b, model.c, model.lower, model.upper, model.output @ model.a, model.tied)


def tracker_form(n: int, q: int, dt: float) -> Polytope:
    """eta+ = (I - G C~) e^{A~ dt} eta, the error of DiscreteTracker with the gain G, in the coordinates of the plain shift.

    n >= 1, q >= 0; dt [s] > 0. No parameter: polynomials of degree < n are followed without error, and what is proved is how
    fast a wrong start is forgotten. ValueError for anything else. Source: paper 001, (30) and (33), corrected.
    """
    require_integer("tracker_form", "n", n, 1, "It counts the signal and the derivatives wanted.")
    require_integer("tracker_form", "q", q, 0, "It counts the integrators in front of the estimate.")
    require_positive("tracker_form", "dt", dt, "It is the sampling period in seconds.")
    size = n + q
    lag = np.arange(size)[None, :] - np.arange(size)[:, None]
    a = np.array([[dt**j / math.factorial(j) if j >= 0 else 0.0 for j in row] for row in lag.tolist()])
    none = np.zeros(0)
    return Polytope(a, np.zeros((size, 0)), np.zeros((0, size)), none, none, a[:1])


def held_behind(model: Polytope, gain: Numbers, q: int) -> tuple[Polytope, Float[np.ndarray, "N 1"]]:
    """The model and the gain of sampled_data for IntegralHighGain whose innovation y(t_k) - xhat_1(t_k) is held:

        eps_i' = eps_{i+1} - l_i eps_1  (i < q),    eps_q' = e_1(t_k) - l_q eps_1,    e' = (A + B psi') e - L eps_1.

    The integrators run on between samples: L = (l_1, ..., l_{q+n}) is in `a`, and what is held is e_1 alone.
    model: of the chain, (n, n), one output e_1. gain (n + q,). q >= 1. ValueError for anything else.
    """
    require_integer("held_behind", "q", q, 1, "Without integrators the model of the plant is the one that is needed.")
    known = np.asarray(gain, float).reshape(-1)
    if known.shape != (model.n + q,) or model.p != 1:
        fix = "One number for each integrator, then one for each state."
        raise refuse("held_behind", "gain", f"shape {np.shape(gain)}", f"({model.n + q},) and one output", fix)
    size = model.n + q
    a = np.zeros((size, size))
    a[q:, q:], a[:q, :q] = model.a, np.eye(q, k=1)
    a[:, 0] -= known
    b, c = (np.zeros((size, model.r)), np.zeros((model.r, size)))
    b[q:], c[:, q:] = model.b, model.c
    output = np.concatenate([np.zeros((1, q)), model.output], axis=1)
    return Polytope(a, b, c, model.lower, model.upper, output, model.tied), 0.0 - np.eye(size)[:, q - 1 : q]
