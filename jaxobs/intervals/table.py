"""The table of rules: for each JAX primitive, how its enclosure follows from those of its arguments."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxobs.intervals.interval import Interval, point
from jaxobs.intervals.rounding import Numbers, Truths

Rule = Callable[..., "Interval | Sequence[Interval]"]
RULES: dict[str, Rule] = {}


class UnknownPrimitiveError(NotImplementedError):
    """A program uses a primitive that has no rule, or a rule in a way that it does not cover."""


@dataclasses.dataclass
class Notes:
    """What an enclosure assumes: no jump where a switch is undecided, and arguments inside the domain of each function."""

    jumps: dict[str, None] = dataclasses.field(default_factory=dict)  # dict for a set that keeps its order
    undefined: dict[str, None] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Call:
    """One equation of a jaxpr while it is evaluated, as its rule sees it."""

    eqn: Any
    notes: Notes
    path: tuple[str, ...]  # names of the functions that enclose the equation
    defined_by: dict[Any, Any]  # variable -> equation
    value: Callable[[Any], Interval]  # of a variable or literal, known so far
    run: Callable[..., list[Interval]]  # (call, jaxpr, arguments): evaluate an inner jaxpr

    @property
    def name(self) -> str:
        return self.eqn.primitive.name

    @property
    def params(self) -> dict[str, Any]:
        return self.eqn.params

    @property
    def where(self) -> str:
        return " in ".join([self.name, *reversed(self.path)])

    @property
    def shape(self) -> tuple[int, ...]:
        return self.eqn.outvars[0].aval.shape

    @property
    def dtype(self) -> np.dtype:
        return np.dtype(self.eqn.outvars[0].aval.dtype)

    def dtype_in(self, i: int) -> np.dtype:
        return np.dtype(self.eqn.invars[i].aval.dtype)

    def same(self, i: int, j: int) -> bool:
        """Whether two arguments are one variable."""
        return same(self.eqn.invars[i], self.eqn.invars[j])

    def definition(self, i: int) -> Any:
        """The equation that defines an argument, None for an input or a literal."""
        variable = self.eqn.invars[i]
        return None if hasattr(variable, "val") else self.defined_by.get(variable)

    def jump(self, what: str) -> None:
        """Notes that f has to be continuous where this is undecided."""
        self.notes.jumps[f"continuous where {what} is undecided on the box ({self.where})"] = None

    def undefined(self, what: str) -> None:
        """Notes that f may be undefined on the box."""
        self.notes.undefined[f"{what} ({self.where})"] = None

    def refuse(self, what: str, fix: str) -> UnknownPrimitiveError:
        """The error that names the equation, for the rule to raise."""
        return UnknownPrimitiveError(f"{self.where}: {what}. {fix}")


def same(a: Any, b: Any) -> bool:
    """One variable, or two literals of one value."""
    if hasattr(a, "val") and hasattr(b, "val"):
        return np.shape(a.val) == np.shape(b.val) and bool(np.all(a.val == b.val))
    return a is b


def reduced_extreme(defined_by: dict[Any, Any], x: Any, extreme: Any) -> tuple[str, tuple[int, ...]]:
    """("reduce_max" or "reduce_min", its axes) where a variable is that of x, its axes kept; ("", ()) elsewhere."""
    spread = None if hasattr(extreme, "val") else defined_by.get(extreme)
    if spread is None or spread.primitive.name not in ("reshape", "broadcast_in_dim") or hasattr(spread.invars[0], "val"):
        return "", ()
    eqn = defined_by.get(spread.invars[0])
    if eqn is None or eqn.primitive.name not in ("reduce_max", "reduce_min") or eqn.invars[0] is not x:
        return "", ()
    axes = tuple(int(a) for a in eqn.params["axes"])
    kept = tuple(i for i in range(len(x.aval.shape)) if i not in axes)
    shape = tuple(n if i in kept else 1 for i, n in enumerate(x.aval.shape))
    if spread.primitive.name == "reshape" and spread.params["dimensions"] is not None:
        return "", ()
    if extreme.aval.shape != shape or tuple(spread.params.get("broadcast_dimensions", kept)) != kept:
        return "", ()
    return eqn.primitive.name, axes


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Register a function (call, *arguments) -> Interval, or a sequence of them, under the names of primitives."""

    def register(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        return function

    return register


def within(call: Call, x: Interval) -> Interval:
    """Integers that overflow wrap around, so that their enclosure becomes every number of their type."""
    if call.dtype.kind not in "iu" or x.lower.size == 0:
        return x
    info = np.iinfo(call.dtype)
    if x.lower.min() >= info.min and x.upper.max() < info.max:  # float(info.max) may lie above it
        return x
    return Interval(np.full(x.shape, float(info.min)), np.full(x.shape, float(info.max)))


def truth(yes: Truths, no: Truths) -> Interval:
    """Three values: [1, 1] where certainly true, [0, 0] where certainly false, [0, 1] elsewhere."""
    return Interval(np.where(yes, 1.0, 0.0), np.where(no, 0.0, 1.0))


def undecided(x: Interval) -> bool:
    """Whether any entry is more than one number."""
    return not x.is_point


def exactly(function: Callable[..., Numbers], *args: Interval) -> Interval:
    """An operation on numbers that are all single and exact, e.g. bits of integers."""
    return point(function(*[x.lower for x in args]))
