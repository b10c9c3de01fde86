"""Orders of the states in which a plant is a chain, or triangular, and the parts of x' = A x + B f(x) + g(y, u)."""

import numpy as np

from jaxobs.structure.pattern import Pattern

TIMED = "f depends on t: let the time enter as an input"


class NotThisForm(Exception):
    """Why a plant does not have a form."""


def measured(output: Pattern) -> tuple[int, ...]:
    """The state that each output is; NotThisForm where one is no single state."""
    for i, j in enumerate(output.identity):
        if j < 0:
            raise NotThisForm(f"y{i + 1} is not one of the states")
    return tuple(map(int, output.identity))


def chain_order(flow: Pattern, output: Pattern) -> tuple[int, ...]:
    """(i_1, ..., i_n) with y = x_{i_1} and x_{i_k}' = x_{i_{k+1}}."""
    order = _start(flow, output)
    while len(order) < flow.n:
        i = order[-1]
        j = int(flow.identity[i])
        if j < 0:
            raise NotThisForm(f"x{i + 1}' is not one of the states")
        if j in order:
            raise NotThisForm(f"x{i + 1}' is x{j + 1}, and the other states are not seen")
        order.append(j)
    return tuple(order)


def triangular_order(flow: Pattern, output: Pattern) -> tuple[int, ...]:
    """(i_1, ..., i_n) with y = x_{i_1}, x_{i_k}' of the first k + 1 of them, linear in the last of these.

    There is one such order at most: each row says which state comes next.
    """
    order = _start(flow, output)
    while len(order) < flow.n:
        i = order[-1]
        ahead = [int(j) for j in np.flatnonzero(flow.kinds[i] != "0") if j not in order]
        if len(ahead) != 1:
            left = _names(ahead or [j for j in range(flow.n) if j not in order])
            raise NotThisForm(
                f"x{i + 1}' depends on {left} at once" if ahead else f"x{i + 1}' depends on no further state, {left} are left"
            )
        if flow.kinds[i, ahead[0]] == "*":
            raise NotThisForm(f"the coupling dx{i + 1}'/dx{ahead[0] + 1} depends on the state")
        order += ahead
    return tuple(order)


def blocks_of(flow: Pattern, output: Pattern) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """(order, sizes): y is the first block, the flow of each block depends on the next one, linearly, and on none behind it."""
    if output.n and len(output.identity) < 2:
        raise NotThisForm("there is one output: see triangular")
    block = list(measured(output))
    _require_untimed(flow)
    if len(set(block)) < len(block):
        raise NotThisForm("two outputs are one state")
    order, sizes = list(block), [len(block)]
    while len(order) < flow.n:
        rows = flow.kinds[block]
        ahead = [int(j) for j in np.flatnonzero(np.any(rows != "0", axis=0)) if j not in order]
        if not ahead:
            left = _names([j for j in range(flow.n) if j not in order])
            raise NotThisForm(f"{left} do not enter the flow of {_names(block)}")
        if len(ahead) > len(block):
            raise NotThisForm(f"the flow of {_names(block)} depends on {_names(ahead)}: more than it has components")
        if np.any(rows[:, ahead] == "*"):
            raise NotThisForm(f"the coupling of {_names(block)} to {_names(ahead)} depends on the state")
        order, sizes, block = order + ahead, [*sizes, len(ahead)], ahead
    return tuple(order), tuple(sizes)


def lipschitz_parts(flow: Pattern, output: Pattern) -> tuple[tuple[int, ...], tuple[int, ...], tuple[tuple[int, int], ...]]:
    """(rows, measured, entries) of `plants.LipschitzOf`: rows that are nonlinear in a state which is not measured, what is
    measured, and the constant entries of df/dx."""
    if not output.linear:
        raise NotThisForm("y is not C x")
    _require_untimed(flow)
    seen = tuple(map(int, output.identity)) if np.all(output.identity >= 0) else ()
    hidden = [j for j in range(flow.n) if j not in seen]
    for i in range(flow.n):
        for j in hidden:
            if flow.support[i, j] & flow.inputs:
                raise NotThisForm(f"dx{i + 1}'/dx{j + 1} depends on an input, and x{j + 1} is not measured")
    rows = tuple(i for i in range(flow.n) if any(flow.kinds[i, j] == "*" for j in hidden))
    entries = tuple((int(i), int(j)) for i, j in np.argwhere(np.isin(flow.kinds, ["1", "c"])))
    return rows, seen, entries


def _start(flow: Pattern, output: Pattern) -> list[int]:
    if len(output.identity) != 1:
        raise NotThisForm(f"there are {len(output.identity)} outputs")
    _require_untimed(flow)
    return list(measured(output))


def _require_untimed(flow: Pattern) -> None:
    if flow.timed:
        raise NotThisForm(TIMED)


def _names(states: list[int]) -> str:
    return " and ".join(f"x{j + 1}" for j in states)
