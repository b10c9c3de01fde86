"""The inequality (62) of the Euler model in coordinates of choice, and the programs that are made of it."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs.designs import sdp
from jaxobs.designs.norm_bounded import NormBounded


@dataclasses.dataclass(frozen=True)
class Coordinates:
    """The chain behind q integrators for zeta with e = t zeta, in the time t / unit; M and N made of equal norm.

    t (N, N); a, c, m, n: A, C, M, N there; balance: epsilon here is balance times epsilon there.
    """

    t: np.ndarray
    unit: float
    a: np.ndarray
    c: np.ndarray
    m: np.ndarray
    n: np.ndarray
    balance: float

    @staticmethod
    def make(slope: NormBounded, q: int, unit: float, metric: np.ndarray | None = None) -> "Coordinates":
        """t = diag(unit^{1-i}), in which a chain is well scaled; given a metric X of those, others in which it is I."""
        size = slope.n + q
        t = np.diag(float(unit) ** -np.arange(size, dtype=float))
        if metric is not None:
            t = np.linalg.solve(np.linalg.cholesky(metric), t).T  # t diag: t' = R^-1 diag, X = R R'
        inverse = np.linalg.inv(t)
        m, n = slope.behind(q)
        m, n = unit * inverse @ m, n @ t
        ratio = float(np.linalg.norm(n, 2) / np.linalg.norm(m, 2))
        a = unit * inverse @ np.eye(size, k=1) @ t
        return Coordinates(t, unit, a, t[:1], m * np.sqrt(ratio), n / np.sqrt(ratio), ratio)

    @property
    def size(self) -> int:
        return len(self.t)

    def blocks(self, x: np.ndarray, xk: np.ndarray, xm: np.ndarray, epsilon: Any, factor: float = 1.0) -> np.ndarray:
        """The matrix of (62) from X, X K and dt X M."""
        nothing = np.zeros(self.m.shape)
        return np.block(
            [
                [factor**2 * x - epsilon * self.n.T @ self.n, -xk.T, nothing],
                [-xk, x, -xm],
                [nothing.T, -xm.T, epsilon * np.eye(self.m.shape[1])],
            ]
        )

    def matrix(self, x: np.ndarray, xl: np.ndarray, epsilon: Any, dt: float, factor: float = 1.0) -> np.ndarray:
        """The matrix of (62) from X and X L."""
        step = dt / self.unit
        return self.blocks(x, x + step * x @ self.a - xl @ self.c, step * x @ self.m, epsilon, factor)

    def back(self, x: np.ndarray) -> np.ndarray:
        """X in the coordinates of e, symmetric to the last digit."""
        inverse = np.linalg.inv(self.t)
        original = inverse.T @ x @ inverse
        return (original + original.T) / 2


@dataclasses.dataclass(frozen=True)
class Attempt:
    """A solution of (62), or the closest to one: L (N,), X and epsilon for e itself; margin and bound of the program."""

    gain: np.ndarray
    x: np.ndarray
    epsilon: float
    margin: float
    bound: float


def attempt(tied: bool, slope: NormBounded, q: int, dt: float, unit: float, factor: float) -> Attempt:
    """X, epsilon (and X L, if it is not tied to C') of the largest margin."""
    here = Coordinates.make(slope, q, unit)
    if tied:
        unknowns = {"x": sdp.symmetric(here.size), "epsilon": sdp.scalar()}
        found = sdp.feasible(unknowns, lambda x, epsilon: [here.matrix(x, here.c.T, epsilon, dt, factor)])
    else:  # homogeneous
        unknowns = {"x": sdp.symmetric(here.size, trace=1.0), "epsilon": sdp.scalar(), "xl": sdp.full(here.size, 1)}
        found = sdp.feasible(unknowns, lambda x, epsilon, xl: [here.matrix(x, xl, epsilon, dt, factor)])
    if not found.values:
        nothing = np.full(here.size, np.nan)
        return Attempt(nothing, np.diag(nothing), np.nan, -np.inf, np.inf)
    x, xl = found.values["x"], found.values.get("xl", here.c.T)
    with np.errstate(all="ignore"):
        gain = here.t @ np.linalg.lstsq(x, xl, rcond=None)[0][:, 0]
    return Attempt(gain, here.back(x), float(found.values["epsilon"]) / here.balance, found.margin, found.bound)
