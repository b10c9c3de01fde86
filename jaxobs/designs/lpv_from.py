"""From a system and a set of states to the error dynamics of its observer, with proved bounds on every parameter.

By the mean value theorem in integral form f(x) - f(z) = J (x - z), J the mean of df/dx between z and x. If on a convex set

    df/dx = J_0 + sum_k h_k(x, u) M_k,      lower_k <= h_k <= upper_k,      M_k = b_k c_k', or a sum of such,

then J has this form too, with means of the h_k in the same intervals: the corners are those of the h_k, not of the entries (4
in place of 16 for the flexible joint). Source: paper 004, (2), (5), (11); for bounds Moore, Kearfott and Cloud, 2009.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse
from jaxobs.designs._factor import factor, separate
from jaxobs.designs._parameters import Bounded, bounded
from jaxobs.designs._system import System, system
from jaxobs.designs.polytope import Polytope
from jaxobs.designs.sets import AbstractSet, Around, Box
from jaxobs.intervals import Interval, graph, require_derivatives
from jaxobs.intervals.interval import whole
from jaxobs.intervals.jacobian import assumptions
from jaxobs.plants import Discretised, Saturated

WAYS = {"auto": factor, "entries": separate}


@dataclasses.dataclass(frozen=True)
class Lpv:
    """model: the error dynamics; origin: what its bounds stand on, the sentence that certificates of it carry.

    parameters: the formula and the interval of each, in the order of the numbers in model.tied. gap: how far the bounds are, at
    most, from values that are attained, relative to the largest. conditional: whether the sentence assumes anything about where
    the state and its estimate are. step: whether the model is of e+, not of e'. boxes: how many were evaluated.
    """

    model: Polytope
    origin: str
    parameters: tuple[str, ...]
    gap: float
    conditional: bool
    step: bool
    boxes: int


def lpv_from(
    f: Any,
    C: Any,
    box: AbstractSet | tuple[Any, Any],
    channels: str = "auto",
    *,
    inputs: Any = None,
    rtol: float = 1e-6,
    max_boxes: int = 20_000,
    room: float = 0.0,
) -> Lpv:
    """e' = (J_0 + sum_k h_k(t) M_k - L C) e for x' = f, y = C x, with proved bounds on every h_k; the same of e+ for x+ = f.

    f: a plant, or a function f(x), or f(x, u). C (p, n): the output matrix; None for the plant's own, which has to be linear.
    box: (lower, upper), or a set of `jaxobs.designs.sets`, whose proof is repeated. inputs: (lower, upper) of u; unbounded for
    plants if not given. channels: "auto" factors the Jacobian: proportional entries, or all that contain a term, share one
    parameter, whichever makes fewer; "entries" bounds every entry by itself. rtol, max_boxes: as for `jacobian_bounds`.
    room: widens each interval by this share of its width on both sides, so that cruder arithmetic can prove it again
    (`certificates.with_bounds`).

    ValueError for a parameter that nothing bounds, with its formula; for an output that is not linear; for a set whose proof
    fails; for `Saturated` plants, whose bounds `proved_channels` gives. UnknownPrimitiveError for what has no formula here.
    """
    domain, way = as_set(box), way_of("lpv_from", channels)
    if isinstance(f.plant if isinstance(f, Discretised) else f, Saturated):
        fix = "lpv_model(plant, proved_channels(plant, box)), or lpv_lmi(plant, bounds=proved_channels(plant, box))."
        raise refuse("lpv_from", "f", "a Saturated plant", "one whose f is saturated nowhere", fix)
    made, n = system("lpv_from", f, inputs), len(domain.lower)
    require_proof("lpv_from", domain)
    t, low, high, names = domain.coordinates
    jacobian = derivative(made, n, t)
    jacobian.graph.variables = (*names, *made.names)
    if jacobian.outputs.shape != (n, n):
        fix = "x' = f(x) has as many components as x; give the box of x, (n,)."
        raise refuse("lpv_from", "f", f"a Jacobian of shape {jacobian.outputs.shape}", f"{(n, n)}", fix)
    z = Interval(np.append(low, made.lower), np.append(high, made.upper))
    found = bounded(jacobian, way, z, rtol=rtol, max_boxes=max_boxes)
    require_bounded("lpv_from", found, domain, made)
    if room:
        wider = room * (found.upper - found.lower)
        found = dataclasses.replace(found, lower=found.lower - wider, upper=found.upper + wider)
    left, right, numbers = found.arrays()
    ends = found.lower[numbers], found.upper[numbers]
    model = Polytope(found.constant(), left, right, *ends, _output(made, C, n), tuple(numbers))
    taken = assumptions(lambda z: made.f(jnp.asarray(t, z.dtype) @ z[:n], z[n:]), z)
    origin = sentence(domain, made, found, taken)
    return Lpv(model, origin, found.texts(), found.gap, domain.assumed or domain.bounded, made.step, found.boxes)


def as_set(box: Any) -> AbstractSet:
    """The set that was given, or the box of a pair (lower, upper)."""
    return box if isinstance(box, AbstractSet) else Box(*box)


def way_of(owner: str, channels: str) -> Any:
    """By name; ValueError for another one."""
    if channels not in WAYS:
        fix = "'auto' finds what the entries share; 'entries' does not look."
        raise refuse(owner, "channels", repr(channels), f"one of {sorted(WAYS)}", fix)
    return WAYS[channels]


def derivative(made: System, n: int, t: np.ndarray | None = None, name: str = "f") -> graph.Formulas:
    """The exact formulas of df/dx at x = t z, in the variables z and w; t = I if not given. name: what errors call f."""
    m, own = len(made.lower), t is None or np.array_equal(t, np.eye(n))
    require_derivatives("lpv_from", made.f, n, m, name=name)

    def slopes(z, w):
        return jax.jacfwd(made.f)(z if own else jnp.asarray(t, z.dtype) @ z, w)

    return graph.trace(slopes, n, m) if m else graph.trace(lambda z: slopes(z, z[:0]), n)


def require_proof(owner: str, domain: AbstractSet) -> None:
    """ValueError for a set whose proof, repeated here, fails."""
    verdict = domain.verify()
    if not verdict:
        fix = "Choose another level or box; without a proof Box(lower, upper) states it as an assumption."
        raise refuse(owner, "box", f"a set whose proof fails: {verdict.why}", "a set that verifies", fix)


def require_bounded(owner: str, found: Bounded, domain: AbstractSet, made: System) -> None:
    """ValueError, with its formula, for the first parameter that nothing bounds."""
    free = np.flatnonzero(~(np.isfinite(found.lower) & np.isfinite(found.upper)))
    if not free.size:
        return
    k = int(free[0])
    i, j = min(found.parameters[k].matrix)
    given = f"nothing bounds df{i + 1}/dx{j + 1}: {found.formulas[k]} in [{found.lower[k]:.6g}, {found.upper[k]:.6g}]"
    fix = (
        "Take a smaller box, an invariant or absorbing set, or saturate f (plants.Saturated) on one; "
        "bound the inputs by inputs=(lower, upper)."
    )
    raise refuse(owner, "box", given, "a box on which every parameter is bounded", fix)


def sentence(domain: AbstractSet, made: System, found: Bounded, taken: tuple[str, ...], estimate: str | None = None) -> str:
    """What the bounds stand on, as one sentence of a certificate's assumptions. estimate: where it is, if not in the set."""
    parts = [domain.state]
    if estimate is not None:
        parts.append(estimate)
    elif domain.bounded and not isinstance(domain, Around):
        parts.append("conditional on its estimate staying there too")
    ends = zip(made.names, made.lower.tolist(), made.upper.tolist(), strict=True)
    parts += [f"{name} in [{low:.17g}, {high:.17g}]" for name, low, high in ends if np.isfinite(low) and np.isfinite(high)]
    attained = f"attained to {found.gap:.2g} of the largest value" if np.isfinite(found.gap) else "not known to be attained"
    parts.append(
        f"there the parameters {'; '.join(found.formulas) or '(none)'} are within their bounds, by interval arithmetic"
        f" ({found.boxes} boxes; {attained})"
    )
    if lost := found.rounding():
        parts.append(f"coefficients rounded to floats, which changes entries by at most {lost:.2g}")
    return "; ".join([*parts, *(f"assumed: {one}" for one in taken)])


def _output(made: System, given: Any, n: int) -> np.ndarray:
    if given is not None:
        matrix = np.asarray(given, float)
        if matrix.ndim != 2 or matrix.shape[1] != n:
            fix = f"One row an output: {[[1.0] + [0.0] * (n - 1)]} for y = x_1."
            raise refuse("lpv_from", "C", f"shape {matrix.shape}", f"shape (p, {n})", fix)
        return matrix
    if made.h is None:
        raise refuse("lpv_from", "C", "None, with a function f", "a matrix (p, n)", "A function knows no output.")
    h = made.h
    slopes = derivative(dataclasses.replace(made, f=h), n, name="h")
    if taken := assumptions(lambda z: h(z[:n], z[n:]), whole((n + len(made.lower),))):
        given = f"an output that is not smooth; {'; '.join(taken)}"
        fix = "A sensor that rounds or switches has no slope: give C and count its steps as noise."
        raise refuse("lpv_from", "C", given, "an output that is linear in x", fix)
    table = np.empty(slopes.outputs.shape)
    for place, e in np.ndenumerate(slopes.outputs):
        if not e.is_constant:
            given = f"dy{place[0] + 1}/dx{place[1] + 1} = {slopes.graph.text(e)}"
            fix = "Choose coordinates in which y is linear in x, or give C and inject y elsewhere yourself."
            raise refuse("lpv_from", "C", given, "an output that is linear in x", fix)
        table[place] = float(e.constant)
    return table
