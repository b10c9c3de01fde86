"""Where the poles of observers lie, beside the sectors that decide about condition (10)."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Complex, Float
from matplotlib.figure import Figure
from matplotlib.patches import Wedge

from jaxobs import hurwitz
from jaxobs._module import Numbers, refuse
from jaxobs.observers import AbstractStepObserver, Observer
from jaxobs.plotting.style import BLUE, CYCLE, GREY, INK, MARKERS, NOTE, SKY, WHITE_BOX, panel, root
from jaxobs.tuning.linear_error import linearise


class Poles(NamedTuple):
    """linear: of A - L C, or of the linearised error where an observer has no such part; local: at the points x, if any.

    step: whether they are of z, to be compared with the unit circle. weights: the q_i of the corrected (8), where there are
    alphas; condition (10) holds where all are positive.
    """

    linear: Complex[np.ndarray, " N"]
    local: Complex[np.ndarray, " M"]
    step: bool
    weights: Float[np.ndarray, " N"] | None

    @property
    def margin(self) -> float:
        """-max Re s, or 1 - max |z|: of A - L C; positive if it is stable."""
        return float(1 - np.max(np.abs(self.linear))) if self.step else float(-np.max(np.real(self.linear)))


def poles(
    observers: Any, *, plant: Any = None, x: Numbers | None = None, u: Numbers | None = None, title: str = "", ax: Any = None
) -> Figure:
    """The poles of A - L C in the complex plane with their stability margin, -max Re s, for one observer or several.

    Condition (10) of paper 000 asks of alpha(s) = s^N + alpha_1 s^{N-1} + ... that all q_i > 0 (the corrected (8)):

        alpha(s) alpha(-s) = (-1)^N (s^{2N} - q_1 s^{2N-2} + q_2 s^{2N-4} - ...),    q_i = e_i(p_1^2, ..., p_N^2),

    e_i the elementary symmetric polynomials of the squared poles. So it holds if all poles lie within 45 degrees of the
    negative axis (dark sector: -p_k^2 then has a negative real part, and a polynomial with such roots has positive
    coefficients), and fails if one lies beyond 90 (1 - 1/N) degrees (outside the light sector: a polynomial of degree N
    with positive coefficients has no root within 180/N degrees of the positive axis). In between, the other poles decide;
    for N = 2 both angles are 45 degrees. The legend says what q says. N is the largest number of alphas here. Condition
    (10) is what theorem 1 of the paper needs; it is more than Hurwitz.

    observers: an observer, coefficients alphas (N,), or {label: one of these}. Of an observer with alphas and gamma the
    poles are gamma times those of the alphas; of another one those of its linearised error (`jaxobs.tuning.linearise`) on
    `plant` (its own model if not given) at x = 0. x (n,) or (points, n), u (m,): where small dots show the linearised
    error, phi in it, of every observer. Step observers have the unit circle in place of the sectors, and the margin 1 - max
    |z|; they make a picture of their own. ValueError for anything else.
    """
    found = {label: _poles(label, one, plant, x, u) for label, one in _named(observers).items()}
    if len({one.step for one in found.values()}) > 1:
        fix = "Draw the step observers in a picture of their own."
        raise refuse("plotting.poles", "observers", "flow and step observers", "one kind", fix)
    step = next(iter(found.values())).step
    with panel("poles", ax, (6.6, 5.4)) as ax:
        everything = np.concatenate([np.concatenate([one.linear, one.local]) for one in found.values()])
        if step:
            circle = np.exp(1j * np.linspace(0, 2 * np.pi, 361))
            ax.plot(np.real(circle), np.imag(circle), color=GREY, lw=1, label="unit circle")
        else:
            _sectors(ax, found, everything)
        for i, (label, one) in enumerate(found.items()):
            colour = CYCLE[i % len(CYCLE)]
            look = {"marker": MARKERS[i % len(MARKERS)], "ls": "none", "mec": colour, "mew": 1.3}
            ax.plot(np.real(one.local), np.imag(one.local), ls="none", marker=".", ms=3.5, color=colour, alpha=0.6, zorder=3)
            ax.plot(
                np.real(one.linear), np.imag(one.linear), mfc="white", ms=7, zorder=4, label=f"{label}: {_words(one)}", **look
            )
        if any(one.local.size for one in found.values()):
            ax.plot([], [], ls="none", marker=".", color=INK, ms=5, label="with phi, linearised at the points x")
        _frame(ax, everything, step)
        ax.set(xlabel="Re z" if step else "Re s [1/s]", ylabel="Im z" if step else "Im s [1/s]")
        ax.set_title(title)
        low = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.13)}
        ax.legend(fontsize=NOTE, **(low | WHITE_BOX))
        return root(ax)


def sectors(size: int) -> tuple[float, float]:
    """Half angles in degrees, from the negative real axis, for N = `size` poles: condition (10) holds if all poles lie
    within the first, and fails if one lies beyond the second."""
    return (45.0, 90 * (1 - 1 / size)) if size > 1 else (90.0, 90.0)


def _sectors(ax: Any, found: Mapping[str, Poles], everything: np.ndarray) -> None:
    ax.axvline(0, color=GREY, lw=1)
    own = [one for one in found.values() if one.weights is not None]
    if not own:
        return
    size = max(len(one.linear) for one in own)
    inner, outer = sectors(size)
    reach = 4 * float(np.max(np.abs(everything)))
    ax.add_patch(Wedge((0, 0), reach, 180 - inner, 180 + inner, fc=BLUE, alpha=0.18, lw=0, zorder=0))
    only = ", outside it fails" if outer == inner else ""
    ax.plot([], [], color=BLUE, alpha=0.3, lw=8, label=f"N = {size}, all within {inner:.4g}°: (10) holds{only}")
    if outer > inner:
        ax.add_patch(Wedge((0, 0), reach, 180 - outer, 180 + outer, fc=SKY, alpha=0.16, lw=0, zorder=0))
        ax.plot([], [], color=SKY, alpha=0.3, lw=8, label=f"to {outer:.4g}°: the q decide; beyond, (10) fails")


def _frame(ax: Any, everything: np.ndarray, step: bool) -> None:
    """Equal scales, the imaginary axis in sight, and room around the poles."""
    size = max(float(np.max(np.abs(everything))), 1e-12)
    high = 1.15 * max(float(np.max(np.abs(np.imag(everything)))), 0.45 * size)
    if step:
        high = 1.15 * max(1.0, size)
        ax.set(xlim=(-high, high), ylim=(-high, high), aspect="equal")
        return
    right = max(0.18 * size, 1.2 * float(np.max(np.real(everything))))
    left = min(1.15 * float(np.min(np.real(everything))), -0.2 * size)
    ax.set(xlim=(left, right), ylim=(-high, high), aspect="equal")


def _words(one: Poles) -> str:
    words = f"margin {one.margin:.3g}" + ("" if one.step else " 1/s")
    if one.margin <= 0:
        words = f"not stable, {'max |z|' if one.step else 'max Re s'} = {1 - one.margin if one.step else -one.margin:.3g}"
    if one.weights is None:
        return words
    if np.all(one.weights > 0):
        return f"{words}; (10) holds"
    i = int(np.argmin(one.weights > 0))
    return f"{words}; (10) fails, q{i + 1} = {one.weights[i]:.3g}"


def _named(observers: Any) -> dict[str, Any]:
    if isinstance(observers, Mapping):
        if not observers:
            raise refuse("plotting.poles", "observers", "none", "{label: observer or alphas}", "Give one at least.")
        return {str(label): one for label, one in observers.items()}
    return {type(observers).__name__ if isinstance(observers, Observer) else "alphas": observers}


def _poles(label: str, one: Any, plant: Any, x: Any, u: Any) -> Poles:
    none = np.zeros(0, complex)
    if not isinstance(one, Observer):
        try:
            alphas = np.asarray(one, float)
        except (TypeError, ValueError):
            alphas = np.zeros((0, 0))
        if alphas.ndim != 1 or not alphas.size or not np.all(np.isfinite(alphas)):
            fix = "A design returns its observer together with the certificate: give the observer alone."
            raise refuse("plotting.poles", f"observers[{label!r}]", type(one).__name__, "an observer or alphas (N,)", fix)
        return Poles(np.roots(np.append(1.0, alphas)), none, False, np.asarray(hurwitz.q_from_alphas(alphas)))
    step = isinstance(one, AbstractStepObserver)
    alphas, gamma = (getattr(one, name, None) for name in ("alphas", "gamma"))
    local = none if x is None else _at(one, plant, np.atleast_2d(np.asarray(x, float)), u)
    if alphas is not None and gamma is not None and np.ndim(gamma) == 0 and not step:
        a = np.asarray(alphas, float)
        return Poles(float(gamma) * np.roots(np.append(1.0, a)), local, step, np.asarray(hurwitz.q_from_alphas(a)))
    origin = _at(one, plant, np.zeros((1, one.n)), u)
    return Poles(origin, local, step, None)


def _at(observer: Any, plant: Any, points: np.ndarray, u: Any) -> np.ndarray:
    """The eigenvalues of the linearised error at every point."""
    inner = getattr(observer, "observer", observer)
    model = getattr(inner, "model", None) if plant is None else plant
    if model is None:
        fix = "Give plant=: the system that it is to follow."
        raise refuse("plotting.poles", "plant", f"None for {type(observer).__name__}, which has no model", "a plant", fix)
    if points.ndim != 2 or points.shape[1] != observer.n:
        fix = "One point, or one a row."
        raise refuse("plotting.poles", "x", f"shape {points.shape}", f"(points, {observer.n})", fix)
    matrices = jax.vmap(lambda point: linearise(observer, model, point, u).f)(points.astype(float))
    return np.linalg.eigvals(np.asarray(matrices, float)).reshape(-1)
