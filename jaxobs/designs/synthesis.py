"""Gains that are good at something under a proved decay rate, with one Lyapunov matrix for the rate and another for the level.

    min level(L):   some P > 0 has F(rho)'P + P F(rho) + 2 rate P < 0, and some Q bounds the level, for all rho in the box.

The problem is not convex in (P, Q, L). It is descended upon from several starts, among them the seed and the best gain with P
= Q (which is convex), by small convex programs (_descent); what comes out is accepted by the exact check alone.
"""

import dataclasses
import time
from typing import Any

import numpy as np

from jaxobs._module import refuse, require_instance
from jaxobs.certificates import AbstractCertificate
from jaxobs.designs._descent import Point, descend, judged, single
from jaxobs.designs._dynamics import Dynamics
from jaxobs.designs._proofs import certified
from jaxobs.designs._rates import Proof, fastest
from jaxobs.designs._starts import first
from jaxobs.designs.covers import Corners, Cover, Multiplier, cover_of
from jaxobs.designs.detectability import undetectable
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.objectives import H2, L2, Gain, Objective, dynamics, require_independent
from jaxobs.designs.polytope import Polytope

TURNS = 4  # between the forms of a level, while it falls


@dataclasses.dataclass(frozen=True, eq=False)
class Synthesis:
    """gain L (n, p); inner K (r, p), None unless asked for; rate [1/s], as required; level: what is guaranteed (H2: the mean of
    |E e|^2; L2: the energy gain; Gain: |L|), by `certificate`, exact, of rate and level. seed_level: that of the seed at the
    same rate, None if there was none or it does not prove the rate. history: the levels on the way, falling. starts: the level
    reached from each start. solves, seconds: semidefinite programs of the descent, and the time of it all."""

    gain: np.ndarray
    inner: np.ndarray | None
    rate: float
    level: float
    certificate: AbstractCertificate
    seed_level: float | None
    history: tuple[float, ...]
    starts: dict[str, float]
    solves: int
    seconds: float
    objective: Objective

    @property
    def norm(self) -> float:
        """The level as a norm: sqrt(level) for H2, the level itself otherwise."""
        return float(np.sqrt(self.level)) if isinstance(self.objective, H2) else self.level


def synthesize(
    lpv: Polytope,
    *,
    objective: Objective | None = None,
    rate: float = 0.0,
    cover: Cover = "lazy",
    seed: Any = None,
    inner: bool = False,
    steps: int = 150,
    origin: str = "given",
) -> Synthesis:
    """min level(L):   P > 0, P F + F'P + 2 rate P < 0, and Q as in the objective, for all rho in the box, P and Q separate.

    lpv: the error dynamics e' = (a + sum_k rho_k b_k c_k' - L output) e, its bounds with their `origin`. objective: H2 (the
    default; with inner it is Gain), L2 or Gain. rate [1/s] >= 0. cover: how all rho are covered, see `covers`: "lazy" and
    "corners" are exact, "multiplier" is the fastest. seed: a gain (n, p) to start from and never to be worse than. inner:
    design K (r, p) of f(xhat + K (y - C xhat)) too, see `circle`. steps: convex programs a descent may take.

    Infeasible if no gain is found that proves the rate; its `best` is the largest rate found. ValueError for bad arguments.
    Source: Boyd, El Ghaoui, Feron and Balakrishnan, 1994, chapters 5 to 7; sequential convex programming for bilinear matrix
    inequalities: Dinh, Gumussoy, Michiels and Diehl, IEEE TAC 57 (2012).
    """
    started = time.perf_counter()
    default = Gain() if inner else H2()
    objective = default if objective is None else objective
    require_instance("synthesize", "lpv", lpv, Polytope, "Make it with jaxobs.designs.lpv_model(plant, channels).")
    require_instance("synthesize", "objective", objective, H2 | L2 | Gain, "For instance H2(process=..., noise=...).")
    if not (isinstance(rate, (int, float, np.number)) and np.isfinite(rate) and rate >= 0):
        raise refuse("synthesize", "rate", repr(rate), "a number >= 0, in 1/s", "Leave it out to ask for decay alone.")
    cover_ = cover_of("synthesize", lpv, cover)
    forms = getattr(objective, "forms", ())
    if inner:
        require_independent("synthesize", objective)
        forms = tuple(form for form in forms if form != "energy")
    zero = dynamics("synthesize", lpv, np.zeros((lpv.n, lpv.p)), None, objective)
    points: dict[str, Point] = {}
    if seed is not None:
        given = dynamics("synthesize", lpv, np.asarray(seed, float), None, objective)
        proof = fastest(given, cover_)
        if proof.rate >= rate and (point := judged(proof, forms, cover_)) is not None:
            points["seed"] = point
    seed_level = points["seed"].value if points else None
    starts = {"one matrix": first(zero, cover_, rate)} | ({"circle": _circle(zero, cover_, rate)} if inner else {})
    for name, proof in starts.items():
        if proof.rate >= rate:
            point = judged(single(proof, rate, cover_), forms, cover_) or judged(proof, forms, cover_)
            points |= {} if point is None else {name: point}
    if not points:
        raise _infeasible(lpv, rate, max(proof.rate for proof in starts.values()), cover, inner)
    ends = {name: _turns(point, rate, cover_, forms, inner, steps) for name, point in points.items()}
    certificate, final = _certified([*points.values(), *(end for end, _, _ in ends.values())], rate, cover, origin)
    _, history, _ = min(ends.values(), key=lambda one: one[0].value)
    return Synthesis(
        gain=final.proof.d.gain,
        inner=final.proof.d.inner if inner else None,
        rate=float(rate),
        level=final.value,
        certificate=certificate,
        seed_level=seed_level,
        history=tuple(history),
        starts={name: end.value for name, (end, _, _) in ends.items()},
        solves=sum(count for _, _, count in ends.values()),
        seconds=time.perf_counter() - started,
        objective=objective,
    )


def sweep(lpv: Polytope, rates: Any, **options: Any) -> tuple[Synthesis, ...]:
    """`synthesize` at each of the rates, in their order, each seeded by the gain of the next faster one, which proves its rate
    too: the levels fall with the rate. options: those of `synthesize`, but rate and seed (a seed is for the fastest)."""
    found: dict[float, Synthesis] = {}
    seed = options.pop("seed", None)
    for rate in sorted({float(rate) for rate in rates}, reverse=True):
        found[rate] = synthesize(lpv, rate=rate, seed=seed, **options)
        seed = found[rate].gain
    return tuple(found[float(rate)] for rate in rates)


def _circle(zero: Dynamics, cover: Corners | Multiplier, rate: float) -> Proof:
    """The fastest L and K by the multiplier inequality, of that K what f(xhat + K_x (y - C xhat)) can have."""
    found = fastest(zero, Multiplier(zero.model), circle=True, target=rate).d
    units = zero.injections()
    realised = zero.with_gains(found.gain, np.einsum("irp,rp,isq->sq", units, found.inner, units))
    return fastest(realised, cover, target=rate)


def _certified(points: list[Point], rate: float, cover: str, origin: str) -> tuple[AbstractCertificate, Point]:
    """The lowest level that passes the exact check."""
    found, refused = None, None
    for point in sorted(points, key=lambda one: one.value):
        if found is not None and found[1].value <= point.value:
            break
        try:
            new = certified(point, rate, cover, origin)
        except Infeasible as error:
            refused = error
            continue
        found = new if found is None or new[1].value < found[1].value else found
    if found is None:
        assert refused is not None
        raise refused
    return found


def _infeasible(lpv: Polytope, rate: float, best: float, cover: str, inner: bool) -> Infeasible:
    """Why there is nothing to start from: an undetectable point, if there is one."""
    tried = (f"cover {cover}", "high gains", "the fastest gain", *(("inner injection",) if inner else ()))
    if best >= rate:
        change = "Give noises and weights of moderate size, in units in which the states are alike."
        return Infeasible("the rate is proved, but no solver found a level for it", 0.0, change, best=best, tried=tried)
    seen = undetectable(lpv, rate=float(rate))
    if seen is not None:
        change = "No gain moves this mode: measure something else, or give bounds that exclude the point."
        return Infeasible(str(seen), best - rate, change, tried=tried, certificate=seen.certificate)
    reason = f"no gain was found for which one P proves the decay rate {rate:.6g} 1/s for all parameters"
    change = "Ask for less, or narrow the bounds." if best > 0 else "Narrow the bounds, or add an output."
    change += "" if inner else " inner=True corrects the nonlinearity by the measurement as well."
    return Infeasible(reason, best - rate, change, best=best if best > 0 else None, tried=tried)


def _turns(
    point: Point, rate: float, cover, forms: tuple[str, ...], circle: bool, steps: int
) -> tuple[Point, list[float], int]:
    """Descents, each at the form that is the better one where the last ended, until that changes nothing."""
    point, levels, solves = descend(point, rate, cover, circle=circle, steps=steps)
    for _ in range(TURNS if len(forms) > 1 else 0):
        other = judged(point.proof, tuple(form for form in forms if point.level and form != point.level.form), cover)
        if other is None or other.value > point.value * 1.05:
            break
        end, more, count = descend(other, rate, cover, circle=circle, steps=steps)
        solves += count
        if end.value > point.value * (1 - 1e-4):
            break
        point, levels = end, levels + [one for one in more if one < levels[-1]]
    return point, levels, solves
