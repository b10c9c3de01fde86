"""That no common quadratic Lyapunov function exists: the dual ray of the corner inequalities, rounded and proved.

In the coordinates and the time of a frame (_frame), with G = F or its delta form, both times ask of X_c >= 0, not all zero,

    S = sum_c G_c X_c + X_c G_c' + tau G_c X_c G_c' + kappa X_c >= 0.

A solution is looked for with S as far inside as possible, so that short rationals near it are solutions as well.
Source: Boyd, El Ghaoui, Feron and Balakrishnan, Linear Matrix Inequalities in System and Control Theory, 1994, section 2.2.1
(alternatives); Peyrl and Parrilo, Theoretical Computer Science 409 (2008) 269-281 (rounding of interior solutions).
"""

import dataclasses
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import NoGain
from jaxobs.designs import sdp
from jaxobs.designs._every_gain import every_gain
from jaxobs.designs._frame import Frame, frame
from jaxobs.designs.polytope import Polytope, as_tuples

POINTS = 40  # corners that take part; of boxes with more of them a sample
INTERIOR = 1e-10  # the least smallest eigenvalue of S, for sum X_c <= I, that is worth rounding


def no_gain(
    model: Polytope,
    gain: Any = None,
    *,
    rate: float | None = None,
    step: bool = False,
    radius: float | None = None,
) -> NoGain | None:
    """The exact proof that no P > 0 has, with F_c = A_c - L output at all corners of the box,

        F_c'P + P F_c + 2 rate P < 0,      or for step models      F_c'P F_c < rate^2 P,

    for the given gain L (n, p); for every gain, if none is given; for every gain with |L|_F <= radius, if that is given too.
    None where no proof is found, which decides nothing. None is found for a gain where the stable modes have a subspace of
    their own at all corners (S >= 0 then has no interior); of every gain none that needs more digits than a float has.

    rate [1/s], 0 if not given; for step models the factor a step, 1 if not given. ValueError for a gain of another shape, a
    radius that is not positive, a radius and a gain, a radius for step models. Source: see NoGain.
    """
    if gain is not None:
        gain = np.asarray(gain, float)
        model.closed(gain)
    if radius is not None and (gain is not None or step or not (np.isfinite(radius) and radius > 0)):
        given = f"{radius!r}" + (", with a gain" if gain is not None else "") + (", for a step model" if step else "")
        raise refuse("no_gain", "radius", given, "a positive number, for flows, without a gain", "It bounds the gains L.")
    rate = (1.0 if step else 0.0) if rate is None else float(rate)
    points = model.parameters()
    if len(points) > POINTS:
        points = points[np.sort(np.random.default_rng(0).choice(len(points), POINTS, replace=False))]
    if gain is None and radius is None:
        found = every_gain(model, points, rate=rate, step=step)
        return None if found is None else _checked(model, None, points, found, rate, step)
    return refuted(frame(model, step=step, gain=gain), model, points, gain, rate=rate, radius=radius)


def refuted(
    place: Frame, model: Polytope, points: np.ndarray, gain: np.ndarray | None, *, rate: float, radius: float | None
) -> NoGain | None:
    """`no_gain` for a given gain, or for all gains within a radius, in coordinates scaled by powers of two."""
    scales = 2.0 ** np.round(np.log2(np.linalg.norm(place.t, axis=1)))
    ray = _Ray(scales, place.speed, place.tau, model, points, gain, place.kappa(rate), radius)
    found = ray.found()
    return None if found is None else _checked(model, gain, points, found[0], rate, place.tau > 0, radius, found[1])


@dataclasses.dataclass(frozen=True)
class _Ray:
    """The dual problem in the coordinates diag(scales)^-1 e and units of time 1 / speed."""

    scales: np.ndarray
    speed: float
    tau: float
    model: Polytope
    points: np.ndarray
    gain: np.ndarray | None
    kappa: float
    radius: float | None

    def moves(self) -> np.ndarray:
        """G at the points; A without a gain."""
        a = np.stack([self.model.at(rho) for rho in self.points])
        a = a - (0 if self.gain is None else self.gain @ self.model.output) - (np.eye(self.model.n) if self.tau else 0)
        return a * self.scales / self.scales[:, None] / self.speed

    def found(self) -> tuple[np.ndarray, float] | None:
        """Multipliers X_c (points, n, n) and t in the user's coordinates and units."""
        g, n, p = self.moves(), self.model.n, self.model.p
        unknowns = {f"x{k}": sdp.symmetric(n, reach=1.0) for k in range(len(g))} | {"s": sdp.scalar(reach=1e3)}
        if self.radius is not None:
            unknowns["t"] = sdp.scalar(reach=1e3)

        def lmis(s, t=None, **xs):
            x = np.stack(list(xs.values()))
            side = self.total(g, x, t)
            return [np.eye(n) - np.sum(x, axis=0), side - s * np.eye(len(side)), *x]

        solved = sdp.optimise(unknowns, lmis, maximise=lambda s, **_: s, margin=0.0)
        if not solved.values:
            return None
        t = float(solved.values["t"]) if self.radius is not None else None
        x = np.stack([sdp.positive_part(solved.values[f"x{k}"]) for k in range(len(g))])
        inside = float(np.linalg.eigvalsh(self.total(g, x, t))[0])
        if inside < INTERIOR:
            return None
        size = 1 + abs(self.kappa) + float(np.max(np.linalg.norm(g, 2, axis=(1, 2)))) * (2 + self.tau)
        small = inside / (8 * len(g) * (size + p))
        x = np.stack([_rounded(one, small) if np.trace(one) > small else np.zeros_like(one) for one in x])
        return x * self.scales * self.scales[:, None], 0.0 if t is None else t * self.unit**2 / self.speed

    @property
    def unit(self) -> float:
        """The size of the output in these coordinates."""
        return float(np.linalg.norm(self.model.output * self.scales))

    def total(self, g: np.ndarray, x: np.ndarray, t: Any) -> np.ndarray:
        """S; with a radius [S - t R, h; h', t I], where L L' <= R for the gains of an output of size one, h = sum X_c C'."""
        gx = g @ x
        s = np.sum(gx + gx.transpose(0, 2, 1) + self.tau * gx @ g.transpose(0, 2, 1) + self.kappa * x, axis=0)
        if t is None or self.radius is None:
            return s
        h = np.sum(x, axis=0) @ (self.model.output * self.scales / self.unit).T
        r = np.diag((self.radius * self.unit / self.speed / self.scales) ** 2)
        return np.block([[s - t * r, h], [h.T, t * np.eye(len(h.T))]])


def _rounded(x: np.ndarray, small: float) -> np.ndarray:
    """x + small I in short dyadic numbers: still > 0, no further off than 2 small."""
    unit = 2.0 ** np.floor(np.log2(small / (2 * len(x))))
    return np.round((x + small * np.eye(len(x))) / unit) * unit


def _checked(model, gain, points, multipliers, rate, step, radius=None, t=0.0) -> NoGain | None:
    kept = [k for k, one in enumerate(multipliers) if np.any(one)]
    certificate = NoGain(
        **model.fields(),
        gain=() if gain is None else as_tuples(gain),
        points=as_tuples(points[kept]),
        multipliers=as_tuples(np.concatenate([multipliers[k] for k in kept])),
        rate=rate,
        step=int(step),
        radius=float(radius or 0.0),
        t=float(t),
    )
    return certificate if certificate.verify() else None
