"""How far each kind of proof reaches down in gamma."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxobs._module import refuse, require_instance
from jaxobs.certificates import AbstractCertificate
from jaxobs.designs.ladder import Rung
from jaxobs.plotting.style import BLUE, INK, NOTE, ORANGE, panel, root

ABSENT = ("no-gain", "no-hg-lmi", "undetectable", "frozen-instability", "switching-instability")


def proof_ladder(
    rungs: Sequence[Rung],
    *,
    at: float | None = None,
    absent: Mapping[str, AbstractCertificate] | None = None,
    title: str = "",
    ax: Any = None,
) -> Figure:
    """The gamma that each rung of `jaxobs.designs.ladder` certifies: from its infimum on (solid), not below (hatched),
    where that kind of proof has no answer, which never means "unstable". Slopes whose box does not hold 0 say nothing of
    larger gammas: there the infimum stands alone. A filled mark is a certificate at that gamma, verified now; an open one
    is a certificate that does not hold.

    rungs: what `ladder` returns. at: a gamma of interest [1/s], a line through all rungs. absent: {words: certificate} of
    what is proved not to exist (NoGain, NoHighGainLmi, FrozenInstability, ...), a row each; its verdict is taken now.
    ValueError for anything else.
    """
    if not len(rungs):
        raise refuse("plotting.proof_ladder", "rungs", "none", "one at least", "jaxobs.designs.ladder returns them.")
    for rung in rungs:
        require_instance("plotting.proof_ladder", "rungs", rung, Rung, "jaxobs.designs.ladder returns them.")
    if at is not None and not (np.isfinite(at) and at > 0):
        raise refuse("plotting.proof_ladder", "at", at, "a positive number", "It is a gain scale in 1/s.")
    none = dict(absent or {})
    for words, certificate in none.items():
        require_instance("plotting.proof_ladder", f"absent[{words!r}]", certificate, AbstractCertificate, "It proves absence.")
    known = [g for rung in rungs for g in (rung.smallest_gamma, rung.gamma) if g] + ([at] if at is not None else [])
    low, high = min(known, default=1.0) / 3, max(known, default=1.0) * 4
    total = len(rungs) + len(none)
    with panel("proof_ladder", ax, (9.2, 0.58 * total + 1.2)) as ax:
        for y, rung in zip(range(total, 0, -1), rungs, strict=False):
            _rung(ax, y, rung, low, high)
        for y, (_, certificate) in zip(range(len(none), 0, -1), none.items(), strict=True):
            _absent(ax, y, certificate, low, high)
        if at is not None:
            ax.axvline(at, color=ORANGE, lw=1.4, ls="--", zorder=4)
            ax.annotate(f"gamma = {at:.4g}", (at, 1), (0, 3), xycoords=("data", "axes fraction"), textcoords="offset points",
                        color=ORANGE, fontsize=NOTE, va="bottom", ha="center")  # fmt: skip
        names = [f"{rung.name}\n{rung.needs}" for rung in rungs] + [f"{words}\n{one.theorem}" for words, one in none.items()]
        ax.set_yticks(range(total, 0, -1), names, fontsize=NOTE)
        for place, text in enumerate(ax.get_yticklabels()):
            text.set_linespacing(1.35)
            text.set_color(INK if place < len(rungs) else ORANGE)
        ax.grid(axis="y", visible=False)
        ax.tick_params(axis="y", length=0)
        ax.set(xscale="log", xlim=(low, high), ylim=(0.4, total + 0.75), xlabel="gamma [1/s]")
        ax.set_title(title)
        ax.add_patch(Rectangle((0, 0), 0, 0, fc=BLUE, alpha=0.28, lw=0, label="certified from its infimum on"))
        ax.add_patch(Rectangle((0, 0), 0, 0, fc="none", ec="#d5d5d5", hatch="////", lw=0, label="no answer by this proof"))
        ax.plot([], [], "o", color=BLUE, mec="white", mew=0.8, ms=7.5, label="exact certificate")
        ax.legend(loc="upper center", bbox_to_anchor=(0.4, -0.75 / (0.58 * total + 0.4)), ncols=3)
        return root(ax)


HEIGHT = 0.42


def _rung(ax: Any, y: int, rung: Rung, low: float, high: float) -> None:
    smallest = rung.smallest_gamma
    if smallest is None:
        words = "not certified: not known here, or no gamma is"
        ax.add_patch(Rectangle((low, y - HEIGHT / 2), high - low, HEIGHT, fc="none", ec="#d5d5d5", hatch="////", lw=0))
        ax.text(np.sqrt(low * high), y, words, ha="center", va="center", fontsize=NOTE, color=INK, bbox=_box())
        return
    start = max(smallest, low)
    if smallest > low:
        ax.add_patch(Rectangle((low, y - HEIGHT / 2), start - low, HEIGHT, fc="none", ec="#d5d5d5", hatch="////", lw=0))
    if rung.upward:
        ax.add_patch(Rectangle((start, y - HEIGHT / 2), high - start, HEIGHT, fc=BLUE, alpha=0.28, lw=0))
    words = f"{smallest:.4g}" if smallest > 0 else "every gamma > 0" if rung.upward else "arbitrarily small ones"
    words += "" if rung.upward else ": of larger ones it does not tell"
    if smallest > 0:
        ax.plot([start, start], [y - HEIGHT / 2, y + HEIGHT / 2], color=BLUE, lw=2)
    ax.annotate(words, (start, y + HEIGHT / 2), (2, 2), textcoords="offset points", fontsize=NOTE, color=INK, va="bottom",
                bbox=_box(), zorder=4.5)  # fmt: skip
    if rung.gamma is not None and rung.certificate is not None:
        look = {"mec": "white", "mew": 0.8} if rung.certificate.verify() else {"mfc": "white", "mew": 1.6}
        ax.plot(rung.gamma, y, "o", color=BLUE, ms=7.5, zorder=5, **look)


def _absent(ax: Any, y: int, certificate: AbstractCertificate, low: float, high: float) -> None:
    verdict = certificate.verify()
    words = "proved absent" if certificate.theorem in ABSENT else "proved"
    if not verdict.holds:
        words = "not proved"
    ax.add_patch(Rectangle((low, y - HEIGHT / 2), high - low, HEIGHT, fc=ORANGE, alpha=0.14, lw=0))
    ax.plot(low * 1.12, y, "x" if verdict.holds else "_", color=ORANGE, ms=8, mew=2)
    ax.text(low * 1.3, y, words, ha="left", va="center", fontsize=NOTE, color=INK)


def _box() -> dict[str, Any]:
    return {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
