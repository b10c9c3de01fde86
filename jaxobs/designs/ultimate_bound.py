"""How large an error remains when the model is wrong and the measurement noisy by bounded amounts: the smallest bound proved.

For a given alpha all inequalities of certificates.Mismatch are linear in P, beta, gamma and bound^2; alpha is searched on a
line, between 0 and twice the largest rate that one P proves. Source: Boyd, El Ghaoui, Feron and Balakrishnan, Linear Matrix
Inequalities in System and Control Theory, 1994, section 6.1.3.
"""

import dataclasses
from typing import Any

import numpy as np
import scipy.optimize

from jaxobs._module import refuse, require_nonnegative, require_positive
from jaxobs.certificates import Corners, Mismatch
from jaxobs.designs import corner_lmi, sdp
from jaxobs.designs._injected import Injected
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.polytope import Polytope, as_tuples

UP = 1 + 1e-9  # room for the exact check
MARGIN = 1e-7  # asked of the inequalities, in coordinates in which all is about one
NEARLY = 1e-6  # by which it may be missed while alpha is searched
SEARCHES = 24  # values of alpha
SLOWEST = 1e-3  # of the largest alpha, where the search begins


def ultimate_bound(
    model: Polytope,
    gain: Any,
    *,
    disturbance: Any,
    size: float,
    noise_size: float = 0.0,
    weight: Any = None,
    alpha: float | None = None,
    inner: Any = None,
    origin: str = "given",
) -> Mismatch:
    """The exact certificate of the smallest `bound` found, with, for e' = F(rho) e + disturbance d - G(rho) v,

        limsup |weight e| <= bound    for all |d| <= size, |v| <= noise_size and rho within the bounds of the model.

    gain L (n, p). disturbance (n, m): where d enters, for a chain (0, ..., 0, 1)'; size: of the mismatch, sup |phi - phi_model|
    along the plant's trajectories (`model_gap` proves both); noise_size: of the measurement noise. weight (s, n): what of the
    error counts, the identity if not given. alpha [1/s]: of this one only; searched if not given. inner (r, p): the innovation
    in the channels of the observer f(z + K (y - C z)), G = L + b diag(rho) inner; none if not given, and G = L. origin: where
    the bounds of the model and `size` come from, a sentence.

    Infeasible where the gain has no certificate of decay, or no P passes the exact check. ValueError for bad arguments.
    """
    system = Injected.make("ultimate_bound", "inner", model, gain, inner)
    b, e = _inputs(model, disturbance, weight)
    require_nonnegative("ultimate_bound", "size", size, "It bounds |d| from above.")
    require_nonnegative("ultimate_bound", "noise_size", noise_size, "It bounds |v| from above.")
    if not (np.isfinite(size) and np.isfinite(noise_size) and size + noise_size > 0):
        fix = "Without any, the error decays to zero: corner_lmi.prove(model, gain)."
        raise refuse("ultimate_bound", "size", f"{size} and noise_size {noise_size}", "finite numbers, not both zero", fix)
    fastest = 2 * corner_lmi.largest_rate(system.seen, system.gain)
    easy = 0.25 * max(fastest, 0.0) if np.isfinite(fastest) else 0.0
    proof = corner_lmi.prove(system.seen, system.gain, rate=easy, origin=origin)
    assert isinstance(proof, Corners)
    inputs = (np.broadcast_to(b, (len(system.closed), *b.shape)), system.injections)
    loads = (inputs[0] * float(size), inputs[1] * float(noise_size))
    own = _Scaled.make(system.closed, loads, e, np.asarray(proof.p), fastest / 2)
    if alpha is None:
        reach = np.log([SLOWEST / own.unit, (1 - SLOWEST) * 2 / own.unit])
        options = {"maxiter": SEARCHES, "xatol": 1e-2}
        found = scipy.optimize.minimize_scalar(lambda x: own.cost(np.exp(x)), bounds=reach, method="bounded", options=options)
        alpha = float(np.exp(found.x))
    require_positive("ultimate_bound", "alpha", alpha, "Twice the rate at which the initial error is forgotten, in 1/s.")
    sizes = {"disturbance": as_tuples(b), "size": float(size), "noise_size": float(noise_size), "weight": as_tuples(e)}
    for p, weights in own.solutions(float(alpha)):
        beta, gamma = _multipliers(system.closed, inputs, (float(size), float(noise_size)), p, float(alpha), weights)
        numbers = {"p": as_tuples(p), "alpha": float(alpha), "beta": beta, "gamma": gamma}
        bound = float(np.sqrt(np.linalg.eigvalsh(e @ np.linalg.solve(p, e.T))[-1])) * UP
        certificate = Mismatch(**system.fields(), **sizes, **numbers, bound=bound, origin=origin)
        if certificate.verify():
            return certificate
    reason = f"no invariant ellipsoid was found for alpha = {alpha:.6g} /s"
    change = f"alpha has to be below {fastest:.6g} /s, twice the largest rate proved; leave it out to have it searched."
    raise Infeasible(reason, min(fastest - alpha, 0.0), change, best=fastest, tried=(f"alpha = {alpha:.6g} /s",))


def _inputs(model: Polytope, disturbance: Any, weight: Any) -> tuple[np.ndarray, np.ndarray]:
    b, e = np.asarray(disturbance, float), np.eye(model.n) if weight is None else np.asarray(weight, float)
    for name, value, axis, fix in (
        ("disturbance", b, 0, "One row a state, one column for each component of d."),
        ("weight", e, 1, "One column a state: the rows say what of the error counts."),
    ):
        if value.ndim != 2 or value.shape[axis] != model.n or not np.all(np.isfinite(value)) or not value.size:
            expected = f"a finite matrix with {model.n} {'columns' if axis else 'rows'}"
            raise refuse("ultimate_bound", name, f"shape {value.shape}", expected, fix)
    if not np.any(e):
        raise refuse("ultimate_bound", "weight", "zero", "some entry that is not", "Nothing of the error counts.")
    return b, e


@dataclasses.dataclass(frozen=True)
class _Scaled:
    """closed (corners, n, n), inputs (corners, n, .) and weight for zeta, e = t zeta, in time of `unit` seconds: about one."""

    closed: np.ndarray
    inputs: tuple[np.ndarray, ...]
    weight: np.ndarray
    t: np.ndarray
    unit: float

    @staticmethod
    def make(closed: np.ndarray, inputs, weight: np.ndarray, p: np.ndarray, rate: float) -> "_Scaled":
        t = np.linalg.inv(np.linalg.cholesky(p)).T
        closed = np.linalg.inv(t) @ closed @ t
        unit = 1 / (rate if np.isfinite(rate) else float(np.linalg.norm(closed[0], 2)))
        here = [unit * np.linalg.inv(t) @ one for one in inputs]
        size = max(float(np.max(np.linalg.norm(one, 2, axis=(1, 2)))) for one in here)  # of zeta, in the end
        kept = tuple(one / size for one in here if np.any(one))
        seen = weight @ t
        return _Scaled(unit * closed, kept, seen / np.linalg.norm(seen, 2), size * t, unit)

    def solve(self, alpha: float) -> sdp.Solution:
        n, step = len(self.t), alpha * self.unit
        every = np.concatenate(self.inputs, axis=2)
        columns = [one.shape[2] for one in self.inputs]
        names = [f"w{k}" for k in range(len(columns))]

        def lmis(p, level, **weights):
            w = np.diag(np.repeat([weights[name] for name in names], columns))
            yield p
            for f, both in zip(self.closed, every, strict=True):
                yield np.block([[-(f.T @ p + p @ f) - step * p, -p @ both], [-both.T @ p, w]])
            yield np.reshape(step * (2 - UP) - sum(weights.values()), (1, 1)) + MARGIN  # which the program asks for
            yield np.block([[p, self.weight.T], [self.weight, level * np.eye(len(self.weight))]])

        unknowns = {"p": sdp.symmetric(n, reach=1e6), "level": sdp.scalar(reach=1e6)} | {name: sdp.scalar() for name in names}
        return sdp.optimise(unknowns, lambda **x: list(lmis(**x)), maximise=lambda level, **_: -level, margin=MARGIN)

    def cost(self, alpha: float) -> float:
        """The logarithm of the squared bound, in these units."""
        found = self.solve(alpha)
        return float(np.log(found.values["level"])) if found.margin > -NEARLY else 50.0

    def solutions(self, alpha: float):
        """P and the weights of the inputs that are not zero, in the user's coordinates; found again in those of the first P."""
        place = self
        for _ in range(2):
            found = place.solve(alpha)
            if not found.values or np.linalg.eigvalsh(found.values["p"])[0] <= 0:
                return
            inverse = np.linalg.inv(place.t)
            p = inverse.T @ found.values["p"] @ inverse
            yield (p + p.T) / 2, [float(x) / place.unit for name, x in found.values.items() if name.startswith("w")]
            u = np.linalg.inv(np.linalg.cholesky(found.values["p"])).T
            closed, inputs = np.linalg.inv(u) @ place.closed @ u, tuple(np.linalg.inv(u) @ one for one in place.inputs)
            seen = place.weight @ u
            place = _Scaled(closed, inputs, seen / np.linalg.norm(seen, 2), place.t @ u, place.unit)


def _multipliers(closed, inputs, sizes, p, alpha, weights) -> tuple[float, float]:
    """beta and gamma; that of an input of size zero costs nothing, so it is as large as its block needs."""
    left, found = list(weights), []
    used = np.concatenate([one for one, size in zip(inputs, sizes, strict=True) if size], axis=2)
    scaled = [left.pop(0) / size**2 if size else None for size in sizes]
    w = np.diag(np.concatenate([[x] * one.shape[2] for one, x in zip(inputs, scaled, strict=True) if x is not None]))
    for one, x in zip(inputs, scaled, strict=True):
        if x is not None:
            found.append(x)
            continue
        need = 0.0
        for f, both, extra in zip(closed, used, one, strict=True):
            pad = np.vstack([p @ extra, np.zeros((both.shape[1], extra.shape[1]))])
            own = np.block([[-(f.T @ p + p @ f) - alpha * p, -p @ both], [-both.T @ p, w]])
            need = max(need, float(np.linalg.eigvalsh(pad.T @ np.linalg.lstsq(own, pad, rcond=None)[0])[-1]))
        found.append(2.0 ** np.ceil(np.log2(max(2 * need, np.finfo(float).tiny))))
    return found[0], found[1]
