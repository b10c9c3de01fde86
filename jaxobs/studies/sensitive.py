"""What of a lane depends on the parameters that a gradient is taken of: found in the programs, before anything is computed."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxobs import scalars
from jaxobs._loop import Grid
from jaxobs.studies.axes import Members
from jaxobs.studies.tile import Traced


class Sensitive:
    """The programs of a lane, and which leaves of `fixed` and of `carry` the parameters reach; the rest has no derivative.

    `names` are the parameters: leaves of the observer by their dotted names.
    `directions` has one unit vector for each number.
    """

    def __init__(self, members: Members, grid: Grid, hold_innovation: bool, names: tuple[str, ...]):
        self.traced = Traced(members, grid, hold_innovation)
        paths = [_dotted(path) for path, _ in jax.tree_util.tree_flatten_with_path(self.traced.arrays)[0]]
        self.where = [paths.index(f"observer.observer.{name}") for name in names]
        setup, step, lane = self.traced.setup, self.traced.step, self.traced.lane
        count, moving = len(jax.tree.leaves(lane.fixed)), len(jax.tree.leaves(lane.carry))
        given = [setup.inputs[i] for i in self.where]
        reached = scalars.lane_variables(setup.equations, set(given), {})
        at_start = [isinstance(one, scalars.Variable) and one in reached for one in setup.outputs]
        fixed, states = step.inputs[:count], step.inputs[count : count + moving]
        start = {one for one, hit in zip(fixed, at_start[:count], strict=True) if hit}
        start |= {one for one, hit in zip(states, at_start[-moving:], strict=True) if hit}
        ahead = dict(zip(states, step.outputs, strict=False))
        hit = scalars.lane_variables(step.equations, start, ahead)
        self.fixed = [i for i, one in enumerate(fixed) if one in hit and _smooth(one)]
        self.carry = [i for i, one in enumerate(states) if one in hit and _smooth(one)]
        self.directions = units(self.values(self.traced.arrays))

    def values(self, arrays: Any) -> list[Any]:
        """The parameters among the arrays of the members."""
        leaves = jax.tree.leaves(arrays)
        return [leaves[i] for i in self.where]

    def setup(self, arrays: Any, index: Any) -> Callable[[list[Any]], tuple[list[Any], list[Any]]]:
        """parameters -> the reached leaves of fixed and of carry, at the start of the lane with this index."""

        def of(values: list[Any]) -> tuple[list[Any], list[Any]]:
            lane = self.traced._setup(replaced(arrays, self.where, values), index)
            return pick(lane.fixed, self.fixed), pick(lane.carry, self.carry)

        return of

    def step(self, fixed: Any, carry: Any, time: Any, drawn: Any) -> Callable[..., tuple[list[Any], tuple[Any, Any]]]:
        """Reached leaves of fixed and carry -> (those of the next carry, (next carry, output))."""

        def of(some_fixed: list[Any], some_carry: list[Any]) -> tuple[list[Any], tuple[Any, Any]]:
            given = replaced(fixed, self.fixed, some_fixed), replaced(carry, self.carry, some_carry)
            after, out = self.traced._step(*given, time, drawn)
            return pick(after, self.carry), (after, out)

        return of

    def end(self, carry: Any, of: Callable[[dict[str, Any]], Any]) -> Callable[[list[Any]], Any]:
        """Reached leaves of the last carry -> of(results)."""
        return lambda some: of(self.traced.results(replaced(carry, self.carry, some)))

    def shapes(self, part: str) -> list[Any]:
        """Of the reached leaves of "fixed" or "carry"."""
        return pick(getattr(self.traced.lane, part), getattr(self, part))


def pick(tree: Any, which: Sequence[int]) -> list[Any]:
    """The leaves with these numbers."""
    leaves = jax.tree.leaves(tree)
    return [leaves[i] for i in which]


def replaced(tree: Any, which: Sequence[int], values: Sequence[Any]) -> Any:
    """The tree with these values at the given leaves."""
    leaves, structure = jax.tree.flatten(tree)
    for i, value in zip(which, values, strict=True):
        leaves[i] = value
    return jax.tree.unflatten(structure, leaves)


def units(arrays: Sequence[Any]) -> list[np.ndarray]:
    """The identity on the numbers of these arrays, (P, *shape) for each."""
    sizes = [one.size for one in arrays]
    parts = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1], axis=1)
    return [part.reshape(-1, *one.shape).astype(one.dtype) for part, one in zip(parts, arrays, strict=True)]


def _smooth(variable: Any) -> bool:
    return jnp.issubdtype(variable.aval.dtype, jnp.floating)


def _dotted(path: Any) -> str:
    return ".".join(str(getattr(step, "name", getattr(step, "idx", getattr(step, "key", step)))) for step in path)
