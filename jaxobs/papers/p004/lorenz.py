"""Section VI, example 3: the discrete Lorenz system."""

import functools
import math

import jax.numpy as jnp
import numpy as np

from jaxobs.certificates import exact, routh
from jaxobs.designs import Infeasible, corner_lmi, lpv_lmi, lpv_model
from jaxobs.integrators import Euler
from jaxobs.papers.claims import Point, Statement
from jaxobs.papers.p004 import invariant
from jaxobs.papers.p004.paper import (
    LORENZ_GAIN,
    PAPER,
    PERIOD,
    as_text,
    lorenz_box,
    lorenz_entries,
    lorenz_midpoint,
    lorenz_plant,
)
from jaxobs.plants import Discretised, Lorenz, Saturated

SLACK = 3.0  # by which the box of the regional statement is wider than the invariant one


@functools.cache
def certificate(box, kind):
    """The exact certificate of the printed L on a box, or None; kind: lorenz_entries or lorenz_midpoint."""
    try:
        return corner_lmi.prove(lpv_model(lorenz_plant(), kind(*box)), np.asarray(LORENZ_GAIN), step=True)
    except Infeasible:
        return None


@functools.cache
def growing_corner():
    """A corner of the independent entries on the invariant box at which I + T A_c - L C has an eigenvalue outside the unit
    circle, by the exact count, with the modulus of that eigenvalue."""
    model = lpv_model(lorenz_plant(), lorenz_entries(*invariant.BOX))
    closed = model.closed(np.asarray(LORENZ_GAIN))
    moduli = [float(np.max(np.abs(np.linalg.eigvals(f)))) for f in closed]
    worst = int(np.argmax(moduli))
    outside = routh.frozen(exact.matrix(closed[worst].tolist()), step=True).outside
    return outside, moduli[worst], model.parameters()[worst]


@functools.cache
def region() -> tuple[float, float]:
    """(level, offset): errors with e'P e <= level stay so, with both midpoints in the wider box; the largest c with (c, c, c)
    among them. A midpoint leaves the invariant box by half the error at most, and |e_i|^2 <= level (P^-1)_ii.
    """
    low, high = (np.asarray(end) for end in invariant.BOX)
    wide = certificate((tuple(low - SLACK), tuple(high + SLACK)), lorenz_midpoint)
    assert wide is not None
    p = np.asarray(wide.p)
    level = float(np.min((2 * SLACK) ** 2 / np.diag(np.linalg.inv(p))))
    return level, math.sqrt(level / float(np.ones(3) @ p @ np.ones(3)))


@functools.cache
def own_designs() -> tuple[np.ndarray, np.ndarray]:
    """Our gains on the invariant box: with the midpoint split; and for the saturated model, whose estimate may be anywhere."""
    factor = 1 - PERIOD
    _, split = lpv_lmi(lorenz_plant(), bounds=lorenz_midpoint(*invariant.BOX), rate=factor)
    plant = Discretised(Saturated(Lorenz(), *(jnp.asarray(end) for end in invariant.BOX)), Euler(), jnp.asarray(PERIOD))
    _, everywhere = lpv_lmi(plant, bounds=lorenz_entries(*invariant.BOX), rate=factor)
    return np.asarray(split.gain), np.asarray(everywhere.gain)


@PAPER.claim("(13) Ex. 3 model", "identity", printed="A, B, f of the discrete Lorenz system")
def _():
    t, worst, plant = PERIOD, 0.0, lorenz_plant()
    a = np.array([[1 - 10 * t, 10 * t, 0], [28 * t, 1 - t, 0], [0, 0, 1 - 8 / 3 * t]])
    b = t * np.array([[0, 0], [-1, 0], [0, 1]])
    for x in np.random.default_rng(0).normal(size=(8, 3)) * 10:
        step = plant.step(jnp.asarray(0), jnp.asarray(x), jnp.zeros(0))
        worst = max(worst, float(np.max(np.abs(a @ x + b @ [x[0] * x[2], x[0] * x[1]] - np.asarray(step)))))
    return Statement(worst < 1e-12, worst, "the Euler map with T = 0.001; the t in f(x(k)) stands for k")


@PAPER.claim("Ex. 3 L on the simulated box", "feasible", printed="L = (0.0252, 0.9994, 0.0567)")
def _():
    low, high = (np.round(end, 2).tolist() for end in lorenz_box())
    proof = certificate(lorenz_box(), lorenz_entries)
    why = (
        f"exact certificate for (16) with 16 independent corners on {low} .. {high}, the extremes of a run from (1, 1, 1) (no "
        "bounds are printed): conditional on the state and the estimate staying there"
    )
    return Point(proof is not None and bool(proof.verify()), why=why)


@PAPER.claim("Ex. 3 invariant box", "universal", printed="the chaotic state is bounded")
def _():
    why = (
        "|x1|, |x2| <= 30, -2 <= x3 <= 58 is proved for the Euler map itself, in exact arithmetic: once inside, the state stays"
    )
    return Statement(invariant.is_invariant(), float(invariant.BOX[1][2]), why)


@PAPER.claim("Ex. 3 L on the invariant box, (16) as printed", "universal", printed="L by theorem 5.2, no bounds printed")
def _():
    outside, modulus, corner = growing_corner()
    why = (
        f"open, since the bounds are not printed. On our invariant box, with h_ij independent as in (16), {outside} eigenvalue "
        f"of the corner (x3, x1, x2, x1) = {corner.tolist()} lies outside the unit circle (exact count; modulus "
        f"{modulus:.6f}). That corner is no slope of the plant, its two x1 differ: the row below keeps them equal"
    )
    return Statement(None, modulus, why)


@PAPER.claim("Ex. 3 L on the invariant box, midpoint split", "feasible", printed="L = (0.0252, 0.9994, 0.0567)")
def _():
    proof = certificate(invariant.BOX, lorenz_midpoint)
    level, offset = region()
    why = (
        "x1 x3 - z1 z3 = m3 e1 + m1 e3 and x1 x2 - z1 z2 = m2 e1 + m1 e2 with one m1: 8 corners, exact certificate. It needs "
        f"the midpoint of x and estimate in the box; on the box widened by {SLACK:g} it holds too, so every start with x in "
        f"the invariant set and e'P e <= {level:.3g} converges, for instance e = (c, c, c) with |c| <= {offset:.2f}"
    )
    return Point(proof is not None and bool(proof.verify()), why=why)


@PAPER.claim("Ex. 3 our gains", "feasible", printed="L = (0.0252, 0.9994, 0.0567)", long=True)
def _():
    split, everywhere = own_designs()
    model = lpv_model(lorenz_plant(), lorenz_midpoint(*invariant.BOX))
    best = corner_lmi.largest_rate(model, np.asarray(LORENZ_GAIN), step=True)
    why = (
        f"the printed L proves the factor {best:.6f} a step on the invariant box with the midpoint split. Ours there, for "
        f"{1 - PERIOD:g} a step: {as_text(split.T)}'; for the saturated model f(sat(z)), whose estimate may start anywhere, "
        f"{as_text(everywhere.T)}'. Under the same relaxation one can ask for more than the printed L proves"
    )
    return Point(best <= 1, why=why)
