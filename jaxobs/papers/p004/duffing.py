"""Section VI, example 1: the Duffing oscillator."""

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs.certificates import Corners, NoGain, StepCorners
from jaxobs.designs import Infeasible, corner_lmi
from jaxobs.designs.audit import Audit, audit
from jaxobs.papers.claims import Bound, Point, Statement, Value
from jaxobs.papers.p004.paper import (
    DUFFING_GAIN,
    DUFFING_SLOPE,
    PAPER,
    as_text,
    duffing_from_rest,
    duffing_model,
)
from jaxobs.plants import ForcedDuffing

LATE = 50.0  # s, after the transient from rest


def frozen_growth(slope: float) -> float:
    """max Re of the eigenvalues of A(h) - L C at h = slope."""
    model = duffing_model()
    return float(np.max(np.linalg.eigvals(model.at(np.array([slope])) - np.asarray(DUFFING_GAIN) @ model.output).real))


def common(slope: float) -> Corners | StepCorners | NoGain:
    """The proof that with the printed L the ends of [0, slope] share a quadratic Lyapunov function, or that they share none."""
    model = dataclasses.replace(duffing_model(), upper=np.array([slope]))
    try:
        return corner_lmi.prove(model, np.asarray(DUFFING_GAIN))
    except Infeasible as error:
        if error.certificate is None:
            raise
        return error.certificate


@functools.cache
def largest_slope() -> float:
    """The largest h for which the printed L has a common P on [0, h], by bisection with a proof at each step, to 1e-3."""
    low, high = 1.0, DUFFING_SLOPE
    while high - low > 1e-3:
        middle = (low + high) / 2
        low, high = (low, middle) if isinstance(common(middle), NoGain) else (middle, high)
    return low


@functools.cache
def own_design() -> tuple[np.ndarray, float]:
    """Our gain for the printed box, at the decay rate that the printed one shows at frozen slopes."""
    rate = -max(frozen_growth(h) for h in np.linspace(0, DUFFING_SLOPE, 41))
    gain, _ = corner_lmi.synthesise(duffing_model(), rate=rate)
    return gain, rate


@functools.cache
def audited() -> Audit:
    """Everything that is found out about the printed gain on the printed box."""
    return audit(duffing_model(), np.asarray(DUFFING_GAIN))


@PAPER.claim("Ex. 1 h_1", "value", printed="4")
def _():
    """At z_1 = 2, where h_1 = 2 z_1 as printed is 4."""
    slope = float(jax.grad(lambda x: ForcedDuffing().f(x)[0])(jnp.asarray([2.0, 0.0]))[0])
    low = float(2 * np.min(duffing_from_rest()[1][:, 0]))
    why = (
        f"at z1 = 2: h_1 = 2 z1 as printed is 4, but f = x1^3 has the slope 3 z1^2 = {slope:g}. The printed bounds are those "
        f"of 3 z1^2; 2 z1 falls to {low:.2f}"
    )
    return Value(slope, why)


@PAPER.claim("Ex. 1 lower bound of h_1", "bound", printed="0")
def _():
    return Bound(float(np.min(3 * duffing_from_rest()[1][:, 0] ** 2)), "lower", "3 z1^2 >= 0 for every z, simulated or not")


@PAPER.claim("Ex. 1 maximum of h_1 in simulation", "value", printed="45.86")
def _():
    ts, x = duffing_from_rest(200.0)
    slope = 3 * x[:, 0] ** 2
    fine = float(np.max(3 * duffing_from_rest(60.0, 0.001)[1][:, 0] ** 2))
    why = (
        f"from x(0) = 0, sampled at 0.01 s; it is the transient's, at t = {ts[np.argmax(slope)]:.1f} s ({fine:.4f} between the "
        f"samples), and from {LATE:g} s to {ts[-1]:g} s the maximum is {np.max(slope[ts >= LATE]):.2f}"
    )
    return Value(float(np.max(slope)), why)


@PAPER.claim("Ex. 1 bound on h_1", "universal", printed="h_1(t) <= 45.86 for all t")
def _():
    _, x = duffing_from_rest(60.0, 0.001)
    rest = float(np.max(3 * x[:, 0] ** 2))
    why = (
        f"a maximum over samples of one run from rest, which reaches {rest:.4f} between the samples. A start beyond |x1| = "
        f"{math.sqrt(DUFFING_SLOPE / 3):.3f} exceeds it at once, and z(t) lies between x and an estimate that depends on L"
    )
    return Statement(rest <= DUFFING_SLOPE, rest, why)


@PAPER.claim("Ex. 1 L satisfies (7)", "feasible", printed="L = (0.9901, -0.0056)", long=True)
def _():
    gain, rate = own_design()
    worst = max(frozen_growth(h) for h in np.linspace(0, DUFFING_SLOPE, 41))
    found = audited()
    assert found.switching is not None
    grows = found.counterexample is not None and bool(found.counterexample.verify())
    periods = " and ".join(f"{d:.2f}" for d in found.switching.durations)
    switching = (
        f"switching between the ends every {periods} s makes the error grow, proved" if grows else "none grows that we found"
    )
    why = (
        f"the ends 0 and {DUFFING_SLOPE:g} share no quadratic Lyapunov function with this L (exact certificate); up to h = "
        f"{largest_slope():.2f} they do. At constant h in the box the error decays (max Re {worst:.3f} on a grid), so the "
        f"printed figure is no contradiction; but {switching}. A gain for the whole box, proved rate {rate:.3f} /s: "
        f"{as_text(gain)}"
    )
    return Point(not isinstance(common(DUFFING_SLOPE), NoGain), why=why)


@PAPER.claim("Ex. 1 largest box of L", "feasible", printed="h_1 in [0, 45.86]")
def _():
    found = largest_slope()
    low, high = math.floor(found * 1000) / 1000, math.ceil((found + 1e-3) * 1000) / 1000
    why = f"with the printed L (7) has a solution on [0, {low:.3f}] and none on [0, {high:.3f}], both exactly"
    return Point(found >= DUFFING_SLOPE, found, why)
