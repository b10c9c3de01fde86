"""From gains that prove a rate to better ones: a sequence of convex programs, with one Lyapunov matrix for the rate and another
for the level.

In (P, Q, L, K) the inequalities are bilinear. With Y = P L the rate is affine in P and Y, without error; the level sees, to
first order at P = Q = I (each in coordinates of its own), Q L -> Q L0 + dL with dL = Y - P L0. A trust region |P - I|, |Q - I|
< delta keeps the error small; each proposal is judged by its own least level, solved anew, and only lower ones are taken.
"""

import dataclasses

import numpy as np

from jaxobs.designs import _conic
from jaxobs.designs._conic import constant, full, symmetric, value, variables
from jaxobs.designs._dynamics import Dynamics, centred
from jaxobs.designs._levels import Level, Place, guess, least
from jaxobs.designs._rates import STRICT, Proof, decay, fastest
from jaxobs.designs.covers import Corners, Multiplier, covered

WIDEST, NARROWEST = 0.95, 1e-5  # of the trust region
ENOUGH = 1e-4  # relative gain, over PATIENCE steps, at which the descent ends
PATIENCE = 6
LAST = 1e-2  # of the speed: a rate from which the required one is tried at once


@dataclasses.dataclass(frozen=True)
class Point:
    """Gains with the proof of their rate and their level (None: the norm of the gain counts)."""

    proof: Proof
    level: Level | None

    @property
    def value(self) -> float:
        return float(np.linalg.norm(self.proof.d.gain)) if self.level is None else self.level.value


def judged(proof: Proof, forms: tuple[str, ...], cover: Corners | Multiplier, last: Level | None = None) -> Point | None:
    """The point with the lowest of the levels of these forms; None if one that was asked for is not found."""
    if not forms:
        return Point(proof, None)
    found, fast = [], None
    for form in forms:
        level = None
        if last is not None and last.form == form:
            level = least(proof.d, form, cover, (last.q, last.value), margin=STRICT, rounds=2)
        if level is None:  # far from the last one: from the P of the fastest rate, which is a bound by itself
            fast = fastest(proof.d, cover, p=proof.p, rtol=1e-2) if fast is None else fast
            level = least(proof.d, form, cover, guess(proof.d, form, fast), margin=STRICT) if fast.rate > 0 else None
        if level is not None:
            found.append(level)
    return Point(proof, min(found, key=lambda one: one.value)) if found else None


def descend(
    point: Point, rate: float, cover: Corners | Multiplier, *, circle: bool = False, steps: int = 60
) -> tuple[Point, list[float], int]:
    """(the last point, the levels on the way, falling, the programs solved), at the form of the point's level."""
    delta, history, tried = 0.3, [point.value], 0
    while tried < steps and delta > NARROWEST:
        tried += 1
        proposed = _step(point, rate, cover, delta, circle)
        if proposed is None:
            delta *= 0.3
            continue
        proof, predicted = proposed
        new = judged(proof, () if point.level is None else (point.level.form,), cover, point.level)
        gained = -np.inf if new is None else point.value - new.value
        if new is None or not gained > 0:
            delta *= 0.3
            continue
        ratio = gained / max(point.value - predicted, 1e-300)
        delta = min(2 * delta, WIDEST) if ratio > 0.7 else delta / 2 if ratio < 0.25 else delta
        point = new
        history.append(point.value)
        if len(history) > PATIENCE and history[-1 - PATIENCE] - history[-1] < ENOUGH * history[-1]:
            break
    return point, history, tried


def _step(point: Point, rate: float, cover: Corners | Multiplier, delta: float, circle: bool) -> tuple[Proof, float] | None:
    """A proof of the rate for new gains, and the level that the model predicts for them."""
    proof, level = point.proof, point.level
    try:
        t = centred(proof.p)
        place = None if level is None else Place.of(proof.d, level.form, level.q, level.value)
    except np.linalg.LinAlgError:
        return None
    d, speed, units = proof.d.in_coordinates(t).scaled()
    own = proof.d.model
    bases = [symmetric(own.n), cover.tau(), full(own.n, own.p) / np.linalg.norm(d.model.output, 2)]
    bases += [full(1, 1)] if place is None else [symmetric(own.n), cover.tau(), place.free()]
    p, tau, y, *others = variables(*bases, *([proof.d.injections()] if circle else []))
    dk = others.pop() if circle else None
    change = y - p @ d.gain  # of the gain, at P = I
    one = decay(d, p, tau, rate / speed, y=y, margin=STRICT)
    if dk is not None:
        here = dk / units[:, None]
        one = dataclasses.replace(
            one, dv=-(here @ d.model.output), u0=d.model.b, tau0=proof.tau * units[: len(proof.tau)] ** 2 / speed
        )
    eye = np.eye(own.n)
    near = [p] if place is None else [p, others[0]]
    limits = [constant(delta * eye, p) + sign * (v - constant(eye, p)) for v in near for sign in (1, -1)]
    cones, quadratic, inequalities = [], None, [one]
    if place is None:
        scale = float(np.linalg.norm(proof.d.gain))
        total = (constant(proof.d.gain, p) + speed * t @ change) / scale
        cost = others[0][:, 0, 0]
        cones.append(np.concatenate([cost[:, None], total.reshape(len(total), -1)], 1))
    else:
        q, tau_q, free = others
        dl = np.linalg.solve(place.t, t) @ change * (speed / place.speed)
        dk_q = None if dk is None else dk / place.units[:, None]
        tau0 = None if level is None or dk is None else level.tau * place.units[: len(level.tau)] ** 2 / place.speed
        other, further, cost, quadratic = place.inequality(q, tau_q, free, STRICT, dl, dk_q, tau0)
        inequalities.append(other)
        limits += further
    if dk is not None:
        half = (own.upper - own.lower) / 2 * np.linalg.norm(d.model.b, axis=0)
        moved_k = (half[:, None] * (dk / units[:, None]) @ d.model.output).reshape(len(p), -1)
        cones.append(np.concatenate([constant(np.array([delta]), p), moved_k], 1))
    x = covered(cover, inequalities, lambda ms: _conic.minimise(cost, [*ms, *limits], cones=cones, quadratic=quadratic))
    if x is None:
        return None
    found = (value(p, x), value(tau, x), value(y, x), None if dk is None else value(dk, x))
    new = _moved(proof, rate, cover, (t, speed, units), d, *found)
    expected = float(value(cost, x)) + (0.0 if quadratic is None else float(x @ quadratic @ x) / 2)
    if level is not None and level.form == "gain":
        return None if new is None else (new, level.value * float(np.sqrt(max(expected, 0.0))))
    return None if new is None else (new, point.value * expected)


def _moved(proof, rate, cover, frame, d: Dynamics, p, tau, y, dk) -> Proof | None:
    """The proof of the rate for the new gains, by the P found with them, or (where K moved) by another."""
    t, speed, units = frame
    if np.linalg.eigvalsh(p)[0] <= 0:
        return None
    gain = np.linalg.solve(p, y)
    inner = d.inner if dk is None else d.inner + dk / units[:, None]
    reached = cover.lowest(decay(d.with_gains(gain, inner), p[None], tau[None], 0.0), np.zeros(0), p) / 2 * speed
    inverse = np.linalg.inv(t)
    new = proof.d.with_gains(speed * t @ gain, inner * units[:, None])
    found = Proof(new, reached, inverse.T @ ((p + p.T) / 2) @ inverse, tau * speed / units[: len(tau)] ** 2)
    if reached < rate and dk is not None:
        found = fastest(new, cover, p=found.p, target=rate)
    return found if found.rate >= rate else None


def single(proof: Proof, rate: float, cover: Corners | Multiplier, *, rounds: int = 12) -> Proof:
    """The gains of the least "covariance" level with one matrix for rate and level, P = Q, a convex program in it and Y = P L:
    a start for every objective, since noise keeps its gains small. From a fast start the rate is lowered in strides of ten,
    each in the coordinates of the last P."""
    form = "covariance"
    stride, last, start = 10.0, np.inf, guess(proof.d, form, proof)
    for _ in range(rounds):
        near = max(4 * rate, LAST * proof.d.in_coordinates(centred(proof.p)).speed)
        aim = proof.rate / stride if proof.rate / stride > near else rate
        found = _alone(proof, form, aim, rate, cover, start)
        if found is None:
            stride = np.sqrt(stride)
            if stride < 1.1:
                break
            continue
        proof, level = found
        start = level.q, level.value
        if aim == rate and level.value > last * (1 - 1e-2):
            break
        last = level.value if aim == rate else np.inf
    return proof


def _alone(
    proof: Proof, form: str, aim: float, rate: float, cover: Corners | Multiplier, start: tuple[np.ndarray, float]
) -> tuple[Proof, Level] | None:
    """The convex program with P = Q at the rate `aim`, from a Q and a level, and the level reached."""
    try:
        place = Place.of(proof.d, form, *start)
    except np.linalg.LinAlgError:
        return None
    d, n = place.d, place.d.model.n
    gains = full(n, d.model.p) / np.linalg.norm(d.model.output, 2)
    q, tau, tau_q, free, y = variables(symmetric(n), cover.tau(), cover.tau(), place.free(), gains)
    inequality, further, cost, _ = place.inequality(q, tau_q, free, STRICT, y - q @ d.gain)
    one = decay(d, q, tau, aim / place.speed, y=y, margin=STRICT)
    x = covered(cover, [one, inequality], lambda ms: _conic.minimise(cost, [*ms, *further]))
    if x is None:
        return None
    frame = (place.t, place.speed, place.units)
    new = _moved(proof, rate, cover, frame, d, value(q, x), value(tau, x), value(y, x), None)
    return None if new is None else (new, place.level(value(q, x), value(tau_q, x), float(value(cost, x))))
