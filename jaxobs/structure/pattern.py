"""What each entry of a Jacobian depends on, for every x and u: from exact formulas, or from intervals on the whole space."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs._module import astype
from jaxobs.intervals import UnknownPrimitiveError, require_derivatives, trace, whole
from jaxobs.intervals import graph as graphs
from jaxobs.intervals.graph_slopes import slopes
from jaxobs.intervals.interval import point
from jaxobs.plants import AbstractFlowPlant, AbstractPlant, AbstractStepPlant
from jaxobs.plants._depends import timed

Function = Callable[[Any, Any], Any]
ROUNDING = 1e-12  # relative width of an enclosure that is one number, known up to rounding
NOTHING: frozenset[int] = frozenset()


@dataclasses.dataclass(frozen=True)
class Pattern:
    """The Jacobian of g(x, w), w = (u, t), with respect to z = (x, w), as far as it is proved.

    support (r, n + m + 1): for each entry the variables that it may depend on, by their places in z; empty for constants, whose
    values are in `constants` (NaN elsewhere, and for constants that are no fractions). identity (r,): j where g_i is x_j
    itself, else -1. at_zero (r,): whether g_i(0, 0) = 0. jumps: what a switch compares, where g may be discontinuous. source:
    what proves it.
    """

    n: int
    m: int
    support: np.ndarray
    constants: np.ndarray
    identity: np.ndarray
    at_zero: np.ndarray
    jumps: tuple[str, ...]
    source: str

    @property
    def states(self) -> frozenset[int]:
        return frozenset(range(self.n))

    @property
    def inputs(self) -> frozenset[int]:
        return frozenset(range(self.n, self.n + self.m))

    @property
    def timed(self) -> bool:
        """Whether g may depend on t."""
        return bool(np.any(self.constants[:, -1] != 0)) or any(self.n + self.m in s for s in self.support.flat)

    @property
    def kinds(self) -> np.ndarray:
        """dg/dx as characters: 0, 1, c (another constant), u (of inputs and time alone), * (of states)."""
        kinds = np.full((len(self.support), self.n), "*")
        for i, j in np.ndindex(kinds.shape):
            value, support = self.constants[i, j], self.support[i, j]
            if not np.isnan(value):
                kinds[i, j] = "0" if value == 0 else "1" if value == 1 else "c"
            elif not support & self.states:
                kinds[i, j] = "u" if support else "c"  # a constant that is no fraction, as exp(1)
        return kinds

    @property
    def linear(self) -> bool:
        """Whether g is C x: constant entries, nothing of w, zero at zero."""
        return bool(np.all(self.at_zero) and not np.isnan(self.constants).any() and np.all(self.constants[:, self.n :] == 0))

    @property
    def input_affine(self) -> bool:
        """Whether g = a(x, t) + b(x, t) u."""
        return not any(s & self.inputs for s in self.support[:, self.n : self.n + self.m].flat)


def exact(plant: Any) -> Any:
    """The plant with float64 leaves: the numbers it has, whatever JAX's precision is."""
    with jax.enable_x64(True):
        return astype(plant, jnp.float64)


def patterns(plant: AbstractPlant) -> tuple[Pattern, Pattern]:
    """Those of flow or step, and of h. UnknownPrimitiveError where neither formulas nor intervals can follow."""
    own = exact(plant)

    def move(x, w):
        if isinstance(own, AbstractStepPlant):
            return own.step(w[-1], x, w[:-1])
        assert isinstance(own, AbstractFlowPlant)
        return own.flow(w[-1], x, w[:-1])

    found = pattern(move, plant.n, plant.m), pattern(lambda x, w: own.h(x, w[:-1]), plant.n, plant.m)
    return found if timed(own) else (_untimed(found[0]), _untimed(found[1]))


def _untimed(found: Pattern) -> Pattern:
    """The same for a function that makes no use of t, which enclosures of its jumps do not tell."""
    constants, support = found.constants.copy(), found.support.copy()
    constants[:, -1], support[:, -1] = 0.0, NOTHING
    for place in np.ndindex(support.shape):
        support[place] -= {found.n + found.m}
    return dataclasses.replace(found, constants=constants, support=support)


def pattern(g: Function, n: int, m: int) -> Pattern:
    """The pattern of g(x, w) -> (r,), x (n,), w (m + 1,)."""
    try:
        return _from_formulas(g, n, m)
    except UnknownPrimitiveError:
        return _from_intervals(g, n, m)


def _from_formulas(g: Function, n: int, m: int) -> Pattern:
    found, size = graphs.trace(g, n, m + 1), n + m + 1
    graph, entries = found.graph, list(found.outputs.flat)
    columns = [slopes(graph, entries, k) for k in range(size)]
    support, constants = np.empty((len(entries), size), object), np.full((len(entries), size), np.nan)
    identity, at_zero = np.full(len(entries), -1), np.zeros(len(entries), bool)
    for i, value in enumerate(entries):
        switched = graph.support(value) if graph.jumps([value]) else set()
        for j in range(size):
            e = columns[j][i]
            support[i, j] = frozenset(graph.support(e))
            if j in switched:  # what jumps with x_j is not constant, whatever its slope is elsewhere
                support[i, j] |= switched
            elif e.is_constant:
                constants[i, j] = float(e.constant)
        at_zero[i] = value.constant == 0 and all(graph.atoms[k][0] == "x" for k, _ in value.terms)
        if value.constant == 0 and len(value.terms) == 1 and value.terms[0][1] == 1:
            name, *args = graph.atoms[value.terms[0][0]]
            if name == "x" and args[0] < n:
                identity[i] = args[0]
    return Pattern(n, m, support, constants, identity, at_zero, found.jumps, "exact formulas")


def _from_intervals(g: Function, n: int, m: int) -> Pattern:
    size = n + m + 1
    try:
        require_derivatives("forms", g, n, m + 1)
    except ValueError as error:  # its formulas would be its own, but these are its derivatives
        raise UnknownPrimitiveError(str(error)) from error
    structure = jax.eval_shape(g, *(jax.ShapeDtypeStruct((k,), np.float64) for k in (n, m + 1)))
    rows = structure.shape[0]
    support, constants = np.full((rows, size), NOTHING, object), np.full((rows, size), np.nan)
    identity, at_zero, jumps = np.full(rows, -1), np.zeros(rows, bool), []
    for i in range(rows):

        def row(z, i=i):
            return g(z[:n], z[n:])[i]

        everywhere = whole((size,))
        first, second = (trace(f, everywhere)(everywhere) for f in (jax.jacfwd(row), jax.jacfwd(jax.jacfwd(row))))
        value = trace(row, everywhere)
        jumped = dict.fromkeys((*value(everywhere).jumps, *first.jumps))
        jumps += jumped
        depends = ~((second.value.lower == 0) & (second.value.upper == 0)) | bool(jumped)
        low, high = first.value.lower, first.value.upper
        for j in range(size):
            if high[j] - low[j] <= ROUNDING * abs(low[j]) and not jumped:
                constants[i, j] = low[j] if low[j] == high[j] else (low[j] + high[j]) / 2
            elif depends[j].any():
                support[i, j] = frozenset(map(int, np.flatnonzero(depends[j])))
            else:  # constant piece by piece, as the slopes of a sorted list: on what the pieces depend is not known
                support[i, j] = frozenset(range(size - 1))
        origin = value(point(np.zeros(size))).value
        at_zero[i] = origin.lower == origin.upper == 0
        ones = np.flatnonzero(constants[i] == 1)
        if at_zero[i] and len(ones) == 1 and np.count_nonzero(constants[i]) == 1 and ones[0] < n:
            identity[i] = ones[0]
    return Pattern(n, m, support, constants, identity, at_zero, tuple(dict.fromkeys(jumps)), "interval arithmetic")
