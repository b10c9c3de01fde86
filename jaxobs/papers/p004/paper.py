"""Paper 004 and what it prints: the three examples of section VI, and the boxes that their slopes are taken in."""

import functools

import jax.numpy as jnp
import numpy as np

from jaxobs._simulate import simulate
from jaxobs.designs import Channels, corner_lmi, lpv_model, midpoint_channels, simulated_entries, slope_entries
from jaxobs.designs.polytope import Polytope
from jaxobs.integrators import Euler
from jaxobs.observers import Luenberger, StepLuenberger
from jaxobs.papers.claims import Paper
from jaxobs.plants import Discretised, FlexibleJoint, ForcedDuffing, Lorenz, Rossler, VanDerPolSeen
from jaxobs.signals import Sine

PAPER = Paper(
    "004",
    "A. Zemouche, M. Boutayeb, G. I. Bara, Observer design for nonlinear systems: the differential mean value theorem (2005)",
)

DUFFING_GAIN = ((0.9901,), (-0.0056,))
DUFFING_SLOPE = 45.86  # the printed bound on h_1
JOINT_GAIN = ((191.0, -322.0), (456.0, -49032.0), (42.0, -2358.0), (335.0, -7659.0))
LORENZ_GAIN = ((0.0252,), (0.9994,), (0.0567,))
PERIOD = 0.001  # T of example 3


def forcing() -> Sine:
    """u = 11 cos t of example 1."""
    return Sine(jnp.asarray(11.0), phase=jnp.asarray(np.pi / 2))


def duffing_model(slope: float = DUFFING_SLOPE):
    """The error of example 1 for h_1 = df/dx_1 in [0, slope]; df/dx_2 is 0 identically."""
    return lpv_model(ForcedDuffing(), slope_entries([[0.0, 0.0]], [[slope, 0.0]]))


def joint_channels(angle: float) -> Channels:
    """Example 2 for |theta_l - theta_m| <= angle: 3 d^2 along x_3 - x_1, one parameter for two entries, and cos along x_3."""
    right = np.array([[-1.0, 0, 1, 0], [0, 0, 1, 0]])
    return Channels(np.eye(2), right, np.array([0.0, -1.0]), np.array([3 * angle**2, 1.0]))


def joint_model(angle: float):
    return lpv_model(FlexibleJoint(), joint_channels(angle))


def lorenz_plant() -> Discretised:
    """Example 3: the Euler map of the Lorenz system."""
    return Discretised(Lorenz(), Euler(), jnp.asarray(PERIOD))


def lorenz_entries(lower, upper) -> Channels:
    """The four entries (x_3, x_1; x_2, x_1) of the Jacobian of f = (x_1 x_3, x_1 x_2), independent of each other."""
    low, high = ([[x[2], 0, x[0]], [x[1], x[0], 0]] for x in (lower, upper))
    return slope_entries(low, high)


def lorenz_midpoint(lower, upper) -> Channels:
    """x_1 x_3 - z_1 z_3 = m_3 e_1 + m_1 e_3 with m = (x + z) / 2, and the same for x_1 x_2: three parameters."""
    return midpoint_channels(Lorenz(), lower, upper)


@functools.cache
def duffing_from_rest(end: float = 60.0, dt: float = 0.01):
    """(t, x) of example 1 from x(0) = 0, by RK4 at the step dt."""
    ts = np.arange(round(end / dt) + 1) * dt
    plant = ForcedDuffing()
    run = simulate(
        plant, Luenberger(plant, jnp.asarray(DUFFING_GAIN)), x0=[0.0, 0.0], xhat0=[0.0, 0.0], ts=ts, signal=forcing()
    )
    return ts, np.asarray(run.x)


@functools.cache
def lorenz_box() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The extremes of the state of example 3 from (1, 1, 1) over 200 s, without the first 20 s."""
    plant = lorenz_plant()
    still = StepLuenberger(plant, jnp.asarray(LORENZ_GAIN))
    ts = np.arange(200_001) * PERIOD
    x = np.asarray(simulate(plant, still, x0=[1.0] * 3, xhat0=[1.0] * 3, ts=ts).x)[20_000:]
    return tuple(x.min(0).tolist()), tuple(x.max(0).tolist())


@functools.cache
def attractor(kind: str) -> np.ndarray:
    """States of the Roessler system or the Van der Pol oscillator, transient left out, (samples, n)."""
    plant = Rossler() if kind == "rossler" else VanDerPolSeen()
    ts = np.arange(40_001) * 0.01
    start = [1.0] * plant.n
    run = simulate(plant, Luenberger(plant, jnp.zeros((plant.n, 1))), x0=start, xhat0=start, ts=ts)
    return np.asarray(run.x)[10_000:]


def seen_model(kind: str, state: int) -> Polytope:
    """The error with y = x_state, slopes in the extremes of a simulated run."""
    samples = attractor(kind)
    output = jnp.eye(samples.shape[1])[state - 1 : state]
    plant = Rossler(output=output) if kind == "rossler" else VanDerPolSeen(output=output)
    return lpv_model(plant, simulated_entries(plant, samples))


@functools.cache
def certified_gain(kind: str, state: int) -> np.ndarray:
    """L with an exact certificate there; Infeasible if none is found."""
    return corner_lmi.synthesise(seen_model(kind, state))[0]


def as_text(gain) -> str:
    """A gain, one bracket a state."""
    return "[" + ", ".join("[" + ", ".join(f"{x:.4g}" for x in row) + "]" for row in np.asarray(gain)) + "]"
