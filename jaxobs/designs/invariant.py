"""Sets that the state never leaves, proved by interval arithmetic over their boundary."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates.base import Verdict
from jaxobs.designs._system import System, system
from jaxobs.designs.sets import AbstractSet
from jaxobs.intervals import Interval
from jaxobs.intervals.negative import is_negative


@dataclasses.dataclass(frozen=True)
class Invariant(AbstractSet):
    """A set that x' = f(x, u) does not leave, for any u(t) in `inputs`: with a function V, {x in the box : V(x) <= level},

        V' = grad V f < 0 where V = level in the box,      V > level on the faces of the box,

    and without one the box itself,   f_i < 0 where x_i = upper_i,   f_i > 0 where x_i = lower_i.   Proved by halving the
    boundary until interval enclosures show the signs; `verify` does it again. f: a flow plant or a function; inputs: (lower,
    upper) of u, None without inputs. Source: Nagumo's theorem; F. Blanchini, Automatica 35 (1999), 1747-1767.
    """

    f: Any = None
    v: Callable[[Any], Any] | None = None
    level: float = 0.0
    inputs: Any = None
    max_boxes: int = 20_000

    def __post_init__(self):
        AbstractSet.__post_init__(self)
        if system("Invariant", self.f, self.inputs).step:
            fix = "A step may jump over the boundary: prove it of the flow."
            raise refuse(self, "f", type(self.f).__name__, "a flow, x' = f", fix)
        if self.v is not None and not np.all(np.isfinite([self.lower, self.upper])):
            fix = "The box has to contain the part of {V <= level} that is meant."
            raise refuse(self, "lower, upper", f"{self.lower.tolist()} .. {self.upper.tolist()}", "finite numbers", fix)

    @property
    def assumed(self) -> bool:
        return True  # that the state starts inside

    @property
    def state(self) -> str:
        what = f"the set V <= {self.level!r} in" if self.v is not None else "the box"
        return f"the state starts in, and by interval arithmetic never leaves, {what} {self.box}{_of_inputs(self.inputs)}"

    def verify(self) -> Verdict:
        made, boxes = system("Invariant", self.f, self.inputs), 0
        for what, found in self._conditions(made):
            boxes += found.boxes
            if not found:
                return Verdict(False, {}, f"not proved: {what}, for instance on {found.where} ({boxes} boxes)")
        return Verdict(True, {"boxes": float(boxes)}, f"the state never leaves the set: {boxes} boxes of its boundary")

    def _conditions(self, made: System):
        n = len(self.lower)
        low, high = np.append(self.lower, made.lower), np.append(self.upper, made.upper)

        def rate(i: int):
            return lambda z: made.f(z[:n], z[n:])[i]

        if self.v is None:
            for i in range(n):
                for end, sign in ((self.upper, 1.0), (self.lower, -1.0)):
                    if np.isfinite(end[i]):
                        face = Interval(*(_fixed(side, i, end[i]) for side in (low, high)))
                        what = f"f{i + 1} {'<' if sign > 0 else '>'} 0 where x{i + 1} = {end[i]:.6g}"
                        yield what, is_negative(_signed(rate(i), sign), face, max_boxes=self.max_boxes)
            return
        v, level = self.v, self.level
        for i in range(n):
            for end in (self.upper, self.lower):
                face = Interval(*(_fixed(side, i, end[i]) for side in (self.lower, self.upper)))
                found = is_negative(lambda x: level - v(x), face, max_boxes=self.max_boxes)
                yield f"V > {level:.6g} where x{i + 1} = {end[i]:.6g}", found
        falls = is_negative(along(v, made, n), Interval(low, high), on=lambda z: v(z[:n]) - level, max_boxes=self.max_boxes)
        yield f"V' < 0 where V = {level:.6g}", falls


def along(v: Callable[[Any], Any], made: System, n: int) -> Callable[[Any], Any]:
    """z = (x, w) -> V' = grad V(x) f(x, w)."""
    return lambda z: jax.jvp(v, (z[:n],), (made.f(z[:n], z[n:]),))[1]


def _of_inputs(inputs: Any) -> str:
    if inputs is None:
        return ""
    low, high = (np.atleast_1d(np.asarray(end, float)).tolist() for end in inputs)
    return f", for u within {low} .. {high}"


def _fixed(end: np.ndarray, i: int, value: float) -> np.ndarray:
    end = end.copy()
    end[i] = value
    return end


def _signed(g: Callable[[Any], Any], sign: float) -> Callable[[Any], Any]:
    return g if sign > 0 else lambda z: -g(z)
