"""The level that one matrix Q guarantees, as an inequality in Q and in first-order changes of the gains.

With F = a + b diag(rho) (c - K output) - L output and G = L + b diag(rho) K, for all rho in the box

    energy       -(F'Q + Q F) - E'E > 0,                       level = tr(process'Q process) + tr(noise'L'Q L noise)
    covariance   [ -(F'Q + Q F), -Q process, Q G noise; *, I ] > 0,        level = tr Z, [ Z E; E' Q ] > 0, Q = X^-1
    gain         [ -(F'Q + Q F) - E'E, -Q process, Q G noise; *, level^2 I ] > 0
"""

import dataclasses

import numpy as np

from jaxobs.designs import _conic
from jaxobs.designs._conic import Affine, block, constant, full, sym, symmetric, trace, transpose, value, variables
from jaxobs.designs._dynamics import Dynamics, centred
from jaxobs.designs._rates import Proof
from jaxobs.designs.covers import Corners, Inequality, Multiplier, covered

ROUNDS = 6  # each in the coordinates of the last Q


@dataclasses.dataclass(frozen=True)
class Level:
    """value: the bound, of |E e|^2 for H2 and the gain for L2; by Q (n, n) and its multipliers tau (r, r)."""

    form: str
    value: float
    q: np.ndarray
    tau: np.ndarray


@dataclasses.dataclass(frozen=True)
class Place:
    """The dynamics in the coordinates of Q, in units in which Q is about the identity and the level about one."""

    d: Dynamics
    form: str
    t: np.ndarray
    speed: float
    size: float
    units: np.ndarray
    lengths: np.ndarray  # for "covariance": E'E / size = weight' diag(lengths) weight, weight orthonormal

    @staticmethod
    def of(d: Dynamics, form: str, q: np.ndarray, level: float) -> "Place":
        """Time in units of 1 / speed; E and the noises scaled so that the inequality keeps its form."""
        t = centred(q)
        here, speed, units = d.in_coordinates(t).scaled()
        size = max(level, 1e-300)
        root, lengths = np.sqrt(speed), np.zeros(0)
        if form == "energy":  # F/speed, E/root; L/speed with noise * speed
            scaled = {"weight": here.weight / root, "noise": here.noise * speed}
        elif form == "covariance":  # [ -(F'Q + QF)/speed, Q N/root; *, I ]
            _, lengths, axes = np.linalg.svd(here.weight / np.sqrt(size), full_matrices=False)
            seen = lengths > 1e-7 * lengths.max(initial=0.0)
            scaled = {"process": here.process / root, "noise": here.noise * root, "weight": axes[seen]}
            lengths = lengths[seen] ** 2
        else:  # [ ... - E'E/speed, Q N/(root level); *, level^2 / level^2 ]
            scaled = {"weight": here.weight / root, "process": here.process / root / size, "noise": here.noise * root / size}
        return Place(dataclasses.replace(here, **scaled), form, t, speed, size, units, lengths)

    def inequality(
        self, q: Affine, tau: Affine, free: Affine, margin: float, dl: Affine | None = None, dk: Affine | None = None,
        tau0: np.ndarray | None = None,
    ) -> tuple[Inequality, list[Affine], Affine, np.ndarray | None]:  # fmt: skip
        """(the inequality, further matrices, cost, its quadratic part); Q = I where the gains change by dl and dk."""
        d, own = self.d, self.d.model
        lead, ln = -sym(q @ d.closed), q @ (d.gain @ d.noise)
        if dl is not None:
            lead, ln = lead + sym(dl @ own.output), ln + dl @ d.noise
        qb, seen, further, quadratic = q @ own.b, d.seen, [], None
        change = None if dk is None else -(dk @ own.output)
        if self.form == "energy":
            m = lead - constant(d.weight.T @ d.weight, q)
            noise = d.noise @ d.noise.T
            cost = trace(q @ (d.process @ d.process.T + d.gain @ noise @ d.gain.T)) / self.size
            if dl is not None:
                cost = cost + 2 * trace(transpose(dl) @ d.gain @ noise) / self.size
                flat = (dl[1:] @ d.noise).reshape(len(q) - 1, -1)
                quadratic = 2 * flat @ flat.T / self.size
        else:
            side = np.concatenate([-(q @ d.process), ln], -1)
            unit = constant(np.eye(side.shape[-1]), q)
            if self.form == "covariance":
                cost = trace(self.lengths[:, None] * free)
                further = [block([[free, constant(d.weight, q)], [constant(d.weight.T, q), q]])]
            else:
                unit, cost, lead = unit[0] * free, free[:, 0, 0], lead - constant(d.weight.T @ d.weight, q)
            m = block([[lead, side], [transpose(side), unit]])
            wide = side.shape[-1] - d.noise.shape[1]
            qb = np.concatenate([qb, np.zeros((len(q), side.shape[-1], own.r))], 1)
            seen = np.concatenate([seen, np.zeros((own.r, wide)), -d.inner @ d.noise], 1)
            if dk is not None and change is not None:
                change = np.concatenate([change, np.zeros((len(q), own.r, wide)), -(dk @ d.noise)], 2)
        further.append(q)
        u0 = np.concatenate([own.b, np.zeros((m.shape[-1] - own.n, own.r))])
        one = Inequality(self.form, m, qb, seen, tau, margin, change, u0 if dk is not None else None, tau0)
        return one, further, cost, quadratic

    def free(self) -> np.ndarray:
        """The basis of what else is unknown: Z, or the square of the level."""
        return {"energy": full(0, 0), "covariance": symmetric(len(self.d.weight)), "gain": full(1, 1)}[self.form]

    def level(self, q: np.ndarray, tau: np.ndarray, cost: float) -> Level:
        """In the user's coordinates and units."""
        inverse = np.linalg.inv(self.t)
        value = np.sqrt(max(cost, 0.0)) * self.size if self.form == "gain" else cost * self.size
        own = inverse.T @ ((q + q.T) / 2) @ inverse
        return Level(self.form, float(value), own, tau * self.speed / self.units[: len(tau)] ** 2)


def guess(d: Dynamics, form: str, proof: Proof) -> tuple[np.ndarray, float]:
    """(Q, level) from the P and the rate of a proof: far from the least level, but it satisfies the inequality."""
    t = centred(proof.p)
    side = np.concatenate([d.process, d.gain @ d.noise], 1)
    inverse = np.linalg.solve(t, side)
    driven, seen = max(float(np.linalg.norm(inverse, 2)) ** 2, 1e-300), max(float(np.linalg.norm(d.weight @ t, 2)) ** 2, 1e-300)
    if form == "covariance":
        return proof.p * (2 * proof.rate / driven), float(np.sum((d.weight @ t) ** 2)) * driven / (2 * proof.rate)
    if form == "energy":
        return proof.p * (seen / (2 * proof.rate)), float(np.sum(inverse**2)) * seen / (2 * proof.rate)
    return proof.p * (seen / proof.rate), float(np.sqrt(seen * driven)) / proof.rate


def least(
    d: Dynamics, form: str, cover: Corners | Multiplier, start: tuple[np.ndarray, float], *, margin: float, rounds: int = ROUNDS
) -> Level | None:
    """The least level for the gains of d, from a Q and a level to start from; None if the solver finds none."""
    q0, size = start
    best = None
    for _ in range(rounds):
        try:
            place = Place.of(d, form, q0, size)
        except np.linalg.LinAlgError:
            break
        q, tau, free = variables(symmetric(d.model.n), cover.tau(), place.free())
        one, further, cost, _ = place.inequality(q, tau, free, margin)
        x = covered(cover, [one], lambda ms, c=cost, f=further: _conic.minimise(c, [*ms, *f]))
        if x is None:
            break
        found = place.level(value(q, x), value(tau, x), float(value(cost, x)))
        if not (found.value > 0 and np.linalg.eigvalsh(value(q, x))[0] > 0):
            break
        if best is not None and found.value > best.value * (1 - 1e-4):
            return min(best, found, key=lambda one: one.value)
        best, q0, size = found, found.q, found.value
    return best
