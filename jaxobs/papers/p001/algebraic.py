"""Section 4: algebraic observability, the Duffing oscillator, its observer."""

import functools
import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._simulate import simulate
from jaxobs.designs import elimination
from jaxobs.designs.tracker import best_rate, tracker_gains
from jaxobs.noise import Sinusoid
from jaxobs.observers import (
    Algebraic,
    DuffingRoot,
    RationalMap,
    crossings,
    output_derivatives,
)
from jaxobs.papers.claims import Statement
from jaxobs.papers.p001.paper import PAPER
from jaxobs.papers.p001.paper import tracker as make_tracker
from jaxobs.plants import Duffing, GatedChain

Exact = tuple[Fraction, Fraction, Fraction]
POINTS = [(Fraction(i, 3), Fraction(j, 5)) for i in range(-6, 8) for j in range(-6, 8)]  # 14 x 14: above every degree compared
X0 = (1.0, 0.0)


def jet(x1: Fraction, x2: Fraction) -> Exact:
    """(y, y', y'') of (40)."""
    return x1 + x2, x2 - x1 - x1**3, -x1 - x1**3 - x2 - 3 * x1**2 * x2


def printed41(y: Fraction, dy: Fraction, ddy: Fraction, last: Fraction) -> tuple[Fraction, Fraction] | None:
    """(x1, x2) of (41) with `last` in the denominator, where (41) has y' and (43) the estimate of y''; None where it is 0."""
    bottom = 2 * y**3 - last + 5 * y
    if bottom == 0:
        return None
    return (-3 * dy + ddy + 4 * y + y**3) * y / bottom, (3 * dy - 2 * ddy + y + y**3) * y / bottom


def corrected41(y: Fraction, dy: Fraction, ddy: Fraction) -> Fraction:
    c = ddy + 2 * dy - y
    return (9 * y**2 * (y - dy) - 4 * c) / (16 + 18 * y**2 - 3 * y * c)


@functools.cache
def truth() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(ts, x, (y, y', y'')) of the oscillator from X0 over 20 s."""
    ts = np.arange(0, 20, 0.01)
    plant = Duffing()
    run = simulate(plant, make_tracker(2, 0, 3.0), x0=X0, xhat0=(0.0, 0.0), ts=ts)
    jets = jax.jit(jax.vmap(lambda x: output_derivatives(plant, x, 2)))(run.x)
    return ts, np.asarray(run.x), np.asarray(jets)


@PAPER.claim("(39) Duffing", "identity", printed="System (40) is algebraically observable")
def _():
    try:
        one, two = (elimination.eliminate(Duffing(), order=order).relations[0] for order in (1, 2))
    except ImportError as error:
        return Statement(None, "not computed", str(error))
    why = (
        f"Elimination finds with y' alone {one.polynomial} = 0 (y0, y1, ... the derivatives), of degree "
        f"{one.degree} in x1, and with y'' the rational x1 = ({two.numerator}) / ({two.denominator}), whose "
        f"denominator is {two.on_trajectories} on trajectories."
    )
    return Statement(bool(two.degree == 1), float(one.degree), why)


@PAPER.claim("Definition 2", "universal", printed="U*, the set of bad inputs that makes (39) singular")
def _():
    plant = GatedChain()
    phi = RationalMap(plant, 1, 0, (((1, 0, 0),), ((0, 0, 0),), ((0, 1, 0),), ((0, 0, 1),)), jnp.ones(4))
    ts = np.arange(0, 10, 0.01)
    counts = {}
    for name, u in (("1 + 0.5 sin t", 1 + 0.5 * np.sin(ts)), ("cos t", np.cos(ts)), ("0", 0 * ts)):
        y = np.stack([1 + 0 * ts, 2 * u], axis=1)  # x2 = 2
        counts[name] = int(np.sum(crossings(phi, jnp.asarray(y), jnp.asarray(u)[:, None, None])))
    listed = ", ".join(f"u = {name}: {count}" for name, count in counts.items())
    why = (
        "A monitor: samples at or beside which a denominator vanishes. x1' = u x2, x2' = 0, y = x1 (paper 003) has x2 = y'/u; "
        f"of {len(ts)} samples over 10 s, {listed}. (40) has no input; its cubic form is defined everywhere."
    )
    good = counts["1 + 0.5 sin t"] == 0 and counts["cos t"] > 0 and counts["0"] == len(ts)
    return Statement(good, float(counts["cos t"]), why)


@PAPER.claim("(41) x1", "identity", printed="(-3y' + y'' + 4y + y^3) y / (2y^3 - y' + 5y)")
def _():
    off, ours = [], []
    for x1, x2 in POINTS:
        y, dy, ddy = jet(x1, x2)
        for last in (dy, ddy):
            found = printed41(y, dy, ddy, last)
            off.append(abs(found[0] - x1) if found else Fraction(0))
        ours.append(abs(corrected41(y, dy, ddy) - x1))
    example = printed41(*jet(Fraction(1), Fraction(1)), jet(Fraction(1), Fraction(1))[1])
    assert example is not None
    why = (
        f"At x = (1, 1) it gives x1 = {example[0]}; with y'' in the denominator, as (43) has it, it fails too. Right: x1 = [9 "
        f"y^2 (y - y') - 4c] / [16 + 18 y^2 - 3 y c], c = y'' + 2 y' - y; its largest error on {len(POINTS)} rational states "
        f"is {float(max(ours)):g}, exactly. Without y'' and never singular: x1^3 + 2 x1 = y - y'."
    )
    return Statement(bool(max(off) == 0 and max(ours) == 0), float(abs(example[0] - 1)), why)


@PAPER.claim("(41) x2", "identity", printed="(3y' - 2y'' + y + y^3) y / (2y^3 - y' + 5y)")
def _():
    point = (Fraction(1), Fraction(1))
    y, dy, ddy = jet(*point)
    found, other = printed41(y, dy, ddy, dy), printed41(y, dy, ddy, ddy)
    assert found is not None
    assert other is not None
    why = (
        f"At x = (1, 1) it gives {found[1]}, and x1 + x2 = {found[0] + found[1]} for y = {y}; with y'' "
        f"in the denominator, as in (43), x1 + x2 = {other[0] + other[1]} = y holds identically and "
        f"hides the error (x2 = {other[1]}). Right: x2 = y - x1."
    )
    return Statement(bool(found[1] == 1), float(found[1]), why)


@PAPER.claim("(41) singularity", "universal", printed="defined along the trajectories")
def _():
    off, low = Fraction(0), math.inf
    for x1, x2 in POINTS:
        y, dy, ddy = jet(x1, x2)
        bottom = 16 + 18 * y**2 - 3 * y * (ddy + 2 * dy - y)
        p = y * x1
        off = max(off, abs(bottom - (16 + 12 * p + 9 * p**2 + 18 * y**2)))
        low = min(low, float(bottom))
    why = (
        "Of the corrected form: on trajectories the denominator is 16 + 12 y x1 + 9 (y x1)^2 + 18 y^2 = 12 + "
        f"(3 y x1 + 2)^2 + 18 y^2 >= 12 (difference {float(off):g}, in fractions). Errors in y'' can make it "
        f"vanish. Shown: its least value on {len(POINTS)} states."
    )
    return Statement(bool(off == 0 and low >= 12), low, why)


@PAPER.claim("(42) V' = 0", "identity", printed="V = x1^2/2 + x2^2/2 + x1^4/4")
def _():
    off = max(abs((x1 + x1**3) * x2 + x2 * (-x1 - x1**3)) for x1, x2 in POINTS)
    return Statement(
        bool(off == 0), float(off), "Exactly: the level sets are closed curves, all trajectories are bounded and periodic."
    )


def level_box(v: float) -> tuple[float, float]:
    """|x1|, |x2| on {V <= v}: x1^2 = sqrt(1 + 4 v) - 1, x2^2 = 2 v."""
    return math.sqrt(math.sqrt(1 + 4 * v) - 1), math.sqrt(2 * v)


def third_derivative_bound(v: float) -> float:
    """|y'''| = |(1 + 3 x1^2)(x1 + x1^3 - x2) - 6 x1 x2^2| on the box around {V <= v}, by the triangle inequality."""
    a, b = level_box(v)
    return (1 + 3 * a**2) * (a + a**3 + b) + 6 * a * b**2


@PAPER.claim("derivatives of y are bounded", "universal", printed="from (42)")
def _():
    v = 0.5 * X0[0] ** 2 + 0.25 * X0[0] ** 4
    bound = third_derivative_bound(v)
    ts, x, _ = truth()
    third = np.asarray(jax.jit(jax.vmap(lambda x: output_derivatives(Duffing(), x, 3)[3]))(jnp.asarray(x)))
    drift = float(np.max(np.abs(x[:, 0] ** 2 / 2 + x[:, 1] ** 2 / 2 + x[:, 0] ** 4 / 4 - v)))
    why = (
        f"Polynomials on a compact level set. From x = (1, 0), V = {v:g}: |x1| <= {level_box(v)[0]:.4g}, |x2| <= "
        f"{level_box(v)[1]:.4g}, so |y'''| <= {bound:.4f}; on the trajectory it reaches the value shown (V is kept to "
        f"{drift:.1e} over {ts[-1]:.0f} s)."
    )
    highest = float(np.max(np.abs(third)))
    return Statement(bool(highest <= bound), highest, why)


@PAPER.claim("mu from (42)", "universal", printed="mu sufficiently large", long=True)
def _():
    n, q, noise = 3, 1, 1e-3
    top = third_derivative_bound(0.75)
    rate = best_rate(n, q, 2, derivative=top, bound=noise)
    gains = tracker_gains(n, q)
    first = gains.worst_bias[0] * top / rate.mu**n + gains.worst[0] * noise
    promised = (first + rate.bias + rate.noise) / 2  # |d x1 / d(y - y')| = 1 / (2 + 3 x1^2) <= 1/2
    observer = Algebraic(DuffingRoot(Duffing()), make_tracker(n, q, rate.mu))
    run = simulate(
        Duffing(),
        observer,
        x0=X0,
        xhat0=(0.0, 0.0),
        ts=np.arange(0, 15, 2e-3),
        noise=Sinusoid(jnp.asarray(noise), jnp.asarray(20.0)),
        key=jax.random.key(0),
    )
    measured = float(np.max(np.abs(run.xhat - run.x)[3000:, 0]))
    why = (
        f"Large, but not too large: with |y'''| <= {top:.4f} and |d| <= {noise:g} the guaranteed error of y' is least at mu = "
        f"{rate.mu:.4f} /s, and |xhat_1 - x1| <= {promised:.4f} after the start; under a tone of that height it stays below "
        "the value shown (n = 3, q = 1, t >= 6 s)."
    )
    return Statement(bool(measured <= promised), measured, why)
