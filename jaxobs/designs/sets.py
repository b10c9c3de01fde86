"""Where bounds on a Jacobian hold: sets of states, each with the sentence that says what is proved and what is assumed.

    Box         assumed: "conditional on ..."; with infinite ends nothing is assumed
    Band        the same for combinations of states, such as a difference of two angles
    Data        the extremes of samples: conditional, and observed only
    Invariant   never left by the state, proved (`invariant`)
    Absorbing   entered from every start and never left, proved (`absorbing`)
    Around      one of these for the state, a margin around it for the estimate: what a regional certificate stands on

A set holds bounds on x alone; where the estimate is follows from the observer: `Saturated` plants leave it free.
"""

import abc
import dataclasses
from typing import Any, NamedTuple

import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import exact
from jaxobs.certificates.base import Verdict
from jaxobs.designs._system import system
from jaxobs.intervals import Interval
from jaxobs.intervals.expressions import is_float
from jaxobs.intervals.jacobian import JacobianBounds, jacobian_bounds


class Coordinates(NamedTuple):
    """x = t z with lower <= z <= upper, t (n, n) an invertible matrix of floats; names: what the z_i are."""

    t: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    names: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class AbstractSet(abc.ABC):
    """A set of states inside the box lower <= x <= upper (n,), infinite ends allowed: the box is what bounds are taken on.

    lower, upper: numbers for each state, kept as float64 arrays (n,). ValueError where they do not fit.
    """

    lower: Any
    upper: Any

    def __post_init__(self):
        for name in ("lower", "upper"):
            object.__setattr__(self, name, np.atleast_1d(np.array(getattr(self, name), float)))
        if self.lower.ndim != 1 or self.lower.shape != self.upper.shape:
            given = f"shapes {self.lower.shape} and {self.upper.shape}"
            raise refuse(self, "lower, upper", given, "shape (n,) both", "One number a state.")
        if not np.all(self.lower <= self.upper):
            raise refuse(self, "lower", f"{self.lower.tolist()} .. {self.upper.tolist()}", "lower <= upper", "Swap the two.")

    @property
    @abc.abstractmethod
    def state(self) -> str:
        """Where the state is, and how that is known: a sentence of the certificate's assumptions."""

    @property
    def assumed(self) -> bool:
        """Whether the sentence is an assumption, and no theorem about the model."""
        return True

    def verify(self) -> Verdict:
        """Repeats the proof, where there is one: by interval or exact rational arithmetic, from f and the stored numbers."""
        return Verdict(True, {}, f"nothing to prove: {self.state}")

    @property
    def bounded(self) -> bool:
        """Whether the set has an end at all."""
        return bool(np.any(np.isfinite(self.lower) | np.isfinite(self.upper)))

    @property
    def box(self) -> str:
        """The finite sides in words, every digit."""
        ends = enumerate(zip(self.lower.tolist(), self.upper.tolist(), strict=True))
        return ", ".join(f"x{i + 1} in [{a!r}, {b!r}]" for i, (a, b) in ends if (a, b) != (-np.inf, np.inf))

    @property
    def coordinates(self) -> "Coordinates":
        """Those in which the set is inside a box."""
        names = tuple(f"x{i + 1}" for i in range(len(self.lower)))
        return Coordinates(np.eye(len(names)), self.lower, self.upper, names)

    def bounds(self, f: Any, inputs: Any = None, **options: Any) -> JacobianBounds:
        """`jacobian_bounds` of a plant's flow or step, or of f(x) or f(x, u), on the box; inputs: (lower, upper) of u."""
        made = system("bounds", f, inputs)
        if not len(made.lower):
            return jacobian_bounds(lambda x: made.f(x, x[:0]), Interval(self.lower, self.upper), **options)
        return jacobian_bounds(made.f, (Interval(self.lower, self.upper), Interval(made.lower, made.upper)), **options)


@dataclasses.dataclass(frozen=True)
class Box(AbstractSet):
    """lower <= x <= upper, assumed of the state (and of the estimate, unless it is saturated); infinite ends assume nothing."""

    @property
    def assumed(self) -> bool:
        return self.bounded

    @property
    def state(self) -> str:
        return f"conditional on the state staying in {self.box}" if self.bounded else "for every state"


def everywhere(n: int) -> Box:
    """R^n."""
    return Box(np.full(n, -np.inf), np.full(n, np.inf))


@dataclasses.dataclass(frozen=True)
class Band(AbstractSet):
    """least <= rows x <= most, rows (k, n), assumed of the state and its estimate. Made by `band`."""

    rows: np.ndarray
    least: np.ndarray
    most: np.ndarray

    @property
    def bounded(self) -> bool:
        return True

    @property
    def state(self) -> str:
        ends = zip(self.rows.tolist(), self.least.tolist(), self.most.tolist(), strict=True)
        words = ", ".join(f"{_combination(row)} in [{a!r}, {b!r}]" for row, a, b in ends)
        return f"conditional on the state staying in {words}"

    @property
    def coordinates(self) -> Coordinates:
        n = len(self.lower)
        full, low, high = list(self.rows), list(self.least), list(self.most)
        for unit in np.eye(n)[::-1]:  # states as they are, until there are n coordinates
            if len(full) < n and np.linalg.matrix_rank(np.array([*full, unit])) > len(full):
                full, low, high = [*full, unit], [*low, -np.inf], [*high, np.inf]
        inverse = exact.inverse(exact.matrix(np.array(full).tolist()))
        if inverse is None or not all(is_float(x) for row in inverse for x in row):
            fix = "Rows such as [-1, 0, 1, 0] do; scale them, or introduce coordinates."
            raise refuse(self, "rows", self.rows.tolist(), "independent rows whose inverse has float entries", fix)
        names = [_combination(row) for row in np.array(full).tolist()]
        names = tuple(name if name[0] == "x" and " " not in name else f"({name})" for name in names)
        return Coordinates(np.array([[float(x) for x in row] for row in inverse]), np.array(low), np.array(high), names)


def band(rows: Any, least: Any, most: Any) -> Band:
    """{x : least <= rows x <= most}, rows (k, n), independent; least, most (k,)."""
    rows, least, most = (np.array(one, float) for one in (rows, least, most))
    if rows.ndim != 2 or least.shape != rows.shape[:1] or most.shape != least.shape or not np.all(least <= most):
        given = f"shapes {rows.shape}, {least.shape}, {most.shape}"
        raise refuse("band", "rows, least, most", given, "shapes (k, n), (k,), (k,) with least <= most", "One pair a row.")
    found = Band(np.full(rows.shape[1], -np.inf), np.full(rows.shape[1], np.inf), rows=rows, least=least, most=most)
    _ = found.coordinates  # refuses rows that are no coordinates
    return found


@dataclasses.dataclass(frozen=True)
class Data(AbstractSet):
    """The extremes of recorded or simulated states, widened by `margin` times their spread on each side."""

    samples: int
    margin: float

    @property
    def state(self) -> str:
        wider = f", widened by {self.margin:.6g} of their spread" if self.margin else ""
        return f"conditional on staying here: within the extremes of {self.samples} samples{wider}, {self.box}"


def data(xs: Any, margin: float = 0.0) -> Data:
    """The box of the rows of xs (samples, n). They prove nothing about states that were not sampled."""
    samples = np.asarray(xs, float)
    if samples.ndim != 2 or not len(samples) or not np.all(np.isfinite(samples)):
        fix = "One row a sample, one column a state."
        raise refuse("data", "xs", f"shape {samples.shape}", "finite numbers, shape (samples, n), samples >= 1", fix)
    if not (np.isfinite(margin) and margin >= 0):
        raise refuse("data", "margin", repr(margin), "a number >= 0", "0.1 widens each side by a tenth of the spread.")
    low, high = samples.min(axis=0), samples.max(axis=0)
    room = margin * (high - low)
    return Data(low - room, high + room, len(samples), float(margin))


@dataclasses.dataclass(frozen=True)
class Around(AbstractSet):
    """The state in `inner`, its estimate within `width` of it, |e_i| <= width_i: bounds hold on inner's box widened by width.

    That the error stays so small is what a regional certificate proves, for errors that start inside a level set:
    regional(model, gain, inner=(inner.lower, inner.upper), outer=(lower, upper)). Made by `around`.
    """

    inner: AbstractSet
    width: np.ndarray

    @property
    def state(self) -> str:
        widths = ", ".join(f"|e{i + 1}| <= {w:.17g}" for i, w in enumerate(self.width))
        return f"{self.inner.state}; and while {widths}"

    def verify(self) -> Verdict:
        return self.inner.verify()


def around(inner: AbstractSet, width: Any) -> Around:
    """The set `inner` with room for an error of half widths `width` (n,) > 0, infinite where there is no need for any."""
    width = np.broadcast_to(np.asarray(width, float), inner.lower.shape)
    if not np.all(width > 0):
        raise refuse("around", "width", width.tolist(), "positive numbers", "They are the errors |e_i| that are allowed.")
    return Around(
        np.nextafter(inner.lower - width, -np.inf), np.nextafter(inner.upper + width, np.inf), inner=inner, width=width
    )


def _combination(row: list[float]) -> str:
    parts = [("" if abs(k) == 1 else f"{abs(k)!r} ") + f"x{i + 1}" for i, k in enumerate(row) if k]
    signs = [" - " if k < 0 else " + " for k in row if k]
    words = "".join(f"{sign}{part}" for sign, part in zip(signs, parts, strict=True))
    return words.removeprefix(" + ") if words[:3] == " + " else "-" + words[3:]
