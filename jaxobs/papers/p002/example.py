"""Section IV, what it says around table I."""

import functools
import itertools

import numpy as np

from jaxobs.designs import chain_lmi
from jaxobs.designs.high_gain_lmi import high_gain_lmi
from jaxobs.papers.claims import Bound, Statement
from jaxobs.papers.p002 import shared
from jaxobs.papers.p002.paper import PAPER, TABLE, N

RATE = 0.2  # 1/s, at which designs are compared


def _constant(j0: int, printed: str) -> None:
    @PAPER.claim(f"k_{j0} at k_f = 1", "bound", printed=printed)
    def _():
        sharp = chain_lmi.gain_constant(shared.bounds(1), j0)
        theta = float(shared.row(j0, 1).theta)
        why = (
            "k_f (5 - j0)/5 is what the triangle inequality gives: valid. Sharp for all theta >= 1: k_f sqrt(5 - j0)/5 = "
            f"{sharp:.6g}; at the printed theta = {theta}: {chain_lmi.gain_constant(shared.bounds(1), j0, theta):.6g}"
        )
        return Bound(sharp, "upper", why)


for _j0, _printed in ((1, "0.8"), (2, "0.6"), (3, "0.4")):
    _constant(_j0, _printed)


@PAPER.claim("the standard gain is independent of j0", "identity", printed="SAME RESULT: INDEPENDENT OF j0")
def _():
    gain, theta = shared.row(0, 1).gain, shared.needed(shared.row(0, 1)).theta
    spread = [
        chain_lmi.largest_lambda(chain_lmi.corners(shared.bounds(1), 0, s), np.array(gain)).attained for s in (1.0, theta)
    ]
    return Statement(bool(spread[0] == spread[1]), theta, "(15) holds neither sigma nor j0 nor k_f")


@PAPER.claim("HG/LMI gains are smaller", "universal", printed="smaller than those of the standard observer")
def _():
    ratios = [float(np.max(shared.gain(one) / shared.gain(shared.row(0, one.k_f)))) for one in TABLE if one.j0]
    why = f"entry by entry of L = T(theta) K, all nine rows: at most {max(ratios):.3g} of the standard gain"
    return Statement(bool(max(ratios) < 1), max(ratios), why)


@PAPER.claim("31.72 -> 5.25, like for like", "universal", printed="theta is reduced significantly")
def _():
    printed = float(shared.row(0, 1).theta) / float(shared.row(1, 1).theta)
    same = [shared.needed(shared.row(j0, 1), sharp=True).theta for j0 in (0, 1)]
    best = [shared.smallest(shared.row(j0, 1), sharp=True).theta for j0 in (0, 1)]
    why = (
        f"printed: a factor {printed:.3g}; with the sharp constants for both and all corners {same[0]:.4g} "
        f"-> {same[1]:.4g} for the printed K, {best[0]:.4g} -> {best[1]:.4g} for the best: the reduction "
        "is real, a good part of its size is the loose k_f"
    )
    return Statement(bool(same[1] < same[0] and best[1] < best[0]), same[0] / same[1], why)


@PAPER.claim("273.03 -> 17.63, like for like", "universal", printed="theta is reduced significantly")
def _():
    printed = float(shared.row(0, 10).theta) / float(shared.row(1, 10).theta)
    same = [shared.needed(shared.row(j0, 10), sharp=True).theta for j0 in (0, 1)]
    why = (
        f"printed: a factor {printed:.3g}; with the sharp constants and all corners {same[0]:.4g} -> {same[1]:.4g} for the "
        "printed K"
    )
    return Statement(bool(same[1] < same[0]), same[0] / same[1], why)


@functools.cache
def _equal_rate() -> tuple[float, ...]:
    """|L| of the designs with j0 = 0..5, k_f = 1, all proved at RATE."""
    designs = [high_gain_lmi(shared.plant(), bounds=shared.bounds(1), j0=j0, rate=RATE)[1] for j0 in range(N + 1)]
    return tuple(float(np.linalg.norm(proof.gain)) for proof in designs)


@PAPER.claim("more LMIs, smaller gain", "universal", printed="j0 = 2, 3 reduce it further", long=True)
def _():
    sizes, thetas = _equal_rate(), [shared.smallest(shared.row(j0, 1), sharp=True).theta for j0 in range(4)]
    why = (
        f"smallest theta with sharp constants for j0 = 0..3: {', '.join(f'{t:.4g}' for t in thetas)}; |L| of our designs at an "
        f"equal proved rate of {RATE} /s, j0 = 0..5: {', '.join(f'{s:.4g}' for s in sizes)}"
    )
    return Statement(all(a > b for a, b in itertools.pairwise(thetas)), thetas[-1], why)


@PAPER.claim("LPV/LMI (j0 = 5) gives lower gains", "universal", printed="lower observer gains", long=True)
def _():
    sizes = _equal_rate()
    why = (
        f"its feasible set is the largest; |L| at an equal proved rate of {RATE} /s: {sizes[-1]:.4g}, against "
        f"{min(sizes[:-1]):.4g} for the best j0 < 5 of the same design rule (smallest K'PK at the theta the rule takes)"
    )
    return Statement(True if sizes[-1] < min(sizes[:-1]) else None, sizes[-1], why)


@PAPER.claim("32 LMIs can be infeasible", "universal", printed="can lead to infeasible LMIs", long=True)
def _():
    proofs = [shared.at_one(k_f) for k_f in (1, 10, 100)]
    why = (
        "said of numerical solving, and for higher dimensions, which is not tried here: open. The inequalities themselves "
        "always have a solution: at j0 = n they have one for one sigma iff for all; exact certificates at sigma = 1 for "
        f"k_f = 1, 10, 100: {sum(bool(p.verify()) for p in proofs)} of {len(proofs)} (solved at a larger sigma, then rescaled)"
    )
    return Statement(None, float(len(proofs)), why)
