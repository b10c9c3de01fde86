"""Figure 1: the errors for k_f = 1, standard and HG/LMI, at every j0."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxobs._simulate import Trajectory, simulate
from jaxobs.integrators import Exponential
from jaxobs.noise import Gaussian
from jaxobs.observers import Luenberger
from jaxobs.papers.claims import Statement, Value
from jaxobs.papers.p002 import shared
from jaxobs.papers.p002.paper import NOISE, PAPER, X0, XHAT0, N
from jaxobs.papers.pictures import Line, Panel, Picture

SAMPLING, HORIZON, SETTLED = 1e-3, 10.0, 6.0  # s: the noise is drawn anew and held at this period; errors counted after SETTLED
RK4_LIMIT = 2.785293563405282  # |lambda| dt on the negative real axis


def _gain(j0: int) -> np.ndarray:
    """The printed L for j0 = 0..3 (0: standard); for j0 = 4, 5, which the table leaves out, that of `high_gain_lmi`."""
    return shared.gain(shared.row(j0, 1)) if j0 <= 3 else np.array(shared.design(j0).gain)


@functools.cache
def runs() -> Trajectory:
    """All six observers on the same plant and noise; every array has a leading axis j0 = 0..5."""
    plant, ts = shared.plant(), np.arange(0, HORIZON + SAMPLING / 2, SAMPLING)

    def one(gain):
        return simulate(
            plant, Luenberger(plant, gain[:, None]), x0=X0, xhat0=XHAT0, ts=ts,
            noise=Gaussian(jnp.asarray(NOISE)), key=jax.random.key(2), integrator=Exponential(),
        )  # fmt: skip

    return jax.vmap(one)(jnp.asarray(np.stack([_gain(j0) for j0 in range(N + 1)])))


def errors() -> np.ndarray:
    """RMS of each xhat_i - x_i after SETTLED, (j0, i)."""
    path = runs()
    late = np.asarray(path.ts)[0] >= SETTLED
    return np.sqrt(np.mean(np.asarray(path.xhat - path.x)[:, late] ** 2, axis=1))


@PAPER.claim("figure 1", "figure", printed="superiority of HG/LMI, k_f = 1", long=True)
def _():
    table = dict(enumerate(errors()))
    late = "; ".join(f"j0 = {j0}: {one[0]:.2g}, {one[2]:.2g}, {one[4]:.2g}" for j0, one in table.items())
    why = (
        f"RMS error of x_1, x_3, x_5 over t in [{SETTLED:g}, {HORIZON:g}], noise {NOISE} redrawn and held every {SAMPLING:g} s "
        f"(the paper leaves it open): {late}; j0 = 0..3 with the printed gains, 4 and 5 with ours"
    )
    return Statement(all(bool(np.all(table[j0] < table[0])) for j0 in (1, 2, 3)), float(table[0][-1] / table[1][-1]), why)


@PAPER.claim("figure 1, noise sampling", "figure", printed="standard deviation 0.1", long=True)
def _():
    ratios = errors()[:4] / np.stack([_white_noise(_gain(j0)) for j0 in range(4)])
    why = (
        f"the period T is not printed, and the errors grow like its square root: sigma sqrt(T X_ii) with A X + X A' + L L' = 0 "
        f"predicts {ratios.min():.2f} to {ratios.max():.2f} of the RMS errors measured at T = {SAMPLING:g} s (all x_i, j0 = "
        "0..3)"
    )
    return Statement(None, float(np.median(ratios)), why)


def _white_noise(gain: np.ndarray) -> np.ndarray:
    """sigma sqrt(T X_ii): the standard deviations that the noise alone makes, by the linear part of the error."""
    a = _error_matrix(gain)
    x = scipy.linalg.solve_continuous_lyapunov(a, -np.outer(gain, gain))
    return NOISE * np.sqrt(SAMPLING * np.diag(x))


@PAPER.claim("standard observer, explicit step at k_f = 100", "figure", printed="simulations are done")
def _():
    gain = shared.gain(shared.row(0, 100))
    fastest = float(np.abs(np.linalg.eigvals(_error_matrix(gain))).max())
    why = (
        f"its fastest pole is at {fastest:.4g} /s, so classical Runge-Kutta needs steps below {RK4_LIMIT / fastest:.3g} s "
        "(the exponential integrator any)"
    )
    return Statement(True, RK4_LIMIT / fastest, why)


def _error_matrix(gain: np.ndarray) -> np.ndarray:
    return np.eye(N, k=1) - np.outer(gain, np.eye(N)[0])


@PAPER.claim("initial error", "value", printed="4")
def _():
    return Value(float(np.max(np.abs(np.subtract(XHAT0, X0)))), "of every state: x_0 = (1, ..., 1), xhat_0 = (5, ..., 5)")


def figure1() -> Picture:
    """|xhat_i - x_i| for i = 1, 3, 5 and j0 = 0..5."""
    path, panels = runs(), []
    ts, gaps = np.asarray(path.ts)[0, ::10], np.abs(np.asarray(path.xhat - path.x)[:, ::10])
    for i in (0, 2, 4):
        lines = []
        for j0 in range(N + 1):
            label = "standard" if j0 == 0 else f"j0 = {j0}" + ("" if j0 <= 3 else " (ours)")
            lines.append(Line(label, ts, np.maximum(gaps[j0, :, i], 1e-6), faint=j0 == 0))
        panels.append(Panel(f"x_{i + 1}", "t [s]", f"|error of x_{i + 1}|", tuple(lines), yscale="log"))
    caption = (
        f"Paper 002, figure 1: k_f = 1, x(0) = (1, ..., 1), xhat(0) = (5, ..., 5), noise {NOISE} held for {SAMPLING:g} s (our "
        "choice), printed gains for the standard observer and j0 = 1, 2, 3; j0 = 4, 5 designed here."
    )
    return Picture("002_figure1", caption, tuple(panels))


PICTURES = (figure1,)
