"""Which of the forms that designs ask for a plant has, from the pattern of its Jacobian; for every x and u, not at samples."""

import dataclasses
import functools
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import dtype_of, require_instance
from jaxobs.intervals import Interval, JacobianBounds, UnknownPrimitiveError, jacobian_bounds
from jaxobs.intervals.ranges import ranges
from jaxobs.plants import (
    AbstractBlockTriangular,
    AbstractChain,
    AbstractFlowPlant,
    AbstractLipschitz,
    AbstractStateAffine,
    AbstractStepPlant,
    AbstractTriangular,
    BlockTriangularOf,
    ChainOf,
    Linear,
    LinearStep,
    LipschitzOf,
    StateAffineOf,
    TriangularOf,
)
from jaxobs.structure._box import Sides, box_of
from jaxobs.structure.orders import TIMED, NotThisForm, blocks_of, chain_order, lipschitz_parts, triangular_order
from jaxobs.structure.pattern import Pattern, exact, patterns
from jaxobs.structure.text import describe


@dataclasses.dataclass(frozen=True)
class Slopes:
    """Bounds on a box, proved by interval arithmetic.

    states (lower, upper), inputs (lower, upper): the box. jacobian: lower_ij <= df_i/dx_j <= upper_ij. constant: the Lipschitz
    constant there, with respect to x in the Euclidean norm, of what is named in `of`; infinite where nothing bounds it.
    """

    states: Sides
    inputs: Sides
    jacobian: JacobianBounds
    constant: float
    of: str


@dataclasses.dataclass(frozen=True)
class Forms:
    """What `forms` proved; a form that is not there is None, and `why` says why. `print(forms)` puts it in sentences.

    flow (n, n), output (p, n): the entries of df/dx and dh/dx as characters: 0, 1, c (another constant), u (of inputs or time
    alone), * (of the state). linear, chain, triangular, blocks, state_affine, lipschitz: the plant in that form, ready for a
    design; itself where it was written so. input_affine: x' = a(x) + b(x) u. slopes: bounds on the box that was asked about.
    jumps: where f or h switches; they are taken for continuous there. source: what proves the pattern; "nothing" where f
    uses what neither formulas nor intervals can follow (`why["pattern"]` names it): then no form is claimed. All of it is of
    the plant with the parameters that it has; relying: the forms that other parameters take away, as one that is zero now.
    """

    plant: AbstractFlowPlant | AbstractStepPlant
    flow: np.ndarray
    output: np.ndarray
    parts: dict[str, tuple[Any, ...]]  # a form that is there, and what its class takes beside the plant
    input_affine: bool
    slopes: Slopes | None
    jumps: tuple[str, ...]
    source: str
    why: dict[str, str]
    relying: tuple[str, ...] = ()

    @functools.cached_property
    def linear(self) -> Linear | LinearStep | None:
        if "linear" not in self.parts:
            return None
        kind = LinearStep if isinstance(self.plant, AbstractStepPlant) else Linear
        return kind(*(jnp.asarray(one, dtype_of(self.plant)) for one in self.parts["linear"]))

    @functools.cached_property
    def chain(self) -> AbstractChain | None:
        return self._made("chain", ChainOf)

    @functools.cached_property
    def triangular(self) -> AbstractTriangular | None:
        return self._made("triangular", TriangularOf)

    @functools.cached_property
    def blocks(self) -> AbstractBlockTriangular | None:
        return self._made("blocks", BlockTriangularOf)

    @functools.cached_property
    def state_affine(self) -> AbstractStateAffine | None:
        return self._made("state_affine", StateAffineOf)

    @functools.cached_property
    def lipschitz(self) -> AbstractLipschitz | None:
        return self._made("lipschitz", LipschitzOf)

    def _made(self, form: str, made: Any) -> Any:
        if form not in self.parts:
            return None
        return self.plant if isinstance(self.plant, WRITTEN[form]) else made(self.plant, *self.parts[form])

    def __str__(self) -> str:
        return describe(self)


def forms(plant: AbstractFlowPlant | AbstractStepPlant, *, states: Any = None, inputs: Any = None) -> Forms:
    """The forms of a plant: linear, a chain of integrators, triangular (also with its states in another order, and by blocks
    for several outputs), affine in the state, x' = A x + B f(x) + g(y, u).

    states, inputs: (lower, upper) of x (n,) and of u (m,), to bound the slopes of f there; infinite ends are allowed, inputs
    are unbounded if not given. The pattern itself holds everywhere: an entry is zero, or constant, if its exact formula is;
    where f has no formula, if interval arithmetic over all of R^n says so.

    A numerical coincidence (1 + 1e-30 rounds to 1) counts as equality, since the plant is what its floats are. What is equal
    only after trigonometric identities is not seen as equal. ValueError for what is no plant and for boxes of another size.
    Source: Bernard, Observer Design for Nonlinear Systems, 2019, chapters 2 to 4, for which form leads to which observer.
    """
    fix = "plants.from_function(f, h, n=..., m=..., p=...) makes one of two functions."
    require_instance("forms", "plant", plant, AbstractFlowPlant | AbstractStepPlant, fix)
    box = None if states is None else (box_of("forms", "states", states, plant.n), box_of("forms", "inputs", inputs, plant.m))
    try:
        flow, output = patterns(plant)
    except UnknownPrimitiveError as error:
        unknown = np.full((plant.n, plant.n), "?"), np.full((plant.p, plant.n), "?")
        return Forms(plant, *unknown, {}, False, None, (), "nothing", {"pattern": str(error)})
    makers = _STEP if isinstance(plant, AbstractStepPlant) else _FLOW
    parts, why = _parts(flow, output, makers)
    slopes = None if box is None else _slopes(plant, flow, parts, *box)
    jumps, affine = flow.jumps + output.jumps, flow.input_affine and output.input_affine
    source = " and ".join(dict.fromkeys((flow.source, output.source)))
    return Forms(plant, flow.kinds, output.kinds, parts, affine, slopes, jumps, source, why, _relying(plant, parts, makers))


def as_chain(plant: AbstractFlowPlant) -> AbstractChain:
    """The plant as x_i' = x_{i+1}, x_n' = phi(x, u), y = x_1, for the designs of chains; ValueError, with the entry that spoils
    it, for a plant that is none."""
    return _required("chain", plant)


def as_triangular(plant: AbstractFlowPlant) -> AbstractTriangular:
    """The plant as x_i' = a_i(u) x_{i+1} + g_i(u, x_1, ..., x_i), y = x_1; ValueError, with the reason, for any other."""
    return _required("triangular", plant)


def as_lipschitz(plant: AbstractFlowPlant) -> AbstractLipschitz:
    """The plant as x' = A x + B f(x) + g(y, u), y = C x; ValueError, with the reason, for any other."""
    return _required("lipschitz", plant)


def _required(name: str, plant: AbstractFlowPlant) -> Any:
    found = forms(plant)
    made = getattr(found, name)
    if made is None:
        why = found.why.get(name) or found.why.get("pattern")
        fix = "jaxobs.structure.normal_form(plant, ...) looks for other coordinates; print(jaxobs.structure.forms(plant))."
        raise ValueError(f"as_{name}.plant: given {type(plant).__name__}, where {why}; expected this form. {fix}")
    return made


def _linear(flow: Pattern, output: Pattern) -> tuple[np.ndarray, ...]:
    """The matrices A, B, C, read off the formulas: numbers, without the plant's parameters as leaves."""
    n, m = flow.n, flow.m
    bad = np.argwhere(np.isnan(flow.constants))
    if len(bad):
        known = flow.support[tuple(bad[0])]
        raise NotThisForm(f"{_entry(bad[0], n, m)} is {'not constant' if known else 'a constant that is no fraction'}")
    if flow.timed:
        raise NotThisForm(TIMED)
    if not np.all(flow.at_zero):
        raise NotThisForm(f"x{int(np.argmin(flow.at_zero)) + 1}' has a constant part")
    if not output.linear:
        raise NotThisForm("y is not C x")
    return flow.constants[:, :n], flow.constants[:, n : n + m], output.constants[:, :n]


def _state_affine(flow: Pattern, output: Pattern) -> tuple[()]:
    bad = np.argwhere(flow.kinds == "*")
    if len(bad):
        raise NotThisForm(f"{_entry(bad[0], flow.n, flow.m)} depends on the state")
    if flow.timed:
        raise NotThisForm(TIMED)
    if not output.linear:
        raise NotThisForm("y is not C x")
    return ()


WRITTEN = {
    "linear": Linear | LinearStep,
    "chain": AbstractChain,
    "triangular": AbstractTriangular,
    "blocks": AbstractBlockTriangular,
    "state_affine": AbstractStateAffine,
    "lipschitz": AbstractLipschitz,
}
_STEP = {"linear": _linear}
_FLOW = {
    "linear": _linear,
    "chain": lambda flow, output: (chain_order(flow, output),),
    "triangular": lambda flow, output: (triangular_order(flow, output),),
    "blocks": blocks_of,
    "state_affine": _state_affine,
    "lipschitz": lipschitz_parts,
}


def _parts(flow: Pattern, output: Pattern, makers: dict[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    other = "the forms of designs are those of x' = f(x, u); this is x+ = f(x, u)"
    parts, why = {}, {name: other for name in _FLOW if name not in makers}
    for name, make in makers.items():
        try:
            parts[name] = make(flow, output)
        except NotThisForm as error:
            why[name] = str(error)
    return parts, why


def _relying(plant: Any, parts: dict[str, tuple[Any, ...]], makers: dict[str, Any]) -> tuple[str, ...]:
    """The forms that are gone, or other, where every float leaf of the plant is moved off its value."""
    asked = [name for name in parts if not isinstance(plant, WRITTEN[name])]
    leaves, tree = jax.tree.flatten(exact(eqx.filter(plant, eqx.is_inexact_array)))
    if not asked or not leaves:
        return ()
    steps = [0.01 * np.sqrt(2 + k + np.arange(np.size(one))).reshape(np.shape(one)) for k, one in enumerate(leaves)]
    with jax.enable_x64(True):
        moved = [jnp.asarray(np.asarray(one) * (1 + d) + d) for one, d in zip(leaves, steps, strict=True)]
    try:
        other = eqx.combine(jax.tree.unflatten(tree, moved), eqx.filter(plant, eqx.is_inexact_array, inverse=True))
        found, _ = _parts(*patterns(other), {name: makers[name] for name in asked})
    except UnknownPrimitiveError:
        return ()
    return tuple(name for name in asked if name not in found or (name != "linear" and found[name] != parts[name]))


def _entry(place: np.ndarray, n: int, m: int) -> str:
    i, j = map(int, place)
    name = f"x{j + 1}" if j < n else f"u{j - n + 1}" if j < n + m else "t"
    return f"dx{i + 1}'/d{name}"


def _slopes(plant: Any, flow: Pattern, parts: dict[str, Any], states: Sides, inputs: Sides) -> Slopes:
    """Bounds on df/dx, and the Lipschitz constant of phi for chains, of all that is not constant for other plants."""
    own, n, step = exact(plant), plant.n, isinstance(plant, AbstractStepPlant)

    def move(x, w):
        return own.step(w[-1], x, w[:-1]) if step else own.flow(w[-1], x, w[:-1])

    start, end = (0.0, math.inf) if step else (-math.inf, math.inf)
    w = Interval(np.append(inputs.lower, start), np.append(inputs.upper, end))
    x = Interval(states.lower, states.upper)
    found = jacobian_bounds(move, (x, w))
    if "chain" in parts:
        what, varying = "phi", np.zeros((n, n), bool)
        varying[parts["chain"][0][-1]] = flow.kinds[parts["chain"][0][-1]] != "0"
    else:
        what, varying = "the part of f whose slope is not constant", np.isin(flow.kinds, ["*", "u"])
    places = tuple(index.astype(np.int32) for index in np.nonzero(varying))
    if not len(places[0]):
        return Slopes(states, inputs, found, 0.0, what)

    def squares(z):
        return jnp.sum(jax.jacfwd(move)(z[:n], z[n:])[places] ** 2)[None]

    z = Interval(np.append(x.lower, w.lower), np.append(x.upper, w.upper))
    entries = np.maximum(np.abs(found.lower), np.abs(found.upper))[places]
    coarse = float(np.sum(np.square(entries))) * (1 + 1e-12)
    with np.errstate(invalid="ignore"):
        fine = float(ranges(squares, z, rtol=1e-6, max_boxes=4000).upper[0]) if np.isfinite(coarse) else math.inf
    return Slopes(states, inputs, found, math.nextafter(math.sqrt(min(coarse, fine)), math.inf), what)
