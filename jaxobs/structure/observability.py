"""Does y with its derivatives tell the state? The observability map over a region: rank, conditioning, and what is proved.

Source: Gauthier, Hammouri and Othman, A simple observer for nonlinear systems, IEEE TAC 37 (1992); Gauthier and Bornard,
Observability for any u(t) of a class of nonlinear systems, IEEE TAC 26 (1981); Bernard, Observer Design for Nonlinear Systems,
2019, chapters 3 and 5.
"""

import dataclasses
import itertools
import textwrap
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import require_instance, require_integer
from jaxobs.intervals import Interval, UnknownPrimitiveError, require_derivatives
from jaxobs.plants import AbstractFlowPlant, lie_derivatives, observability_map
from jaxobs.plants._depends import require_timeless
from jaxobs.plants.lie import indices_of
from jaxobs.structure._box import Sides, box_of
from jaxobs.structure.algebra import adjugate, continuous, determinant, sign_on, vanishes
from jaxobs.structure.pattern import exact

RANK = 1e-10  # a singular value below this share of the largest, in scaled coordinates, is no rank
CORNERS = 64
LARGEST = 6  # states up to which a determinant is bounded
Map = Any


@dataclasses.dataclass(frozen=True)
class Observability:
    """What `observability` found on the box states x inputs.

    indices: derivatives of each output in Phi. rank: the least at `count` points. median, worst: condition numbers of
    dPhi/dx, columns scaled by the half-widths of the box, rows by their largest size on it; worst_at (x, u) where. lost (k, n
    + m): points (x, u) without full rank. regular: "proved" if det dPhi/dx != 0 on the whole box by interval arithmetic,
    "refuted" if it is proved to vanish somewhere, between the two points of `between`; "sampled" if only the points are
    known. boxes: evaluated for it. chain: whether the input enters y^(n) first, so that z = Phi(x) makes a chain; triangular:
    whether the i-th component of z' knows z_1, ..., z_{i+1} only, for every u (for input-affine plants that is observability
    for every input); each "proved" (an identity of formulas, everywhere), "sampled" (to rounding, at the points) or "no".
    Without inputs both are moot: chain is "proved". For several outputs they are "no": nothing is asked.
    """

    plant: AbstractFlowPlant
    states: Sides
    inputs: Sides
    indices: tuple[int, ...]
    count: int
    rank: int
    median: float
    worst: float
    worst_at: tuple[np.ndarray, np.ndarray]
    lost: np.ndarray
    regular: str
    between: tuple[np.ndarray, ...]
    boxes: int
    chain: str
    triangular: str

    def __bool__(self) -> bool:
        """Full rank at every point, and not refuted."""
        return self.regular != "refuted" and not len(self.lost)

    def __str__(self) -> str:
        n = self.plant.n
        names = ", ".join(f"y{i + 1} with {r - 1} derivatives" for i, r in enumerate(self.indices) if r)
        where = f"x from {self.states}" + (f", u from {self.inputs} (constant)" if self.plant.m else "")
        at = f"x = {_row(self.worst_at[0])}" + (f", u = {_row(self.worst_at[1])}" if self.plant.m else "")
        lines = [f"Observability map of {type(self.plant).__name__}: {names}, for {where}."]
        if len(self.lost):
            first = f"the first {_row(self.lost[0])}"
            lines.append(f"Its Jacobian loses rank at {len(self.lost)} of {self.count} points, down to {self.rank}; {first}.")
        else:
            lines.append(f"Its Jacobian has rank {n} of {n} at all {self.count} points.")
        lines.append(f"Condition number (scaled): median {self.median:.3g}, worst {self.worst:.3g} at {at}.")
        proved = {
            "proved": f"Proved on the box: the determinant has no zero (interval arithmetic, {self.boxes} boxes).",
            "refuted": "Proved: the determinant vanishes in the box, " + " and ".join(
                f"{'+' if i == 0 else '-'} at {_row(point)}" for i, point in enumerate(self.between)
            ) + ".",
            "sampled": f"Sampled at {self.count} points; not proved on the box.",
        }  # fmt: skip
        lines.append(proved[self.regular])
        how = {"proved": "proved for every x and u, by formulas", "sampled": f"sampled at {self.count} points"}
        if self.plant.p > 1:
            lines.append("Normal forms are looked for with one output only.")
        elif self.plant.m == 0:
            lines.append(
                "Without inputs z = Phi(x) is locally a chain, wherever dPhi/dx is regular: see jaxobs.structure.normal_form."
            )
        elif self.chain != "no":
            lines.append(f"The input enters y^({n}) first ({how[self.chain]}): z = Phi(x) is locally a chain.")
        elif self.triangular != "no":
            lines.append(f"z = Phi(x) is locally triangular for every input ({how[self.triangular]}): uniformly observable.")
        else:
            lines.append("z = Phi(x) is not triangular: some input may hide states that others show.")
        return "\n".join(line for text in lines for line in textwrap.wrap(text, 110, break_long_words=False))


def observability(
    plant: AbstractFlowPlant,
    *,
    states: Any,
    inputs: Any = None,
    indices: tuple[int, ...] | None = None,
    count: int = 256,
    seed: int = 0,
    max_boxes: int = 4000,
) -> Observability:
    """Rank and conditioning of dPhi/dx, Phi(x, u) = (h, L_f h, ..., L_f^{n-1} h), over a box, for constant u.

    states, inputs: (lower, upper) of x (n,) and of u (m,), finite; u = 0 if inputs are not given. indices: (r_1, ..., r_p), how
    many derivatives of each output; for several outputs chosen at random points if not given, lowest derivatives first. count:
    random points, to which the middle and corners of the box are added; seed: theirs. max_boxes: for the proof that the
    determinant has no zero, by bisection; 0 leaves it out, as more than 6 states do.

    Rank at a point says that x is told locally by y, ..., y^(n-1). That different states of the box give different outputs it
    does not say. For several outputs a choice of rows that loses rank does not prove that the others do not help.

    ValueError for what is no flow plant, a flow that changes with time, declared derivatives (custom_jvp), boxes of another
    size or not finite, indices whose sum is not n, count < 1.
    """
    fix = "The observability map is that of x' = f(x, u); for x+ = f(x, u) compose f by hand."
    require_instance("observability", "plant", plant, AbstractFlowPlant, fix)
    require_integer("observability", "count", count, 1, "It is the number of random points.")
    require_integer("observability", "max_boxes", max_boxes, 0, "It bounds the work of the proof; 0 leaves it out.")
    x_box = box_of("observability", "states", states, plant.n, finite=True)
    own, n = exact(plant), plant.n
    with jax.enable_x64(True):
        require_timeless("observability", own)
        require_derivatives("observability", lambda x, u: own.flow(jnp.zeros(()), x, u), n, plant.m)
        require_derivatives("observability", own.h, n, plant.m, name="h")
    zero = (np.zeros(plant.m), np.zeros(plant.m))
    u_box = box_of("observability", "inputs", zero if inputs is None else inputs, plant.m, finite=True)
    with jax.enable_x64(True):
        points = _points(x_box, u_box, count, seed)
        if indices is None and plant.p > 1:
            indices = _indices(own, points)
        indices = indices_of("observability", plant, indices)
        slopes = np.asarray(_jacobians(own, indices, points))
        half = np.where(x_box.upper > x_box.lower, (x_box.upper - x_box.lower) / 2, 1.0)
        scaled = slopes * half
        finite = np.asarray(np.isfinite(scaled).all(axis=(1, 2)))
        sizes = np.max(np.linalg.norm(scaled[finite], axis=2), axis=0, initial=0.0)
        scaled = np.where(finite[:, None, None], scaled, 0.0) / np.where(sizes > 0, sizes, 1.0)[:, None]
        values = np.linalg.svd(scaled, compute_uv=False)
        ranks = np.sum(values > RANK * np.maximum(values[:, :1], RANK), axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            conditions = np.where(ranks == n, values[:, 0] / values[:, -1], np.inf)
        lost = points[np.flatnonzero(ranks < n)]
        k = int(np.argmax(conditions))
        known, between, boxes = _regular(own, indices, x_box, u_box, points, max_boxes)
        chain, triangular = _uniform(own, points) if plant.p == 1 else ("no", "no")
    worst = (points[k, :n], points[k, n:])
    figures = int(ranks.min()), float(np.median(conditions)), float(conditions[k])
    return Observability(
        plant, x_box, u_box, indices, len(points), *figures, worst, lost, known, between, boxes, chain, triangular
    )


def _points(states: Sides, inputs: Sides, count: int, seed: int) -> np.ndarray:
    """Random ones, the middle, and corners, (k, n + m)."""
    lower, upper = (np.concatenate([a, b]) for a, b in zip(states, inputs, strict=True))
    corners = itertools.islice(itertools.product(*({a, b} for a, b in zip(lower, upper, strict=True))), CORNERS)
    random = np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))
    return np.concatenate([random, (lower + (upper - lower) / 2)[None], np.asarray(list(corners))])


@eqx.filter_jit
def _jacobians(plant: Any, indices: tuple[int, ...], points: Any) -> Any:
    return jax.vmap(lambda z: _slope(plant, indices, z))(points)


def _slope(plant: AbstractFlowPlant, indices: tuple[int, ...], z: Any) -> Any:
    return jax.jacfwd(lambda x: observability_map(plant, x, z[plant.n :], indices))(z[: plant.n])


def _indices(plant: AbstractFlowPlant, points: np.ndarray) -> tuple[int, ...]:
    """Rows (k, i) are taken, lowest k first, while the rank grows with them; at the point where they tell most with least."""
    n = plant.n

    def rows(z):
        return jax.jacfwd(lambda x: lie_derivatives(plant, x, z[n:], n - 1))(z[:n])

    best: tuple[int, ...] = (0,) * plant.p
    for slopes in np.asarray(jax.jit(jax.vmap(rows))(points[:16])):
        taken, found = np.zeros((0, n)), [0] * plant.p
        for k, i in itertools.product(range(n), range(plant.p)):
            trial = np.vstack([taken, slopes[k, i] / (np.linalg.norm(slopes[k, i]) or 1.0)])
            if found[i] == k and np.linalg.matrix_rank(trial, RANK) == len(trial):
                taken, found[i] = trial, k + 1
        if (sum(found), -max(found)) > (sum(best), -max(best)):
            best = tuple(found)
    return (*best[:-1], n - sum(best[:-1]))


def _regular(
    plant: Any, indices: tuple[int, ...], states: Sides, inputs: Sides, points: np.ndarray, max_boxes: int
) -> tuple[str, tuple[np.ndarray, ...], int]:
    if max_boxes == 0 or plant.n > LARGEST:
        return "sampled", (), 0
    z = Interval(*(np.concatenate([a, b]) for a, b in zip(states, inputs, strict=True)))
    try:
        found = sign_on(lambda z: determinant(_slope(plant, indices, z)), z, points[-64:], max_boxes)
    except UnknownPrimitiveError:
        return "sampled", (), 0
    names = {1: "proved", -1: "proved", 0: "refuted", None: "sampled"}
    known = names[found.value]
    if known == "proved" and not continuous(lambda z: observability_map(plant, z[: plant.n], z[plant.n :], indices), z):
        known = "sampled"  # Phi may jump, or be undefined, somewhere on the box
    return known, found.places if known == "refuted" else (), found.boxes


def _uniform(plant: Any, points: np.ndarray) -> tuple[str, str]:
    """(chain, triangular), each proved, sampled or no."""
    if plant.m == 0:
        return "proved", "proved"
    inputs = points[:, plant.n :]
    if np.all(inputs == inputs[0]):  # a box that is one point says nothing of other inputs
        points = np.hstack([points[:, : plant.n], np.random.default_rng(0).uniform(-1, 1, inputs.shape)])
    chain = _zero(chain_residual, plant, points)
    return chain, chain if chain != "no" else _zero(triangular_residual, plant, points)


def chain_residual(plant: AbstractFlowPlant, x: Any, u: Any) -> tuple[Any, Any]:
    """What is zero where z = Phi(x, 0) makes a chain with y = z_1: z_i' - z_{i+1} for i < n, and h(x, u) - h(x, 0); and what it
    is small against."""
    z, moved, _ = _normal(plant, x, u)
    seen, size = _seen(plant, x, u)
    return jnp.append((moved(x) - jnp.roll(z(x), -1))[:-1], seen), jnp.max(jnp.abs(moved(x))) + size


def _seen(plant: AbstractFlowPlant, x: Any, u: Any) -> tuple[Any, Any]:
    """What the input adds to the output, and the size of both."""
    with_u, without = plant.h(x, u), plant.h(x, jnp.zeros_like(u))
    return with_u - without, jnp.max(jnp.abs(with_u)) + jnp.max(jnp.abs(without))


def triangular_residual(plant: AbstractFlowPlant, x: Any, u: Any) -> tuple[Any, Any]:
    """What is zero where z' is triangular: with M the slope of z' in x, the entries of M adj(dPhi/dx) - det(dPhi/dx) (shift)
    above the diagonal, and h(x, u) - h(x, 0); and what they are small against."""
    _, moved, slope = _normal(plant, x, u)
    seen, size = _seen(plant, x, u)
    product = jax.jacfwd(moved)(x) @ adjugate(slope)
    rest = product - determinant(slope) * jnp.eye(plant.n, k=1, dtype=x.dtype)
    return jnp.append(rest[np.triu_indices(plant.n, 1)], seen), jnp.max(jnp.abs(product)) + size


def _normal(plant: AbstractFlowPlant, x: Any, u: Any) -> tuple[Map, Map, Any]:
    """(Phi at u = 0, z' as a function of x, dPhi/dx)."""

    def coordinates(x):
        return observability_map(plant, x, jnp.zeros_like(u))

    def moved(x):
        return jax.jvp(coordinates, (x,), (plant.flow(jnp.zeros((), x.dtype), x, u),))[1]

    return coordinates, moved, jax.jacfwd(coordinates)(x)


def _zero(residual: Map, plant: Any, points: np.ndarray) -> str:
    """Whether a residual vanishes: no (some point shows it), sampled, or proved."""
    n = plant.n
    values, sizes = jax.jit(jax.vmap(lambda z: residual(plant, z[:n], z[n:])))(points)
    largest, size = np.max(np.abs(values), axis=1), np.asarray(sizes)
    known = np.isfinite(largest) & np.isfinite(size)
    if np.any(largest[known] > 1e-9 * size[known]):
        return "no"
    return "proved" if vanishes(lambda x, u: residual(plant, x, u)[0], n, plant.m) else "sampled"


def _row(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{v:.4g}" for v in values) + ")"
