"""One gain and one quadratic Lyapunov function for all corners of a polytope, at a required rate: found, then proved.

The inequalities are solved in coordinates in which the last P is the identity, from an easy rate to the required one (_frame,
_climb); what comes out is accepted by the exact check alone. At every corner F_c = a + sum_k rho_k b_k c_k' - L output,

    P > 0,      F_c'P + P F_c + 2 rate P < 0,      or for step models      F_c'P F_c < factor^2 P.

Source: papers 002, (31) at j0 = n, and 004, (7), (12), (16); Boyd, El Ghaoui, Feron and Balakrishnan, Linear Matrix
Inequalities in System and Control Theory, 1994, chapters 5 and 6 (polytopic inclusions) and section 7.2 (Y' = P L).
"""

from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import Corners, StepCorners
from jaxobs.designs._climb import Climb, climb
from jaxobs.designs._frame import CONDITION, frame, in_frame, quietest
from jaxobs.designs.detectability import undetectable
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.no_gain import no_gain
from jaxobs.designs.polytope import Polytope, as_tuples

REPEATS = 5  # of the search for the quietest gain


def prove(
    model: Polytope, gain: np.ndarray, *, rate: float | None = None, step: bool = False, origin: str = "given"
) -> Corners | StepCorners:
    """The exact certificate that a given gain makes the error decay at `rate`: P > 0 with, at all corners F_c = A_c - L output,

        F_c'P + P F_c + 2 rate P < 0,      or for step models      F_c'P F_c < rate^2 P.

    gain L (n, p). rate [1/s] >= 0, 0 if not given; for step models the factor a step, in ]0, 1], 1 if not given. origin: where
    the bounds come from, a sentence.

    Infeasible if no P is found that passes the exact check; its `best` is the largest rate (the least factor) that the search
    reached, None if none, its `certificate` the exact proof that no P exists (NoGain), where one is found. ValueError for a
    gain of another shape and a rate outside these ranges. Source: papers 002, (31) at j0 = n, and 004, (7), (12), (16); Boyd et
    al., 1994, section 5.1.
    """
    gain = np.asarray(gain, float)
    model.closed(gain)
    rate = _checked("prove", rate, step)
    start = frame(model, step=step, gain=gain)
    way = climb(start, start.kappa(rate), gain)
    if way.found is not None and way.kappa >= start.kappa(rate):
        for place, found in _recentred(way, gain):
            certificate = _certificate(model, gain, place.lyapunov(found.values["p"]), rate, step, origin)
            if certificate.verify():
                return certificate
    raise _infeasible(way, model, gain, rate, step, "this gain")


def synthesise(
    model: Polytope,
    *,
    rate: float | None = None,
    step: bool = False,
    process: Any = None,
    noise: Any = None,
    refinements: int = REPEATS,
    origin: str = "given",
) -> tuple[np.ndarray, Corners | StepCorners]:
    """A gain L (n, p) and the certificate that the error decays at `rate` (as in `prove`) for all parameters in the box:

        min tr(P process) + tr(L'P L noise):   P > 0,   P F_c + F_c'P + 2 rate P < 0,   P F_c + F_c'P + I < 0 at all corners,

    or for step models F_c'P F_c < rate^2 P and F_c'P F_c - P + I < 0; unknowns P and Y' = P L. The objective bounds the error's
    variance E |e|^2 under white process and measurement noise of these intensities (n, n) and (p, p), identities if not given;
    it is lowered in a few programs, each in the coordinates of the last P: at most `refinements`, the long part of the work;
    with 0 the first gain is returned that is certified. Of more than 16 corners only those are imposed that would be violated.

    Infeasible as in `prove`, if no gain within reach has such a P. ValueError for a rate as in `prove`. Source:
    papers 002, (31) at j0 = n, and 004, (7), (12), (16); Boyd et al., 1994, sections 5.1, 6.2 (output energy), 7.2 (Y' = P L).
    """
    rate = _checked("synthesise", rate, step)
    process, noise = (
        np.eye(size) if one is None else np.asarray(one, float) for one, size in ((process, model.n), (noise, model.p))
    )
    start = frame(model, step=step)
    target = start.kappa(rate)
    way = climb(start, target, None)
    if way.found is None or way.kappa < target:
        raise _infeasible(way, model, None, rate, step, "any gain within reach")
    place, cost, best = way.place.centred(way.found.values["p"]), np.inf, None
    for _ in range(refinements):
        found = quietest(place, target, *in_frame(place, process, noise))
        if not found.values or np.linalg.eigvalsh(found.values["p"])[0] <= 0:
            break
        proved = _proved(model, place, found, rate, step, origin)
        place = place.centred(found.values["p"])
        if proved is not None and -found.value < cost:
            gained, cost, best = 1 + found.value / cost, -found.value, proved
            if gained < 0.02:
                break
    best = best or _proved(model, way.place, way.found, rate, step, origin)
    if best is None:
        raise _infeasible(way, model, None, rate, step, "any gain tried, in floats that pass the exact check,")
    return best


def _proved(model, place, found, rate, step, origin) -> tuple[np.ndarray, Corners | StepCorners] | None:
    """With the P that came with the gain, or one found for it afterwards."""
    gain = place.gain(found.values["p"], found.values["y"])
    certificate = _certificate(model, gain, place.lyapunov(found.values["p"]), rate, step, origin)
    if certificate.verify():
        return gain, certificate
    try:
        return gain, prove(model, gain, rate=rate, step=step, origin=origin)
    except Infeasible:
        return None


def largest_rate(model: Polytope, gain: np.ndarray | None = None, *, step: bool = False, rtol: float = 1e-4) -> float:
    """The supremum of the rates [1/s] that one P proves for this gain, or for any gain within reach:

        sup {rate: some P > 0 has F_c'P + P F_c + 2 rate P < 0 at all corners F_c = A_c - L output},

    and for step models the infimum of the factors a step with F_c'P F_c < factor^2 P. Infinite (0) if a high gain does all that
    were tried. Negative rates (factors above 1) are answers too; -inf (inf) if the search finds none. In floats, to rtol.

    gain L (n, p), or None for any. ValueError for a gain of another shape. Source: as for `prove`; a generalised eigenvalue
    problem, Boyd et al., 1994, section 5.1.
    """
    if gain is not None:
        model.closed(gain)
    gain = None if gain is None else np.asarray(gain, float)
    way = climb(frame(model, step=step, gain=gain), np.inf, gain, rtol=rtol)
    return way.place.rate(way.kappa)


def _checked(owner: str, rate: float | None, step: bool) -> float:
    if rate is None:
        return 1.0 if step else 0.0
    if not (isinstance(rate, (int, float, np.number)) and np.isfinite(rate) and (0 < rate <= 1 if step else rate >= 0)):
        expected = "a factor in ]0, 1], the error's decay a step" if step else "a number >= 0, the error's decay in 1/s"
        raise refuse(owner, "rate", repr(rate), expected, "Leave it out to ask for decay alone.")
    return float(rate)


def _recentred(way: Climb, gain: np.ndarray):
    """The P that was found, then those found again in its own coordinates."""
    place, found = way.place, way.found
    assert found is not None
    yield place, found
    for _ in range(3):
        place = place.centred(found.values["p"])
        found = place.solve(way.kappa, gain)
        if found.margin <= 0:
            return
        yield place, found


def _certificate(model, gain, p, rate, step, origin) -> Corners | StepCorners:
    fields = model.fields() | {"gain": as_tuples(gain), "p": as_tuples(p), "origin": origin}
    return StepCorners(**fields, factor=rate) if step else Corners(**fields, rate=rate)


def _infeasible(way: Climb, model: Polytope, gain: np.ndarray | None, rate: float, step: bool, what: str) -> Infeasible:
    best = None if way.found is None else way.place.rate(way.kappa)
    place = way.place if way.found is None else way.place.centred(way.found.values["p"])
    refutation = place.refute(place.kappa(rate), gain)
    kind = "factor a step" if step else "decay rate"
    reason = f"no P was found that proves the {kind} {rate:.6g} of {what} at all corners"
    certificate = no_gain(model, gain, rate=rate, step=step)
    blind = undetectable(model, rate=rate, step=step) if gain is None and certificate is None else None
    if certificate is not None:
        reason += f", and none exists: {len(certificate.points)} parameters exclude it, in exact arithmetic"
    elif blind is not None:
        reason += f", and none exists: {blind}"
        certificate = blind.certificate
    elif refutation.is_infeasible:
        gains = "" if gain is not None else f", and P L up to {CONDITION:.0e} lambda_min(P),"
        reason += f", and by duality none exists with a condition number up to {CONDITION:.0e}{gains}"
        reason += " in the coordinates of the last P"
    change = "Nothing is proved at any rate: narrow the bounds, or add an output."
    if best is not None:
        change = f"The best {kind} proved on the way is {best:.6g}; ask for less, or narrow the bounds."
    tried = (f"{way.solves} inequalities, each in the coordinates of the last P",)
    return Infeasible(reason, refutation.bound, change, best=best, tried=tried, certificate=certificate)
