"""Coordinates, time units and the inequalities of one polytope in them: where `corner_lmi` solves.

With F = a(rho) - L output and G = F for e' = F e, or G = (F - I) / tau for e+ = F e (the delta form), both times read

    [ -(P G + G'P) - kappa P    sqrt(tau) G'P ]
    [  sqrt(tau) P G                 P        ]  > 0  at all corners,       P L = Y',

with tau = 0 and kappa = 2 rate, or kappa = (1 - factor^2) / tau.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg

from jaxobs.designs import sdp
from jaxobs.designs.polytope import Polytope

STRICT = 1e-9  # smallest margin that counts, in coordinates in which P is about the identity
CONDITION = 1e4  # of the P among which none is said to be, in the coordinates where the last attempt failed
REACH = 1e6  # of the gain, in coordinates in which P is about the identity
FEW = 16  # corners that are all imposed; of more those that are found to be violated
ADDED = 6  # corners at a time


@dataclasses.dataclass(frozen=True)
class Frame:
    """Where the inequalities are solved: the model of t^-1 e in units of time 1 / speed, in the form G; tau as above.

    active: of many corners those that are imposed, a list that all frames of one design share and extend; all if it is empty.
    """

    model: Polytope
    t: np.ndarray
    speed: float
    tau: float
    active: list[int] = dataclasses.field(default_factory=list)

    @functools.cached_property
    def corners(self) -> np.ndarray:
        return self.model.corners()

    def centred(self, p: np.ndarray) -> "Frame":
        """In the coordinates in which P is the identity."""
        t = np.linalg.inv(np.linalg.cholesky((p + p.T) / 2)).T
        return dataclasses.replace(self, model=self.model.in_coordinates(t), t=self.t @ t)

    def gain(self, p: np.ndarray, y: np.ndarray) -> np.ndarray:
        """L in the user's coordinates."""
        return self.speed * self.t @ np.linalg.solve(p, y.T)

    def lyapunov(self, p: np.ndarray) -> np.ndarray:
        """P in the user's coordinates, of size one."""
        inverse = np.linalg.inv(self.t)
        p = inverse.T @ p @ inverse
        p = (p + p.T) / 2
        return p / 2.0 ** np.round(np.log2(np.max(np.abs(p))))

    def here(self, gain: np.ndarray | None) -> np.ndarray | None:
        return None if gain is None else np.linalg.solve(self.t, gain) / self.speed

    def kappa(self, rate: float) -> float:
        return (1 - rate**2) / self.tau if self.tau else 2 * rate / self.speed

    def rate(self, kappa: float) -> float:
        return float(np.sqrt(max(1 - kappa * self.tau, 0.0))) if self.tau else kappa * self.speed / 2

    def at_corners(self, kappa: float, chosen: Sequence[int] | slice, p: np.ndarray, injected: np.ndarray) -> np.ndarray:
        """The corner inequalities for P and P L output, (chosen, k, k)."""
        pg = p @ self.corners[chosen] - injected
        decrease = -(pg + pg.transpose(0, 2, 1)) - kappa * p
        if not self.tau:
            return decrease
        side = np.sqrt(self.tau) * pg
        lower = np.concatenate([side, np.broadcast_to(p, pg.shape)], axis=2)
        return np.concatenate([np.concatenate([decrease, side.transpose(0, 2, 1)], axis=2), lower], axis=1)

    def inequalities(self, kappa: float, gain: np.ndarray | None) -> Callable[..., list[np.ndarray]]:
        """P > 0 and the active corner inequalities, as a function of p and y; of p alone for a given gain."""
        chosen, c = self.active or slice(None), self.model.output

        def lmis(p, y=None):
            return [p, *self.at_corners(kappa, chosen, p, p @ gain @ c if y is None else y.T @ c)]

        return lmis

    def lowest(self, kappa: float, p: np.ndarray, injected: np.ndarray, weight: float | np.ndarray = 0.0) -> np.ndarray:
        """The smallest eigenvalues of all corner inequalities, with a weight taken from the decrease, (corners,)."""
        every = self.at_corners(kappa, slice(None), p, injected).copy()
        every[:, : len(p), : len(p)] -= weight
        return np.linalg.eigvalsh(every)[:, 0]

    def lazily(
        self, attempt: Callable[[], sdp.Solution], check: Callable[[sdp.Solution], np.ndarray], start: np.ndarray
    ) -> sdp.Solution:
        """The solution of `attempt` once it satisfies the corners that were not imposed as well: those that it violates most
        are added. check(solution): the smallest eigenvalues at all corners; start: the same where nothing is solved yet."""
        if len(self.corners) <= FEW:
            return attempt()
        if not self.active:
            self.active.extend(np.argsort(start)[:ADDED].tolist())
        while True:  # it ends: each round adds corners
            found = attempt()
            if not found.values or found.margin <= 0:
                return found  # a part of the corners is too much
            lowest = check(found)
            worst = [int(k) for k in np.argsort(lowest) if lowest[k] <= 0 and k not in self.active][:ADDED]
            if not worst:
                return dataclasses.replace(found, margin=min(found.margin, float(np.min(lowest))))
            self.active.extend(worst)

    def solve(self, kappa: float, gain: np.ndarray | None) -> sdp.Solution:
        unknowns = {"p": sdp.symmetric(self.model.n, trace=float(self.model.n))}
        if gain is None:
            unknowns["y"] = sdp.full(self.model.p, self.model.n, reach=REACH)
        here, eye, c = self.here(gain), np.eye(self.model.n), self.model.output

        def check(found: sdp.Solution) -> np.ndarray:
            p = found.values["p"]
            return self.lowest(kappa, p, p @ here @ c if here is not None else found.values["y"].T @ c)

        start = self.lowest(kappa, eye, (c.T if here is None else here) @ c)
        return self.lazily(lambda: sdp.feasible(unknowns, self.inequalities(kappa, here)), check, start)

    def refute(self, kappa: float, gain: np.ndarray | None) -> sdp.Solution:
        """The largest t with P >= I and the corner inequalities >= t: if its `bound` is negative, no P >= I with entries up to
        CONDITION satisfies them. (Where P may degenerate, the largest common margin of infeasible inequalities is just 0.)
        """
        n = self.model.n
        unknowns = {"p": sdp.symmetric(n, reach=CONDITION), "t": sdp.scalar(reach=CONDITION)}
        if gain is None:
            unknowns["y"] = sdp.full(self.model.p, n, reach=CONDITION)
        corner = self.inequalities(kappa, self.here(gain))

        def lmis(p, t, y=None):
            return [p - np.eye(n), *(f - t * np.eye(len(f)) for f in corner(p, y)[1:])]

        return sdp.optimise(unknowns, lmis, maximise=lambda p, t, y=None: t, margin=0.0)


def frame(model: Polytope, *, step: bool = False, gain: np.ndarray | None = None) -> Frame:
    """The first frame: rows and columns of the largest entries balanced by powers of two, time in units of the fastest one."""
    shifted = model.a - np.eye(model.n) if step else model.a
    widest = np.maximum(np.abs(model.lower), np.abs(model.upper))
    largest = np.abs(shifted) + (np.abs(model.b) * widest) @ np.abs(model.c)
    if gain is not None:
        largest = largest + np.abs(gain @ model.output)
    _, (scales, _) = scipy.linalg.matrix_balance(largest, permute=False, separate=True)
    t = np.diag(scales)
    speed = float(np.linalg.norm(np.linalg.solve(t, largest @ t), 2))
    if speed < (1e-12 if step else 1e-290):
        speed = 1.0  # nothing moves but what the gain moves: a unit of nothing would put every gain out of reach
    base = dataclasses.replace(model, a=shifted).in_coordinates(t).in_time(1 / speed)
    return Frame(base, t, speed, speed if step else 0.0)


def quietest(place: Frame, kappa: float, process: np.ndarray, weight: np.ndarray, noise: np.ndarray) -> sdp.Solution:
    """min tr(P process) + tr(Z noise) with Z >= Y P^-1 Y', P G + G'P + kappa P < 0 and P G + G'P + weight < 0, all in the
    coordinates and the time of the frame; `value` is minus this bound on the variance, in those of the user."""
    unit = 1 / max(float(np.linalg.norm(weight, 2)), 1e-300)
    faster = kappa + 1e-3 * max(abs(kappa), 1e-3)  # room for the proof

    def lmis(p, y, z):
        fast, steady = place.inequalities(faster, None)(p, y)[1:], place.inequalities(0.0, None)(p, y)[1:]
        pad = np.zeros_like(steady[0])
        pad[: len(p), : len(p)] = weight * unit
        return [p, *fast, *(f - pad for f in steady), np.block([[z, y], [y.T, p]])]

    def check(found):
        p, injected = found.values["p"], found.values["y"].T @ place.model.output
        fast = place.lowest(kappa + (faster - kappa) / 2, p, injected)
        return np.minimum(fast, place.lowest(0.0, p, injected, weight * unit * (1 - 1e-3)))

    sizes = {"p": sdp.symmetric(place.model.n, reach=REACH), "y": sdp.full(place.model.p, place.model.n, reach=REACH)}
    sizes["z"] = sdp.symmetric(place.model.p, reach=REACH)

    def attempt(size):
        def cost(p, y, z):
            return -(np.sum(p * process) + np.sum(z * noise)) / size

        start = place.lowest(kappa, np.eye(place.model.n), place.model.output.T @ place.model.output)
        return place.lazily(lambda: sdp.optimise(sizes, lmis, maximise=cost, margin=STRICT), check, start)

    size = np.trace(process) + np.trace(noise)
    found = attempt(size)
    for _ in range(2):  # until the optimum is of size one, as solvers like it
        if not found.values or abs(found.value) > 1e-2:
            break
        size = size * max(abs(found.value), 1e-6)
        found = attempt(size)
    return dataclasses.replace(found, value=found.value * size / unit)


def in_frame(place: Frame, process: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The user's intensities, and the weight I on his error, in the coordinates and the time of the frame."""
    inverse = np.linalg.inv(place.t)
    return inverse @ process @ inverse.T / place.speed, place.t.T @ place.t, noise * place.speed
