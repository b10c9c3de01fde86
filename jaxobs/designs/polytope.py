"""Error dynamics with bounded, otherwise unknown parameters: what LPV designs work on."""

import dataclasses
import itertools
from typing import Any

import numpy as np

from jaxobs._module import refuse, require_integer

LARGEST = 12  # channels: 4,096 corners


@dataclasses.dataclass(frozen=True)
class Polytope:
    """e' = (a + sum_k rho_k(t) b_k c_k' - L output) e,   lower_k <= rho_k(t) <= upper_k, or the same with e+ in place of e'.

    a (n, n); b (n, r), its columns b_k; c (r, n), its rows c_k'; lower, upper (r,); output (p, n). float64 copies on the host.
    tied (r,): channels with the same number have the same rho (and bounds), so that a parameter may enter with any rank; ()
    when each channel has its own. ValueError for shapes that do not fit, lower > upper, numbers that are not finite, more than
    12 parameters.
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    output: np.ndarray
    tied: tuple[int, ...] = ()

    def __post_init__(self):
        for field in dataclasses.fields(self)[:6]:
            object.__setattr__(self, field.name, np.array(getattr(self, field.name), float))
        n, r = (len(self.a) if self.a.ndim else 0), self.lower.shape[0] if self.lower.ndim else 0
        p = self.output.shape[0] if self.output.ndim else 0
        shapes = {"a": (n, n), "b": (n, r), "c": (r, n), "lower": (r,), "upper": (r,), "output": (p, n)}
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape:
                fix = (
                    "One column of b, one row of c and one pair of bounds for each channel; one row of output for each output."
                )
                raise refuse("Polytope", name, f"shape {value.shape}", f"shape {shape}", fix)
            if not np.all(np.isfinite(value)):
                raise refuse("Polytope", name, value.tolist(), "finite numbers", "A channel without bounds has no corners.")
        object.__setattr__(self, "tied", tuple(int(k) for k in self.tied) or tuple(range(r)))
        if len(self.tied) != r:
            raise refuse("Polytope", "tied", self.tied, f"{r} integers", "One number a channel; equal ones share a parameter.")
        if len(set(self.tied)) > LARGEST:
            fix = "Tie entries that are equal, leave out those that are constant: see jaxobs.designs.lpv_lmi."
            raise refuse("Polytope", "lower", f"{len(set(self.tied))} parameters", f"at most {LARGEST}", fix)
        if (crossed := np.flatnonzero(self.lower > self.upper)).size:
            k = int(crossed[0])
            raise refuse("Polytope", "lower", f"lower[{k}] = {self.lower[k]:.6g} > upper[{k}] = {self.upper[k]:.6g}",
                         "lower <= upper", "Swap the two bounds.")  # fmt: skip
        for k, first in enumerate(self._first):
            if (self.lower[k], self.upper[k]) != (self.lower[first], self.upper[first]):
                raise refuse("Polytope", "tied", f"channels {first} and {k} tied, with different bounds", "equal bounds",
                             "They are one parameter.")  # fmt: skip

    @property
    def n(self) -> int:
        return self.a.shape[0]

    @property
    def p(self) -> int:
        return self.output.shape[0]

    @property
    def r(self) -> int:
        return self.lower.shape[0]

    @property
    def _first(self) -> list[int]:
        """For each channel, the first one with the same parameter."""
        return [self.tied.index(k) for k in self.tied]

    def fields(self) -> dict[str, Any]:
        """What certificates store of it, in tuples."""
        fields: dict[str, Any] = {"tied": self.tied if len(set(self.tied)) < self.r else ()}
        return fields | {name: as_tuples(getattr(self, name)) for name in ("a", "b", "c", "lower", "upper", "output")}

    def at(self, rho: np.ndarray) -> np.ndarray:
        """a + sum_k rho_k b_k c_k'."""
        return self.a + (self.b * rho) @ self.c

    def parameters(self) -> np.ndarray:
        """The values of rho at the corners, (corners, r); a parameter with equal bounds has one value."""
        own = sorted(set(self._first))
        values = itertools.product(*(sorted({self.lower[k], self.upper[k]}) for k in own))
        return np.array([[value[own.index(k)] for k in self._first] for value in values], float)

    def corners(self) -> np.ndarray:
        """The matrices at the corners, without the gain, (corners, n, n)."""
        return np.stack([self.at(rho) for rho in self.parameters()])

    def closed(self, gain: np.ndarray) -> np.ndarray:
        """The matrices at the corners with the gain L (n, p) in place."""
        gain = np.asarray(gain, float)
        if gain.shape != (self.n, self.p):
            fix = "L has one row a state and one column an output."
            if gain.shape == (self.p, self.n):
                fix += " It looks transposed."
            raise refuse("Polytope", "gain", f"shape {gain.shape}", f"shape {(self.n, self.p)}", fix)
        return self.corners() - gain @ self.output

    def in_coordinates(self, t: np.ndarray) -> "Polytope":
        """The same dynamics of t^-1 e, for an invertible t (n, n). A gain there is t^-1 L."""
        inverse = np.linalg.inv(t)
        return Polytope(inverse @ self.a @ t, inverse @ self.b, self.c @ t, self.lower, self.upper, self.output @ t, self.tied)

    def in_time(self, unit: float) -> "Polytope":
        """The same dynamics in the time t / unit: every rate times unit. A gain there is unit L."""
        return Polytope(self.a * unit, self.b * unit, self.c, self.lower, self.upper, self.output, self.tied)

    def behind(self, q: int) -> "Polytope":
        """The error (eps, e) of an observer whose innovation passes q integrators: eps_i' = eps_{i+1}, eps_q' = output e, and
        the gain (q + n, 1) acts on eps_1. For one output; e itself for q = 0."""
        require_integer("Polytope.behind", "q", q, 0, "It counts the integrators between innovation and injection.")
        if q == 0:
            return self
        if self.p != 1:
            raise refuse("Polytope.behind", "q", q, "0 for more than one output", "Integrators are for a single output here.")
        a = np.block([[np.eye(q, k=1), np.zeros((q, self.n))], [np.zeros((self.n, q)), self.a]])
        a[q - 1, q:] = self.output[0]
        b, c = np.pad(self.b, ((q, 0), (0, 0))), np.pad(self.c, ((0, 0), (q, 0)))
        return Polytope(a, b, c, self.lower, self.upper, np.eye(1, q + self.n), self.tied)


def as_tuples(array: np.ndarray) -> tuple[Any, ...]:
    """Nested tuples of floats, as certificates store arrays of one axis or more."""
    return tuple(map(as_tuples, array)) if array.ndim > 1 else tuple(float(x) for x in array)
