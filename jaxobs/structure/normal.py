"""The normal form of a plant in a region, and the slopes that its designs ask for."""

import dataclasses
import math
import textwrap
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import Numbers, dtype_of, refuse, require_instance
from jaxobs.intervals import Interval, UnknownPrimitiveError, require_derivatives, trace, whole
from jaxobs.plants import AbstractFlowPlant, AbstractNormalForm, NormalChain, NormalTriangular
from jaxobs.structure._box import Sides, box_of
from jaxobs.structure.algebra import adjugate, determinant, enclosed_inverse
from jaxobs.structure.observability import observability
from jaxobs.structure.pattern import exact

SAMPLES = 2000
ROUNDS, MOST = 5, 40_000  # of cutting boxes again, and how many there may be
LEFT, RIGHT = slice(None, -1), slice(1, None)


def normal_form(
    plant: AbstractFlowPlant, *, states: Any, inputs: Any = None, start: Numbers | None = None, count: int = 256
) -> NormalChain | NormalTriangular:
    """The plant in z = (h, L_f h, ..., L_f^{n-1} h): a chain where the input enters y^(n) first, or there is none; triangular
    where the plant is observable for every input.

    states, inputs: (lower, upper), finite, where it shall be used. start (n,): where the inverse begins, the middle of the
    box if not given. count: points at which rank and pattern are looked at; `observability` says what of it is proved.

    ValueError where Phi loses rank at one of the points, with the point; where no input enters as the forms ask; for several
    outputs. Source: Gauthier, Hammouri and Othman, 1992.
    """
    require_instance("normal_form", "plant", plant, AbstractFlowPlant, "Normal forms are those of x' = f(x, u).")
    if plant.p != 1:
        raise refuse("normal_form", "plant", f"{plant.p} outputs", "one output", "Choose the one that tells most.")
    found = observability(plant, states=states, inputs=inputs, count=count, max_boxes=512)
    if found.regular == "refuted":
        given = f"a box in which det dPhi/dx has both signs, at {' and '.join(str(one.tolist()) for one in found.between)}"
        raise refuse("normal_form", "states", given, "a box on which dPhi/dx has full rank", "Keep to one of the two sides.")
    if len(found.lost):
        at = found.lost[0]
        given = f"a box where Phi loses rank, at x = {at[: plant.n].tolist()}" + (
            f", u = {at[plant.n :].tolist()}" * (plant.m > 0)
        )
        raise refuse("normal_form", "states", given, "a box on which dPhi/dx has full rank", "Keep away from that point.")
    if found.chain == found.triangular == "no":
        fix = "Designs without a form: jaxobs.designs.lpv_lmi with lpv_from; observers.ContinuousKalman."
        given = f"{type(plant).__name__}, whose z' is not triangular: some input hides states that others show"
        raise refuse("normal_form", "plant", given, "a plant that is observable for every input", fix)
    middle = found.states.lower + (found.states.upper - found.states.lower) / 2
    begin = jnp.asarray(middle if start is None else start, dtype_of(plant))
    return NormalChain(plant, begin) if found.chain != "no" else NormalTriangular(plant, begin)


@dataclasses.dataclass(frozen=True)
class NormalSlopes:
    """Bounds on dg_i/dz_j, the nonlinear part of z' in normal coordinates, for x and u in a box (lower, upper (n, n)).

    constant: for a chain the Lipschitz constant of phi, for triangular forms sup |dg/dz| (Frobenius). gradient: "proved" by
    interval arithmetic, or "sampled": then the numbers are the largest seen, no bounds. pairs: whether the bounds also hold
    for mean values between any two states of the box, proved; else between two states whose segment in z is the
    image of a path in the box from one to the other.
    """

    form: NormalChain | NormalTriangular
    states: Sides
    inputs: Sides
    lower: np.ndarray
    upper: np.ndarray
    constant: float
    gradient: str
    pairs: bool

    @property
    def bounds(self) -> np.ndarray:
        """Rows (lowest, highest) of dphi/dz_j, widened to contain 0: what designs.high_gain_lmi takes for a chain, (n, 2)."""
        last = np.stack([self.lower[-1], self.upper[-1]], axis=1)
        return np.stack([np.minimum(last[:, 0], 0.0), np.maximum(last[:, 1], 0.0)], axis=1)

    def __str__(self) -> str:
        what = "phi" if isinstance(self.form, NormalChain) else "g"
        size = f"{self.constant:.6g} for x from {self.states}" + (f", u from {self.inputs}" if self.form.m else "")
        if self.pairs:
            said = f"In normal coordinates {what} has the Lipschitz constant {size}, for any two states of the box: "
            said += "proved by interval arithmetic."
        elif self.gradient == "proved":
            said = (
                f"In normal coordinates the gradient of {what} is at most {size}, proved by interval arithmetic. It is a "
                "Lipschitz constant between two states where the segment that joins them in z is the image of a path in the "
                "box from one to the other, which asks for more than rank where Phi is not one to one."
            )
        else:
            said = f"In normal coordinates the gradient of {what} reaches {size}: the most of {SAMPLES} samples, no bound."
        return "\n".join(textwrap.wrap(said, 110))


def normal_slopes(form: NormalChain | NormalTriangular, *, states: Any, inputs: Any = None, pieces: int = 4096) -> NormalSlopes:
    """Bounds on dg/dz = d(z' - shift z)/dx (dPhi/dx)^-1 for x in a box and u in another (u = 0 if not given).

    First for any two states a, b of the box: with means of both Jacobians along the segment from a to b in x, which lie
    within their interval bounds, g(a) - g(b) = S (Phi(a) - Phi(b)), S in the interval matrix dg (dPhi)^-1. Where that
    interval matrix is not regular, or loses more than a factor of two, the gradient itself is bounded, and `pairs` is False;
    where neither succeeds, sampled. Every enclosure is the hull of those on at most `pieces` boxes, of equal size, that make
    up the whole.

    ValueError for boxes of another size or not finite. Source: Moore, Kearfott and Cloud, 2009, chapter 7 (interval matrices).
    """
    require_instance("normal_slopes", "form", form, AbstractNormalForm, "jaxobs.structure.normal_form(plant, ...) makes one.")
    n, m = form.n, form.m
    x_box = box_of("normal_slopes", "states", states, n, finite=True)
    zero = (np.zeros(m), np.zeros(m))
    u_box = box_of("normal_slopes", "inputs", zero if inputs is None else inputs, m, finite=True)
    own, chain = exact(form), isinstance(form, NormalChain)
    require_derivatives("normal_slopes", lambda x, u: own.plant.flow(jnp.zeros((), x.dtype), x, u), n, m)
    require_derivatives("normal_slopes", own.plant.h, n, m, name="h")
    rows = [n - 1] if chain else list(range(n))
    mask = np.zeros((n, n), bool)
    mask[rows] = True if chain else np.tril(np.ones((n, n), bool))
    places = tuple(index.astype(np.int32) for index in np.nonzero(mask))

    def rest(x, u):
        """g, without the shift."""
        moved, z = own.pushed(x, u), own.to_normal(x)
        return moved - jnp.concatenate([z[1:], jnp.zeros_like(z[:1])])

    def entries(z):
        x, u = z[:n], z[n:]
        slope = own.jacobian(x)
        return (jax.jacfwd(lambda x: rest(x, u))(x) @ adjugate(slope))[places] / determinant(slope)

    z = Interval(*(np.concatenate(side) for side in zip(x_box, u_box, strict=True)))
    seen = _sampled(entries, z)
    size = float(np.max(np.linalg.norm(seen, axis=1)))
    sides = np.zeros((2, n, n))

    def result(lower, upper, constant, gradient, pairs):
        sides[0][places], sides[1][places] = lower, upper
        return NormalSlopes(form, x_box, u_box, sides[0], sides[1], constant, gradient, pairs)

    def jacobians(z):
        x, u = z[:n], z[n:]
        return own.jacobian(x), jax.jacfwd(lambda x: rest(x, u))(x)

    def squares(z):
        found = entries(z)
        return found, jnp.sum(found**2)

    try:
        parts = _pieces(z, pieces)
        phi, slope = _hulls(jacobians, parts)
        between = _product(slope, enclosed_inverse(phi))[places]
        wide = _norm(between)
        if wide <= 2 * size:
            return result(between.lower, between.upper, wide, "proved", True)
        gradient, total = _hulls(squares, parts, 4 * size**2 + 4 * size)
        found = min(_norm(gradient), math.sqrt(total.upper) * (1 + 1e-12) if total.upper < math.inf else math.inf)
        if np.isfinite(wide) and not found < wide / 2:
            return result(between.lower, between.upper, wide, "proved", True)
        if np.isfinite(found) and np.isfinite([gradient.lower, gradient.upper]).all():
            return result(gradient.lower, gradient.upper, found, "proved", False)
    except UnknownPrimitiveError:
        pass
    return result(seen.min(axis=0), seen.max(axis=0), size, "sampled", False)


def _pieces(z: Interval, count: int) -> Interval:
    """At most `count` boxes that cover the box, (k, N)."""
    free = np.flatnonzero(z.upper > z.lower)
    cuts = int(count ** (1 / max(len(free), 1)))
    ends = [np.linspace(a, b, (cuts if k in free else 1) + 1) for k, (a, b) in enumerate(zip(z.lower, z.upper, strict=True))]
    for end, a, b in zip(ends, z.lower, z.upper, strict=True):
        end[0], end[-1] = a, b
    sides = [np.stack([g.ravel() for g in np.meshgrid(*(e[s] for e in ends), indexing="ij")], axis=1) for s in (LEFT, RIGHT)]
    return Interval(*sides)


def _hulls(g: Any, parts: Interval, limit: float = math.inf) -> Any:
    """What g returns, enclosed over all the boxes together. Boxes with an entry that is unbounded, or beyond the limit, are cut
    again, a few times; where one stays unbounded all is."""
    found, jumps, bad = [], False, np.ones(1, bool)
    for turn in range(ROUNDS):
        value = trace(jax.vmap(g), jax.ShapeDtypeStruct(parts.shape, np.float64))(parts)
        flat = [np.reshape(end, (len(parts.lower), -1)) for one in value.value for end in (one.lower, one.upper)]
        size = np.max(np.abs(np.concatenate(flat, axis=1)), axis=1)
        bad, jumps = ~np.isfinite(size), jumps or bool(value.jumps)
        again = bad | (size > limit)
        last = turn == ROUNDS - 1 or np.sum(again) * 2 ** parts.shape[1] > MOST
        found.append((value.value, ~bad if last else ~again))
        if last or not again.any():
            break
        parts = _halves(parts[np.flatnonzero(again)])
    shapes = [one.shape[1:] for one in found[0][0]]
    if bad.any() or jumps:
        return tuple(whole(shape) for shape in shapes)
    ends = [[(one.lower[good], one.upper[good]) for one in values] for values, good in found]
    joined = [[np.concatenate(side) for side in zip(*same, strict=True)] for same in zip(*ends, strict=True)]
    return tuple(Interval(low.min(axis=0), high.max(axis=0)) for low, high in joined)


def _halves(parts: Interval) -> Interval:
    """Each box halved along every coordinate in which it has a width."""
    lower, upper = parts.lower, parts.upper
    for k in range(lower.shape[1]):
        if np.all(lower[:, k] == upper[:, k]):
            continue
        cut_low, cut_high, middle = lower.copy(), upper.copy(), lower[:, k] + (upper[:, k] - lower[:, k]) / 2
        cut_low[:, k], cut_high[:, k] = middle, middle
        lower, upper = np.concatenate([lower, cut_low]), np.concatenate([cut_high, upper])
    return Interval(lower, upper)


def _product(a: Interval, b: Interval) -> Interval:
    n = a.shape[0]
    table = [[sum((a[i, k] * b[k, j] for k in range(n)), Interval(0.0, 0.0)) for j in range(n)] for i in range(n)]
    return Interval(*(np.array([[getattr(e, side) for e in row] for row in table], float) for side in ("lower", "upper")))


def _norm(entries: Interval) -> float:
    total = float(np.sum(np.square(np.maximum(np.abs(entries.lower), np.abs(entries.upper)))))
    return math.sqrt(total) * (1 + 1e-12) if np.isfinite(total) else math.inf


def _sampled(entries: Any, z: Interval) -> np.ndarray:
    """The slopes at random points of the box, (k, entries)."""
    with jax.enable_x64(True):
        points = np.random.default_rng(0).uniform(z.lower, z.upper, (SAMPLES, z.lower.size))
        found = np.asarray(jax.jit(jax.vmap(entries))(points))
    return found[np.isfinite(found).all(axis=1)]
