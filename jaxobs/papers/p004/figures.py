"""Figures 1 to 3: estimation errors. No initial conditions are printed; ours are in the captions."""

import functools

import jax.numpy as jnp
import numpy as np

from jaxobs._simulate import Trajectory, simulate
from jaxobs.observers import Luenberger, StepLuenberger
from jaxobs.papers.claims import Statement
from jaxobs.papers.p004 import duffing, joint, lorenz
from jaxobs.papers.p004.paper import DUFFING_GAIN, JOINT_GAIN, LORENZ_GAIN, PAPER, PERIOD, forcing, lorenz_plant
from jaxobs.papers.pictures import Line, Panel, Picture
from jaxobs.plants import FlexibleJoint, ForcedDuffing
from jaxobs.signals import Sine

STARTS = "x(0) = {}, estimate 0"
DUFFING_START, JOINT_START, LORENZ_START = (1.0, 1.0), (0.1, 0.0, 0.2, 0.0), (1.0, 2.0, 20.0)
SAMPLES = 1500  # shown of a run


@functools.cache
def duffing_run(own: bool) -> Trajectory:
    plant = ForcedDuffing()
    gain = duffing.own_design()[0] if own else np.asarray(DUFFING_GAIN)
    ts = np.arange(6001) * 0.01
    return simulate(plant, Luenberger(plant, jnp.asarray(gain)), x0=DUFFING_START, xhat0=[0.0] * 2, ts=ts, signal=forcing())


@functools.cache
def joint_run(own: bool) -> Trajectory:
    plant = FlexibleJoint()
    gain = joint.own_design(1.0) if own else np.asarray(JOINT_GAIN)
    ts = np.arange(12001) * 2.5e-4
    return simulate(plant, Luenberger(plant, jnp.asarray(gain)), x0=JOINT_START, xhat0=[0.0] * 4, ts=ts, signal=Sine())


@functools.cache
def lorenz_run(own: bool) -> Trajectory:
    plant = lorenz_plant()
    gain = lorenz.own_designs()[0] if own else np.asarray(LORENZ_GAIN)
    ts = np.arange(6001) * PERIOD
    return simulate(plant, StepLuenberger(plant, jnp.asarray(gain)), x0=LORENZ_START, xhat0=[0.0] * 3, ts=ts)


def errors(run: Trajectory) -> np.ndarray:
    return np.asarray(run.x - run.xhat)


def decay(run: Trajectory) -> tuple[float, float]:
    """(|e| at the end over |e| at the start, the time [s] after which it is below 1e-2 of that for good)."""
    size = np.linalg.norm(errors(run), axis=1) / np.linalg.norm(errors(run)[0])
    return float(size[-1]), float(np.asarray(run.ts)[size >= 1e-2][-1])


def picture(name: str, title: str, start, make) -> Picture:
    panels = []
    for own, label in ((False, "printed L"), (True, "our L")):
        run = make(own)
        every = max(1, len(run.ts) // SAMPLES)
        ts, e = np.asarray(run.ts)[::every], np.abs(errors(run))[::every]
        lines = tuple(Line(f"|e{i + 1}|", ts, np.maximum(e[:, i], 1e-12)) for i in range(e.shape[1]))
        panels.append(Panel(label, "t [s]", "|estimation error|", lines, yscale="log", ylim=(1e-9, 10 * float(e.max()))))
    return Picture(name, f"{title}. {STARTS.format(start)} (ours; none is printed), without noise", tuple(panels))


def figure1() -> Picture:
    return picture("004_figure1", "Figure 1: the error of the Duffing observer, example 1", DUFFING_START, duffing_run)


def figure2() -> Picture:
    return picture("004_figure2", "Figure 2: the error of the flexible joint observer, example 2", JOINT_START, joint_run)


def figure3() -> Picture:
    return picture("004_figure3", "Figure 3: the error of the discrete Lorenz observer, example 3", LORENZ_START, lorenz_run)


PICTURES = (figure1, figure2, figure3)


def statement(make, least: float) -> Statement:
    printed, own = decay(make(False)), decay(make(True))
    why = (
        f"from our start the error falls below 1e-2 of its size in {printed[1]:.2f} s with the printed L, in {own[1]:.2f} s "
        "with ours"
    )
    return Statement(printed[0] < least, printed[0], why)


@PAPER.claim("Figure 1", "figure", printed="the error goes to zero", long=True)
def _():
    return statement(duffing_run, 1e-2)


@PAPER.claim("Figure 2", "figure", printed="the error goes to zero exponentially", long=True)
def _():
    return statement(joint_run, 1e-2)


@PAPER.claim("Figure 3", "figure", printed="the error goes to zero exponentially", long=True)
def _():
    return statement(lorenz_run, 1e-2)
