"""Section VI, example 2: the flexible joint robot link."""

import functools

import jax.numpy as jnp
import numpy as np

from jaxobs._simulate import simulate
from jaxobs.certificates import exact, routh
from jaxobs.designs import Infeasible, corner_lmi
from jaxobs.observers import Luenberger
from jaxobs.papers.claims import Point, Statement, Value
from jaxobs.papers.p004.paper import JOINT_GAIN, PAPER, as_text, joint_model
from jaxobs.plants import FlexibleJoint
from jaxobs.signals import Sine

RATE = 4.0  # 1/s, asked of our gain


def printed_matrices() -> tuple[np.ndarray, np.ndarray]:
    """(A, B) as printed under (17), by its formulas and physical values."""
    jm, jl, h, mass, b, k1, k2, gravity = 3.7e-3, 9.3e-3, 0.15, 0.21, 4.6e-2, 1.0, 1.0, 9.81
    a = [[0, 1, 0, 0], [-k1 / jm, -b / jm, k1 / jm, 0], [0, 0, 0, 1], [k1 / jl, 0, -k1 / jl, 0]]
    return np.array(a), np.array([[0, 0], [k2 / jm, 0], [0, 0], [-k2 / jl, -mass * gravity * h / jl]])


@functools.cache
def twist(start: float = 0.0, end: float = 20.0) -> float:
    """max |theta_l - theta_m| [rad] under u = sin t, the link starting `start` away from the motor."""
    plant = FlexibleJoint()
    ts = np.arange(round(end / 0.005) + 1) * 0.005
    x0 = [0.0, 0.0, start, 0.0]
    run = simulate(plant, Luenberger(plant, jnp.zeros((4, 2))), x0=x0, xhat0=x0, ts=ts, signal=Sine())
    return float(np.max(np.abs(np.asarray(run.x[:, 2] - run.x[:, 0]))))


@functools.cache
def proof(angle: float):
    """The certificate of the printed L for |theta_l - theta_m| <= angle, accepted exactly, or None."""
    try:
        return corner_lmi.prove(joint_model(angle), np.asarray(JOINT_GAIN))
    except Infeasible:
        return None


def proves(angle: float) -> bool:
    found = proof(angle)
    return found is not None and bool(found.verify())


@functools.cache
def largest_angle() -> tuple[float, float]:
    """(largest angle with a certificate, smallest angle without) for the printed L, to 0.01 rad."""
    low, high = 0.5, 3.0
    while high - low > 0.01:
        middle = (low + high) / 2
        low, high = (middle, high) if proves(middle) else (low, middle)
    return low, high


def is_frozen_stable(slope: float) -> bool:
    """Routh's test of A(3 d^2 = slope, cos = 1) - L C, exact for the floats."""
    model = joint_model(1.0)
    f = model.at(np.array([slope, 1.0])) - np.asarray(JOINT_GAIN) @ model.output
    return routh.frozen(exact.matrix(f.tolist())).is_stable


@functools.cache
def first_unstable_slope() -> float:
    """The smallest 3 d^2, to 1e-3, at which the printed L leaves a growing mode."""
    low, high = 0.0, 100.0
    while high - low > 1e-3:
        middle = (low + high) / 2
        low, high = (middle, high) if is_frozen_stable(middle) else (low, middle)
    return high


@functools.cache
def own_design(angle: float) -> np.ndarray:
    """Our gain for |theta_l - theta_m| <= angle at RATE."""
    return corner_lmi.synthesise(joint_model(angle), rate=RATE)[0]


@PAPER.claim("(17)", "identity", printed="A and B of (9)")
def _():
    plant = FlexibleJoint()
    a, b = printed_matrices()
    miss = max(float(np.max(np.abs(np.asarray(plant.a()) - a))), float(np.max(np.abs(np.asarray(plant.b()) - b))))
    return Statement(miss < 1e-9, miss, "with g = 9.81 m/s^2, which is not printed")


@PAPER.claim("(17) g", "identity", printed="g(y, u) = (0, K/J_m, 0, 0)", scan=True)
def _():
    plant, u = FlexibleJoint(), jnp.asarray([0.5])
    given = plant.flow(jnp.asarray(0.0), jnp.zeros(4), u)[1]  # at rest the second line of (17) is K u / J_m
    printed = plant.amplifier / plant.motor_inertia
    miss = float(given - printed)
    return Statement(
        miss == 0,
        miss,
        f"the factor u is missing: at rest with u = 0.5 V (17) gives {float(given):.4g}, g as printed {float(printed):.4g}",
    )


@PAPER.claim("Ex. 2 unit of b", "value", printed="0")
def _():
    """The power of the second in the unit of b: b = 4.6e-2 m is printed."""
    kg, m, s = np.eye(3)
    torque, speed = kg + 2 * m - 2 * s, -s
    friction = torque - speed  # b omega is a torque
    powers = " ".join(f"{name}^{power:g}" for name, power in zip(("kg", "m", "s"), friction, strict=True))
    why = (
        f"power of the second: the unit is printed as m, but b multiplies an angular velocity to a torque, so it is {powers}, "
        "that is N m s; the number 4.6e-2 is used as it is"
    )
    return Value(float(friction[2]), why)


@PAPER.claim("Ex. 2 bounds", "universal", printed="h_11 and h_13 bounded")
def _():
    rest, pushed = twist(), twist(1.0)
    why = (
        f"no bounds are printed, and 3 d^2, d = theta_l - theta_m, depends on the start: d stays below {rest:.3f} rad from "
        f"rest and reaches {pushed:.3f} rad when the link starts 1 rad away. Both are of simulated states, not proved: open"
    )
    return Statement(None, 3 * rest**2, why)


@PAPER.claim("Ex. 2 poles of A - L C", "universal", printed="exponential convergence")
def _():
    model = joint_model(0.0)
    poles = np.linalg.eigvals(model.at(np.array([0.0, 1.0])) - np.asarray(JOINT_GAIN) @ model.output)
    fast = poles[np.argmax(poles.imag)]
    step = 2.78 / abs(fast)  # RK4's reach along rays near the imaginary axis
    why = (
        f"stable without the nonlinear spring (exact Routh test), with a barely damped pair {fast.real:.1f} +- "
        f"{fast.imag:.0f}i: RK4 needs steps below about {step * 1e3:.1f} ms, and noise in theta_m is multiplied by "
        f"{-JOINT_GAIN[1][1]:.0f}"
    )
    return Statement(is_frozen_stable(0.0), float(np.max(poles.real)), why)


@PAPER.claim("Ex. 2 L satisfies (12)", "feasible", printed="the printed 4 x 2 L", long=True)
def _():
    rest = twist()
    low, high = largest_angle()
    gain, slope = own_design(1.0), first_unstable_slope()
    why = (
        f"for the motion from rest, |d| <= {rest:.3f} rad, it has an exact certificate, and up to {low:.2f} rad; at {high:.2f} "
        f"rad none was found, and at 3 d^2 = {slope:.2f} (d = {np.sqrt(slope / 3):.2f} rad) a constant d already leaves a "
        f"growing mode. Ours for |d| <= 1 rad with a proved {RATE:g} /s: {as_text(gain)}"
    )
    return Point(proves(rest), why=why)


@PAPER.claim("Ex. 2 convergence without a bound on h", "universal", printed="guaranteeing the exponential convergence")
def _():
    slope = first_unstable_slope()
    why = (
        f"h is assumed bounded, but no bound on d = theta_l - theta_m is printed: open. One is needed: at the constant twist "
        f"with 3 d^2 = {slope:.3f} the error grows (exact Routh test: {'stable' if is_frozen_stable(slope) else 'unstable'}); "
        "with |d| bounded as in 'Ex. 2 L satisfies (12)' it converges"
    )
    return Statement(None, slope, why)
