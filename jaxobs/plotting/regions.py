"""The errors from which a certificate promises convergence, with errors that keep the promise."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg
from jaxtyping import Float
from matplotlib.figure import Figure

from jaxobs._module import refuse, require_integer
from jaxobs.certificates import Corners, Regional
from jaxobs.plotting._runs import as_runs, chosen
from jaxobs.plotting.style import BLUE, GREEN, GREY, INK, NOTE, ORANGE, WHITE_BOX, panel, root

STEPS, PIECES = 600, 12  # samples of a simulated error, and how often its parameters jump


def certified_region(
    certificate: Any,
    *,
    runs: Any = None,
    states: Sequence[int] = (1, 2),
    starts: int = 12,
    seed: int = 0,
    title: str = "",
    ax: Any = None,
) -> Figure:
    """The ellipsoid {e: e'P e <= level} in the plane of two errors, the box |h_j'e| < w_j that it touches, the ball |e| <=
    radius, and errors that start on its border.

    certificate: of `jaxobs.designs.regional`; or Corners, whose every ellipsoid is invariant (level 1 is drawn, and no
    box). Drawn is the shadow of the ellipsoid on the plane, in which every error stays: e_ij'((P^-1)_ij)^-1 e_ij <= level.
    runs: a Trajectory, or several, of the observer: their errors xhat - x. None: `starts` errors of the certificate's own
    e' = F(rho(t)) e from the border, over eight time constants of the slowest corner, with rho(t) jumping between the
    corners of its box at random (`seed`); an uncertain block Delta is left at zero. Errors that leave the ellipsoid after
    they have been in it are drawn in another colour, with dashes, and counted. states: two numbers from 1. ValueError for
    anything else.
    """
    if not isinstance(certificate, Regional | Corners):
        fix = "jaxobs.designs.regional and corner_lmi.prove return them."
        raise refuse("plotting.certified_region", "certificate", type(certificate).__name__, "Regional or Corners", fix)
    require_integer("plotting.certified_region", "starts", starts, 0, "It counts the errors that are simulated.")
    p = np.asarray(certificate.p, float)
    plane = chosen("certified_region", "states", states, len(p))
    if len(plane) != 2 or plane[0] == plane[1]:
        raise refuse("plotting.certified_region", "states", tuple(states), "two different numbers", "E.g. states=(1, 2).")
    level = float(getattr(certificate, "level", 1.0))
    paths = _given(runs, len(p)) if runs is not None else simulated(certificate, starts, seed)
    shadow = np.linalg.inv(p)[np.ix_(plane, plane)] * level
    with panel("certified_region", ax, (6.4, 5.6)) as ax:
        border = np.linalg.cholesky(shadow) @ _circle()
        ax.fill(*border, color=BLUE, alpha=0.12, lw=0)
        proved = "proved" if certificate.verify() else "not certified"
        name = f"{proved}: e'P e <= {level:.3g}" if isinstance(certificate, Regional) else f"{proved}, at any size"
        ax.plot(*border, color=BLUE, lw=2, label=name)
        radius = float(getattr(certificate, "radius", 0.0))
        if radius > 0:
            ax.plot(*(radius * _circle()), color=GREEN, lw=1.4, ls=(0, (5, 1.6)), label=f"|e| <= {radius:.3g}")
        reach = 1.18 * np.max(np.abs(border), axis=1)
        reach = _paths(ax, paths, plane, p, level, reach)
        if isinstance(certificate, Regional):
            reach = _box(ax, certificate, plane, reach)
        ax.plot(0, 0, "+", color=INK, ms=9, mew=1.4, zorder=6)
        ax.set(xlim=(-reach[0], reach[0]), ylim=(-reach[1], reach[1]))
        ax.set(xlabel=f"error of x{plane[0] + 1}", ylabel=f"error of x{plane[1] + 1}")
        ax.set_title(title)
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, fontsize=NOTE, **WHITE_BOX)
        return root(ax)


def _paths(ax: Any, paths: list[np.ndarray], plane: list[int], p: np.ndarray, level: float, reach: np.ndarray) -> np.ndarray:
    """The errors, those that leave apart; how far the axes go."""
    left = [leaves(path, p, level) for path in paths]
    for path, out in zip(paths, left, strict=True):
        look: dict[str, Any] = {"color": ORANGE, "ls": (0, (5, 1.6)), "lw": 1.3} if out else {"color": INK, "lw": 0.8}
        ax.plot(path[:, plane[0]], path[:, plane[1]], alpha=0.8, zorder=3, **look)
        ax.plot(*path[0, plane], "o", ms=4, color=look["color"], zorder=4)
        reach = np.maximum(reach, 1.08 * np.abs(path[0, plane]))
    if paths:
        ax.plot([], [], color=INK, lw=0.8, marker="o", ms=4, label=f"{len(paths) - sum(left)} of {len(paths)} errors stay")
    if any(left):
        ax.plot([], [], color=ORANGE, lw=1.3, ls=(0, (5, 1.6)), label=f"{sum(left)} leave the region")
    return reach


def leaves(path: Float[np.ndarray, "T n"], p: Float[np.ndarray, "n n"], level: float) -> bool:
    """Whether e'P e exceeds the level (by more than rounding) after it has been below it."""
    values = np.einsum("ti,ij,tj->t", path, p, path)
    inside = values <= level * (1 + 1e-9)
    return bool(np.any(inside) and np.any(values[int(np.argmax(inside)) :] > level * (1 + 1e-6)))


def _box(ax: Any, certificate: Regional, plane: list[int], reach: np.ndarray) -> np.ndarray:
    """The sides |h'e| = w that lie in the plane: lines, and what is beyond them shaded."""
    faces = np.asarray(certificate.faces)
    inner, outer = ((np.asarray(certificate.inner_lower), np.asarray(certificate.inner_upper)),
                    (np.asarray(certificate.outer_lower), np.asarray(certificate.outer_upper)))  # fmt: skip
    widths = np.minimum(outer[1] - inner[1], inner[0] - outer[0])
    others = np.setdiff1d(np.arange(faces.shape[1]), plane)
    drawn = False
    for h, w in zip(faces[:, plane], widths, strict=True):
        own = faces[np.all(faces[:, plane] == h, axis=1)]
        if not np.any(h) or np.any(own[:, others] != 0):
            continue
        for k in np.flatnonzero(h):
            if np.count_nonzero(h) == 1:
                reach[k] = max(reach[k], 1.12 * w / abs(h[k]))
        for sign in (-1, 1):
            nearest, along = sign * w * h / (h @ h), np.array([-h[1], h[0]]) / np.linalg.norm(h)
            ends = nearest[:, None] + along[:, None] * np.array([-1, 1]) * 4 * np.max(reach)
            ax.plot(*ends, color=GREY, lw=1.6, label=None if drawn else "border of the box of the bounds", zorder=2)
            drawn = True
    return reach


def simulated(certificate: Any, starts: int, seed: int) -> list[Float[np.ndarray, "T n"]]:
    """Errors of e' = F(rho(t)) e from the border of the region, rho(t) at a corner, drawn anew PIECES times."""
    a, b, c = (np.asarray(part, float) for part in (certificate.a, certificate.b, certificate.c))
    output, gain = np.asarray(certificate.output, float), np.asarray(certificate.gain, float)
    lower, upper = np.asarray(certificate.lower, float), np.asarray(certificate.upper, float)
    inner = np.asarray(certificate.inner, float)
    channels = len(lower)
    c = c.reshape(channels, len(a)) - (inner @ output if inner.size else 0.0)
    tied = np.asarray(certificate.tied or range(channels), int)
    rng = np.random.default_rng(seed)
    sides = rng.integers(0, 2, (starts, PIECES, max(channels, 1)))
    pick = [lower + side[:, tied[:channels]] * (upper - lower) for side in sides] if channels else [
        np.zeros((PIECES, 0))] * starts  # fmt: skip

    def closed(rho):
        return a + b.reshape(len(a), channels) @ (rho[:, None] * c) - gain @ output

    corners = [closed(side) for rho in pick for side in rho] or [a - gain @ output]
    slowest = max(max(np.linalg.eigvals(f).real) for f in corners)
    rate = max(-slowest, float(certificate.rate), 1e-3)
    dt = 8 / rate / STEPS
    root_ = np.linalg.inv(np.linalg.cholesky(np.asarray(certificate.p, float))).T * np.sqrt(getattr(certificate, "level", 1.0))
    found = []
    for k in range(starts):
        direction = rng.normal(size=len(a))
        if len(a) == 2:
            direction = np.array([np.cos(2 * np.pi * k / starts), np.sin(2 * np.pi * k / starts)])
        path = [root_ @ (direction / np.linalg.norm(direction))]
        for rho in pick[k]:
            step = scipy.linalg.expm(closed(rho) * dt)
            for _ in range(STEPS // PIECES):
                path.append(step @ path[-1])
        found.append(np.array(path))
    return found


def _given(runs: Any, n: int) -> list[np.ndarray]:
    """The errors of the runs, one array each."""
    several = list(runs) if isinstance(runs, list | tuple) else [runs]
    found = []
    for run in several:
        own = as_runs("certified_region", run)
        if own.n != n:
            fix = "The runs and the certificate have to be of one observer."
            raise refuse("plotting.certified_region", "runs", f"{own.n} states", f"{n}", fix)
        found += list(own.errors("certified_region")[own.finite])
    return found


def _circle() -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, 361)
    return np.array([np.cos(angle), np.sin(angle)])
