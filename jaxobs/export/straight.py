"""One sample as straight-line code, assignments between numbers and loops of a fixed length: what C and NumPy are made from."""

import dataclasses
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.ad_checkpoint import checkpoint_name

from jaxobs import scalars
from jaxobs._module import check, dtype_of
from jaxobs.export.lines import Cell, Line, Operand, assigned, needed, read
from jaxobs.export.tick import Tick
from jaxobs.export.unrolled import Unrolled, unrolled

NAMED = ("gain", "inner")  # parameters of observers that become tables, beside the values that observers name so


class Function(NamedTuple):
    """lines, then the results."""

    lines: tuple[Line, ...]
    results: tuple[Operand, ...]


@dataclasses.dataclass(frozen=True)
class Straight:
    """start(xhat0) -> z and step(z, k, u, y) -> (z, xhat) of n states, m inputs and p outputs in the precision `real`.

    dtypes: of the entries of z, a flat vector. tables: the gains, (N,) or (N, p). What no step changes, e.g. the matrices of an
    exponential integrator, is no part of z. The results of `step` are those of z, then xhat.
    """

    n: int
    m: int
    p: int
    real: np.dtype
    dtypes: tuple[np.dtype, ...]
    tables: dict[str, np.ndarray]
    start: Function
    step: Function

    @property
    def uses_k(self) -> bool:
        """Whether the sample's number enters."""
        return any(isinstance(one, Cell) and one.of == "k" for one in read(self.step.lines, self.step.results))


def straight(tick: Tick) -> Straight:
    """The one sample of `tick`, with its parameters as numbers. Unsupported, a ValueError, names what cannot be written so."""
    check(tick)
    observer, dtype = tick.observer, np.dtype(dtype_of(tick.observer))
    xhat0, u, y = (np.zeros((size,), dtype) for size in (observer.n, observer.m, observer.p))
    shapes = jax.eval_shape(tick.start, xhat0)
    leaves, tree = jax.tree.flatten(shapes)
    begin, _ = scalars.trace(lambda x: jax.tree.leaves(tick.start(x)), xhat0)

    def step(leaves: list[Any], k: Any, u: Any, y: Any) -> list[Any]:
        state, xhat = _with_names(tick)(k, jax.tree.unflatten(tree, leaves), u, y)
        return [*jax.tree.leaves(state), xhat]

    zeros = [np.zeros(one.shape, one.dtype) for one in leaves]
    whole, _ = scalars.trace(step, zeros, np.zeros((), np.int32), u, y)
    fixed = _fixed(begin, whole, len(leaves))
    moving = [i for i in range(len(leaves)) if i not in fixed]
    start = unrolled(begin._replace(outputs=tuple(begin.outputs[i] for i in moving)), {}, {"xhat0": begin.inputs[0]})
    inputs = {f"z{i}": whole.inputs[i] for i in moving} | dict(zip("kuy", whole.inputs[len(leaves) :], strict=True))
    outputs = (*(whole.outputs[i] for i in moving), whole.outputs[-1])
    stepped = unrolled(whole._replace(outputs=outputs), {whole.inputs[i]: one for i, one in fixed.items()}, inputs)
    return Straight(
        observer.n, observer.m, observer.p, dtype,
        dtypes=tuple(np.dtype(leaves[i].dtype) for i in moving for _ in range(leaves[i].size)),
        tables=stepped.tables,
        start=_function(start, {"xhat0": start.cells["xhat0"]}),
        step=_function(stepped, _joined(stepped, [f"z{i}" for i in moving])),
    )  # fmt: skip


def _with_names(tick: Tick) -> Tick:
    """The same with the parameters of NAMED under their names; those of a model are none of the observer's."""

    def name(path: tuple[Any, ...], leaf: Any) -> Any:
        fields = [getattr(step, "name", None) for step in path]
        return checkpoint_name(leaf, fields[-1]) if fields[-1] in NAMED and "model" not in fields else leaf

    return jax.tree_util.tree_map_with_path(name, tick)


def _fixed(begin: Any, whole: Any, count: int) -> dict[int, np.ndarray]:
    """The leaves of z that do not depend on xhat0 and that no step changes: their values."""
    first, _ = scalars.split(begin, set())
    env: dict[Any, Any] = {}
    scalars.evaluate(begin, first, env, 0, rules=False)
    values = {}
    for i, (out, before, after) in enumerate(zip(begin.outputs, whole.inputs[:count], whole.outputs[:count], strict=True)):
        if before is after and (isinstance(out, np.ndarray) or out in env or out in begin.constants):
            values[i] = np.asarray(scalars.as_whole(scalars.value_of(out, begin, env), 0).array)
    return values


def _joined(one: Unrolled, moving: list[str]) -> dict[str, tuple[Any, ...]]:
    """The leaves of z as one flat vector."""
    rest = {name: cells for name, cells in one.cells.items() if name not in moving}
    return {"z": tuple(cell for name in moving for cell in one.cells[name])} | rest


def _function(one: Unrolled, cells: dict[str, tuple[Any, ...]]) -> Function:
    where: dict[Any, Operand] = {variable: Cell(name, i) for name, all_ in cells.items() for i, variable in enumerate(all_)}
    lines = assigned(one.program, where)
    results = tuple(where[end] if not isinstance(end, np.generic) else end for end in one.results)
    return Function(needed(lines, results), results)
