"""What can be said of a gain that someone gives: proved, disproved, or neither, and by what."""

import dataclasses
from typing import Any

import numpy as np
import scipy.linalg

from jaxobs._module import refuse
from jaxobs.certificates import Corners, FrozenInstability, NoGain, StepCorners, SwitchingInstability, routh
from jaxobs.designs import corner_lmi
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.polytope import Polytope, as_tuples
from jaxobs.designs.switching import Switching, worst_switching

SAMPLES = 500  # constant parameters inside the box
REPEATS = (1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)


@dataclasses.dataclass(frozen=True)
class FrozenPoint:
    """The eigenvalues at one constant rho: `count` is exact, `growth` (largest Re s [1/s], or largest |z|) is a float."""

    label: str
    rho: tuple[float, ...]
    count: routh.Count
    growth: float


@dataclasses.dataclass(frozen=True, eq=False)
class Audit:
    """What was found about a gain.

    frozen: exact eigenvalue counts at the corners, the centre, rho = 0 if it is in the box, and the worst constant rho found.
    certificate: one P for all corners, verified; None if none was found, for the `reason` given.
    obstruction: the exact proof that there is no such P, where one was found (it does not mean that errors grow).
    switching: the worst periodic switching between corners that was found, a lower bound on the worst; None if not searched.
    counterexample: an exact proof that errors grow at a constant rho or under a switching.
    """

    gain: np.ndarray
    step: bool
    frozen: tuple[FrozenPoint, ...]
    certificate: Corners | StepCorners | None
    reason: str
    obstruction: NoGain | None
    switching: Switching | None
    counterexample: FrozenInstability | SwitchingInstability | None

    @property
    def verdict(self) -> str:
        """One of: certified (proved for every rho(t) in the box); unstable at ... (exact); marginal at ... (exact), with an
        eigenvalue on the border, so no decay; unstable under switching (proved); not certified (neither proved nor disproved).
        """
        if self.certificate is not None:
            return "certified"
        if isinstance(self.counterexample, FrozenInstability):
            return f"unstable at {next(one.label for one in self.frozen if one.count.outside)} (exact)"
        if isinstance(self.counterexample, SwitchingInstability):
            return "unstable under switching (proved)"
        marginal = next((one.label for one in self.frozen if one.count.border), None)
        return "not certified" if marginal is None else f"marginal at {marginal} (exact)"

    def __str__(self) -> str:
        unit = "largest |z|" if self.step else "largest Re s"
        lines = [f"gain {self.gain.tolist()}: {self.verdict}"]
        for one in self.frozen:
            state = "stable" if one.count.is_stable else f"{one.count.outside} outside, {one.count.border} on the border"
            lines.append(f"  {one.label:<16} rho = {_short(one.rho)}: {state} (exact); {unit} {one.growth:.6g}")
        lines.append(f"  one P for all corners: {'found and verified' if self.certificate else self.reason}")
        if self.obstruction:
            lines.append(f"  none exists (exact): {', '.join(_short(rho) for rho in self.obstruction.points)}")
        if self.switching:
            kind = "factor a step" if self.step else "rate [1/s]"
            lines.append(f"  worst switching found: {kind} {self.switching.growth:.6g} (a lower bound)")
        return "\n".join(lines)


def audit(model: Polytope, gain: Any, *, rate: float | None = None, step: bool = False, search: bool = True) -> Audit:
    """What is true of e' = (a + sum_k rho_k b_k c_k' - L output) e, or e+ = ... with `step`, for the given gain L (n, p).

    In this order: exact eigenvalue counts at constant parameters (Routh); if they are stable, one quadratic Lyapunov function
    for all corners at the decay `rate` (as in corner_lmi.prove), or the exact proof that there is none; with `search`, the
    worst periodic switching, and a rigorous proof where errors grow under it.

    rate [1/s] >= 0, or the factor a step in ]0, 1]. ValueError for a gain of the wrong shape or with numbers that are not
    finite, and, where the constant parameters are stable, for a rate outside this range. Source: Gantmacher, The Theory of
    Matrices, 1959, chapter XV (Routh); Boyd et al., Linear Matrix Inequalities in System and Control Theory, 1994, section 5.1
    (one P); Liberzon, Switching in Systems and Control, 2003 (what each does and does not imply).
    """
    gain = np.asarray(gain, float)
    closed = model.closed(gain)
    if not np.all(np.isfinite(gain)):
        raise refuse("audit", "gain", gain.tolist(), "finite numbers", "Remove the NaN or infinity at its origin.")
    box = _box(model, gain, step)
    frozen = tuple(_frozen(box, label, rho, step) for label, rho in _points(model, gain, step))
    bad = next((one for one in frozen if not one.count.is_stable), None)
    if bad is not None:
        found = next((FrozenInstability(**box, rho=one.rho) for one in frozen if one.count.outside), None)
        reason = f"none exists: the error does not decay at {bad.label}"
        return Audit(gain, step, frozen, None, reason, None, None, found)
    certificate, reason, obstruction = _quadratic(model, gain, rate, step)
    switching = worst_switching(closed, step=step) if search else None
    counterexample = None if switching is None or certificate else _proved(model, switching, closed, box, step)
    return Audit(gain, step, frozen, certificate, reason, obstruction, switching, counterexample)


def _box(model: Polytope, gain: np.ndarray, step: bool) -> dict[str, Any]:
    return model.fields() | {"gain": as_tuples(gain), "step": int(step)}


def _frozen(box: dict[str, Any], label: str, rho: np.ndarray, step: bool) -> FrozenPoint:
    point = FrozenInstability(**box, rho=as_tuples(rho))
    a, b, c, output, gain = (np.array(box[name], float) for name in ("a", "b", "c", "output", "gain"))
    growth = _growth(a + (b.reshape(len(a), -1) * rho) @ c.reshape(-1, len(a)) - gain @ output, step)
    return FrozenPoint(label, point.rho, point.count(), float(growth))


def _growth(f: np.ndarray, step: bool) -> Any:
    values = np.linalg.eigvals(f)
    return np.max(np.abs(values) if step else values.real, axis=-1)


def _points(model: Polytope, gain: np.ndarray, step: bool) -> list[tuple[str, np.ndarray]]:
    """The constant parameters that are looked at; inner ones because a box with stable corners may have an unstable inside."""
    points = [(f"corner {k}", rho) for k, rho in enumerate(model.parameters())]
    if model.r == 0:
        return points
    points.append(("centre", (model.lower + model.upper) / 2))
    if np.all((model.lower <= 0) & (model.upper >= 0)) and np.any(model.lower + model.upper):
        points.append(("rho = 0", np.zeros(model.r)))
    rng, own = np.random.default_rng(0), [model.tied.index(k) for k in model.tied]
    shares = rng.uniform(size=(SAMPLES, model.r))
    for width in (0.0, 0.3, 0.1, 0.03):  # around the worst one, ever closer
        if width:
            shares = np.clip(shares[0] + width * rng.normal(size=shares.shape), 0, 1)
        rhos = model.lower + shares[:, own] * (model.upper - model.lower)
        rhos = np.clip(rhos, model.lower, model.upper)
        growths = _growth(np.stack([model.at(rho) for rho in rhos]) - gain @ model.output, step)
        k = int(np.argmax(growths))
        shares = np.concatenate([shares[k : k + 1], shares])
        worst = rhos[k]
    return [*points, ("worst inside", worst)]


def _quadratic(model, gain, rate, step) -> tuple[Corners | StepCorners | None, str, NoGain | None]:
    """The certificate, or why there is none, and the proof that there is none."""
    try:
        return corner_lmi.prove(model, gain, rate=rate, step=step), "", None
    except Infeasible as error:
        return None, str(error), error.certificate


def _proved(model, switching: Switching, closed: np.ndarray, box: dict[str, Any], step: bool) -> SwitchingInstability | None:
    """The rigorous proof that errors grow under the switching, if they do by enough."""
    if switching.growth <= (1 if step else 0):
        return None
    period = np.eye(model.n)
    for k, time in zip(switching.word, switching.durations, strict=True):
        factor = closed[k] if step else scipy.linalg.expm(closed[k] * time)
        period = factor @ period
    points = tuple(as_tuples(model.parameters()[k]) for k in switching.word)
    _, (scale, _) = scipy.linalg.matrix_balance(np.abs(closed).sum(axis=0), permute=False, separate=True)
    shared = box | {"points": points, "durations": switching.durations, "scale": tuple(int(x) for x in np.log2(scale))}
    power, done, estimates = period, 1, {}
    for repeats in REPEATS:
        while done < repeats:
            power, done = power @ period, done + 1
        if 1.0001 * model.n < abs(np.trace(power)) < 1e100:
            estimates[repeats] = np.log(abs(np.trace(power)) / model.n) / repeats
    for repeats, estimate in estimates.items():
        if estimate >= 0.95 * max(estimates.values()):
            certificate = SwitchingInstability(**shared, repeats=repeats)
            if certificate.verify():
                return certificate
    return None


def _short(rho: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in rho) + ")"
