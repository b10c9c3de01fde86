"""The examples of paper 004: the printed gain and ours at the same bound, rate and relaxation."""

import dataclasses
import functools
from collections.abc import Callable, Iterator

import numpy as np

from jaxobs.bench.chain_table import Report
from jaxobs.bench.measures import worst_at_corners
from jaxobs.bench.rows import STEPS, Problem
from jaxobs.certificates import AbstractCertificate
from jaxobs.designs import H2, L2, Infeasible, corner_lmi, lpv_model, prove_level, synthesize
from jaxobs.designs.polytope import Polytope, as_tuples
from jaxobs.papers.p004 import duffing, invariant, joint
from jaxobs.papers.p004.paper import (
    DUFFING_GAIN,
    DUFFING_SLOPE,
    JOINT_GAIN,
    LORENZ_GAIN,
    duffing_model,
    joint_model,
    lorenz_midpoint,
    lorenz_plant,
)

INSIDE = 1e-3  # of the decay that one P proves, left as room for the exact proof
EDGE = 1e-2  # of the slope, to which the largest box of a printed gain is found


@dataclasses.dataclass(frozen=True)
class DmvtRow:
    """rate [1/s], for a step model the factor a step, None where nothing is proved; h2 = sqrt of the guaranteed bound on
    E |e|^2 and l2 the guaranteed gain from the energy of the noise to that of e, None where not proved; frozen = sqrt(E |e|^2)
    at the worst corner held constant. Unit noise in each output and, in continuous time, through B."""

    example: str
    bound: str
    method: str
    gain: tuple[tuple[float, ...], ...]
    norm: float
    rate: float | None
    h2: float | None
    l2: float | None
    frozen: float
    verdict: str
    is_step: bool = False
    certificates: tuple[AbstractCertificate, ...] = dataclasses.field(default=(), repr=False)


@functools.cache
def largest_joint_slope() -> float:
    """The largest 3 d^2 on whose box one P proves the printed gain of example 2, to EDGE."""
    return _edge(lambda slope: joint_model(float(np.sqrt(slope / 3))), JOINT_GAIN, 1.0, 27.0)


@functools.cache
def largest_duffing_slope() -> float:
    """The largest h on whose box [0, h] one P proves the printed gain of example 1, to EDGE."""
    return _edge(duffing_model, DUFFING_GAIN, 1.0, DUFFING_SLOPE)


def _edge(model: Callable[[float], Polytope], gain, low: float, high: float) -> float:
    """Between `low`, which is proved, and `high`, which is not."""
    while high - low > EDGE:
        middle = (low + high) / 2
        try:
            proved = bool(corner_lmi.prove(model(middle), np.array(gain)).verify())
        except Infeasible:
            proved = False
        low, high = (middle, high) if proved else (low, middle)
    return low


def dmvt_rows(*, short: bool = False, progress: Report = lambda what: None) -> Iterator[DmvtRow]:
    """Example by example, the printed gain first; short: one box of one of them."""
    for bound, slope in _joint_boxes(short):
        progress(f"flexible joint, {bound}")
        model = joint_model(float(np.sqrt(slope / 3)))
        yield from _continuous("flexible joint", bound, model, np.array(JOINT_GAIN), joint.printed_matrices()[1])
    for bound, slope in _duffing_boxes(short):
        progress(f"Duffing, {bound}")
        model, entry = duffing_model(slope), np.eye(2)[:, 1:]
        fallback = -max(duffing.frozen_growth(h) for h in np.linspace(0, slope, 41))
        yield from _continuous("Duffing", bound, model, np.array(DUFFING_GAIN), entry, fallback)
    if not short:
        progress("Lorenz")
        yield from _lorenz()


def _joint_boxes(short: bool) -> list[tuple[str, float]]:
    middle = ("3 d^2 <= 3, 1 rad", 3.0)
    if short:
        return [middle]
    rest, edge = 3 * joint.twist() ** 2, largest_joint_slope()
    return [(f"3 d^2 <= {rest:.3g}, from rest", rest), middle, (f"3 d^2 <= {edge:.4g}, the largest proved", edge)]


def _duffing_boxes(short: bool) -> list[tuple[str, float]]:
    if short:
        return []
    edge = 0.9 * largest_duffing_slope()
    return [(f"h in [0, {edge:.4g}]", edge), (f"h in [0, {DUFFING_SLOPE:g}], as printed", DUFFING_SLOPE)]


def _continuous(
    example: str, bound: str, model: Polytope, printed: np.ndarray, process: np.ndarray, fallback: float = 0.0
) -> Iterator[DmvtRow]:
    """The printed gain at its largest proved rate; ours, of least guaranteed H2 and of least L2, at that rate, or at `fallback`
    where the printed one proves none."""
    weights = {"weight": np.eye(model.n), "process": process, "noise": np.eye(model.p)}
    energy, origin = L2(**weights), f"assumed: {bound}"
    problem = Problem(example, model, H2(**weights), origin)
    first = _row(problem, bound, "printed", printed, None, energy)
    yield first
    asked = fallback if first.rate is None else first.rate
    for name, objective in (("H2", problem.objective), ("L2", energy)):
        try:
            found = synthesize(model, objective=objective, rate=asked, cover="corners", steps=STEPS, origin=origin)
        except Infeasible:
            continue
        yield _row(problem, bound, f"ours, least {name}", found.gain, asked, energy)


def _row(problem: Problem, bound: str, method: str, gain: np.ndarray, rate: float | None, energy: L2) -> DmvtRow:
    """What is proved of the gain at the rate, or at the largest one if None."""
    proofs = {}
    for name, objective in {"H2": problem.objective, "L2": energy}.items():
        options = {"objective": objective, "rate": rate, "cover": "corners", "origin": problem.origin}
        try:
            proofs[name] = prove_level(problem.model, gain, **options)
        except Infeasible:
            continue
        rate = proofs[name].rate
    h2 = float(np.sqrt(proofs["H2"].level)) if "H2" in proofs else None
    l2 = float(proofs["L2"].level) if "L2" in proofs else None
    frozen = float(np.sqrt(worst_at_corners(problem.model, gain, *problem.factors)))
    verified = bool(proofs) and all(proof.verify() for proof in proofs.values())
    norm, verdict, own = float(np.linalg.norm(gain)), "verified" if verified else "not certified", as_tuples(gain)
    proved = rate if proofs else None
    return DmvtRow(problem.name, bound, method, own, norm, proved, h2, l2, frozen, verdict, False, tuple(proofs.values()))


def _lorenz() -> Iterator[DmvtRow]:
    """The Euler map on a box that it never leaves, midpoint split: the factor a step, and the noise at frozen corners."""
    model, printed = lpv_model(lorenz_plant(), lorenz_midpoint(*invariant.BOX)), np.array(LORENZ_GAIN)
    factor = 1 - (1 - corner_lmi.largest_rate(model, printed, step=True)) * (1 - INSIDE)
    low, high = (np.array(side) for side in invariant.BOX)
    bound = f"|x1|, |x2| <= {high[0]:g}, x3 in [{low[2]:g}, {high[2]:g}], proved invariant"
    proofs = {
        "printed": corner_lmi.prove(model, printed, rate=factor, step=True, origin=bound),
        "ours, quietest": corner_lmi.synthesise(model, rate=factor, step=True, origin=bound)[1],
    }
    for method, proof in proofs.items():
        gain = np.array(proof.gain)
        frozen = np.sqrt(worst_at_corners(model, gain, np.eye(3), np.zeros((3, 1)), np.eye(1), step=True))
        verdict = "verified" if proof.verify() else "not certified"
        norm = float(np.linalg.norm(gain))
        yield DmvtRow(
            "Lorenz, Euler", bound, method, proof.gain, norm, factor, None, None, float(frozen), verdict, True, (proof,)
        )
