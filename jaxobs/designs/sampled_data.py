"""Sampling periods that are proved for the continuous plant, beside those that hold for its Euler model only.

The observer z' = f(z, u) + L (y(t_k) - h(z(t_k))) holds its innovation between samples: observers.Sampled(observer, integrator,
dt, holds="innovation"). The Euler model of the same observer may keep its promise at periods at which the observer itself is
unstable; see `sampling` for both.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg

from jaxobs._module import refuse, require_integer, require_positive
from jaxobs.certificates import Corners, Sampled, SampledTube, StepCorners
from jaxobs.designs import corner_lmi, sdp
from jaxobs.designs._injected import Injected
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.polytope import Polytope, as_tuples

DEGREE = 5  # of the tube: 0 stands for Wirtinger's inequality
STRICT = 1e-9  # smallest margin that counts, in coordinates in which the metric of the continuous observer is the identity
PI_SQUARED = 9.8696  # from below, as in the certificate
TRIALS = 40  # of ever longer or shorter periods
SHORTER = 0.75  # from one period to the next, until there is a proof

Certificate = Sampled | SampledTube


@dataclasses.dataclass(frozen=True)
class Sampling:
    """model: what the period is proved for, "Euler model only" or "the continuous plant", and how. delta [s]: the largest
    period found, 0 where none is; certificate: of that period, None where none is."""

    model: str
    delta: float
    certificate: StepCorners | Certificate | None


def sampled_data(
    model: Polytope,
    gain: Any,
    *,
    delta: float,
    rate: float = 0.0,
    degree: int = DEGREE,
    inner: Any = None,
    origin: str = "given",
) -> Certificate:
    """The exact certificate that the error of the continuous plant's observer with held innovation,

        e' = A(rho) e - G(rho) C e(t_k),   t_k <= t < t_{k+1},   0 < t_{k+1} - t_k <= delta,

    decays at `rate`, whatever the intervals up to delta: certificates.SampledTube of this degree, or for degree = 0
    certificates.Sampled (Wirtinger), one small inequality at each corner that stops at a shorter period.

    gain L (n, p); delta [s] > 0; rate [1/s] >= 0. inner (r, p): the innovation in the channels of the observer f(z + K (y -
    C z)), G = L + b diag(rho) inner; none if not given, and G = L. The model is that of the plant, without measurements put
    into f: held, they would not be those of the moment. origin: where the bounds of the model come from.

    Infeasible where no such certificate passes the exact check (its `best` is the largest period found), or where the
    continuous observer itself has none at this rate. ValueError for bad arguments.
    """
    search = _Search.make("sampled_data", model, gain, inner, rate, degree, origin)
    require_positive("sampled_data", "delta", delta, "The longest time between two samples, in seconds.")
    found = search.attempt(float(delta))
    if found is not None:
        return found
    best = _largest(search.attempt, search.ceiling)[0]
    kind = f"a tube of degree {degree}" if degree else "Wirtinger's inequality"
    reason = f"{kind} proves no decay at {rate:.6g} /s with samples up to {delta:.6g} s apart"
    change = f"It does up to {best:.6g} s." + ("" if degree else f" A tube may do more: degree={DEGREE}.")
    raise Infeasible(reason, best - delta, change, best=best or None, tried=(kind,))


def largest_delta(
    model: Polytope,
    gain: Any,
    *,
    rate: float = 0.0,
    degree: int = DEGREE,
    inner: Any = None,
    rtol: float = 1e-3,
    origin: str = "given",
) -> float:
    """The largest delta [s] that `sampled_data` proves, to rtol, by bisection; 0 if none is found. Each period that counts has
    passed the exact check. Infeasible and ValueError as for sampled_data."""
    search = _Search.make("largest_delta", model, gain, inner, rate, degree, origin)
    return _largest(search.attempt, search.ceiling, rtol)[0]


def euler_delta(model: Polytope, gain: Any, *, rtol: float = 1e-3, origin: str = "given") -> float:
    """The largest period [s] at which one P proves the error of the Euler model e+ = (I + delta F(rho)) e to decay, at all
    corners; 0 if none. It says nothing about the plant that the Euler model replaces."""
    return _euler(Injected.make("euler_delta", "inner", model, gain, None), rtol, origin)[0]


def sampling(model: Polytope, gain: Any, *, origin: str = "given", rtol: float = 1e-3) -> tuple[Sampling, ...]:
    """The largest periods for one gain and what each is worth: of the Euler model, and of the continuous plant by Wirtinger's
    inequality and by a tube, with certificates. Infeasible where the continuous observer itself is not certified."""
    rows = []
    for name, degree in (("Wirtinger", 0), ("tube", DEGREE)):
        search = _Search.make("sampling", model, gain, None, 0.0, degree, origin)
        rows.append(Sampling(f"the continuous plant ({name})", *_largest(search.attempt, search.ceiling, rtol)))
    return Sampling("Euler model only", *_euler(search.system, rtol, origin)), *rows


@dataclasses.dataclass(frozen=True)
class _Search:
    """system; t: coordinates in which the P of the continuous observer is the identity (its limit for delta -> 0)."""

    system: Injected
    t: np.ndarray
    rate: float
    degree: int
    origin: str

    @staticmethod
    def make(name: str, model: Polytope, gain: Any, inner: Any, rate: float, degree: int, origin: str) -> "_Search":
        require_integer(name, "degree", degree, 0, "The degree of the tube, or 0 for Wirtinger's inequality.")
        if not (isinstance(rate, (int, float, np.number)) and np.isfinite(rate) and rate >= 0):
            fix = "Leave it out to ask for decay alone."
            raise refuse(name, "rate", repr(rate), "a number >= 0, the error's decay in 1/s", fix)
        system = Injected.make(name, "inner", model, gain, inner)
        certificate = corner_lmi.prove(system.seen, system.gain, rate=float(rate), origin=origin)
        assert isinstance(certificate, Corners)
        t = np.linalg.inv(np.linalg.cholesky(np.asarray(certificate.p))).T
        return _Search(system, t, float(rate), degree, origin)

    def attempt(self, delta: float) -> Certificate | None:
        """The certificate, if the exact check accepts one that was found in these coordinates or in those of its own metric."""
        t = self.t
        for _ in range(2):
            here = _Scaled.make(self.system, t, delta, self.rate)
            found = here.tube(self.degree) if self.degree else here.wirtinger()
            if found is None:
                return None
            own: dict[str, Any] = self.system.fields() | found[1]
            certificate = (SampledTube if self.degree else Sampled)(**own, delta=delta, rate=self.rate, origin=self.origin)
            if certificate.verify():
                return certificate
            t = t @ np.linalg.cholesky(found[0])
        return None

    @property
    def ceiling(self) -> float:
        """The period from which on a constant parameter at a corner keeps the error from decaying at the rate, which no proof
        can exceed; where it does so only in between, a period at which proofs are looked for first."""
        g, c = self.system.injections, self.system.model.output
        (k, n, p), a = g.shape, self.system.closed + g @ c
        held = np.concatenate([np.concatenate([a, -g], axis=2), np.zeros((k, p, n + p))], axis=1)

        def decays(delta: float) -> bool:
            whole = scipy.linalg.expm(delta * held)[:, :n]
            radii = np.abs(np.linalg.eigvals(whole[:, :, :n] + whole[:, :, n:] @ c))
            return bool(np.max(radii) < np.exp(-self.rate * delta))

        low, high = 0.0, 1 / max(float(np.max(np.linalg.norm(self.system.closed, 2, axis=(1, 2)))), 1e-290)
        for _ in range(TRIALS):
            if not decays(high):
                break
            low, high = high, 2 * high
        while high - low > 1e-5 * high and high > 1e-290:
            middle = (low + high) / 2
            low, high = (middle, high) if decays(middle) else (low, middle)
        return high


@dataclasses.dataclass(frozen=True)
class _Scaled:
    """(zeta, v / unit), e = t zeta, in the time tau / delta: F (corners, n, n), G (corners, n, p), C there; x = rate delta."""

    closed: np.ndarray
    injected: np.ndarray
    output: np.ndarray
    x: float
    t: np.ndarray
    unit: float
    delta: float

    @staticmethod
    def make(system: Injected, t: np.ndarray, delta: float, rate: float) -> "_Scaled":
        inverse, output = np.linalg.inv(t), system.model.output @ t
        unit = float(np.linalg.norm(output, 2)) or 1.0
        closed, injected = delta * inverse @ system.closed @ t, unit * delta * inverse @ system.injections
        return _Scaled(closed, injected, output / unit, rate * delta, t, unit, delta)

    def wirtinger(self) -> tuple[np.ndarray, dict[str, Any]] | None:
        """P^-1 here, and the user's P and W, of the largest margin."""
        if self.x >= 1:
            return None
        kappa = PI_SQUARED / 4 * (1 - self.x) + self.x**2

        def lmis(p, w):
            def whole(f, g):
                pg, wf, wg = -p @ g, -w @ self.output @ f, -w @ self.output @ g
                decrease = -(f.T @ p + p @ f) - 2 * self.x * p
                return np.block([[decrease, pg, wf.T], [pg.T, kappa * w, wg.T], [wf, wg, w]])

            return [p, w, *map(whole, self.closed, self.injected)]

        n, p = self.injected.shape[1:]
        found = sdp.feasible({"p": sdp.symmetric(n, trace=float(n)), "w": sdp.symmetric(p)}, lmis)
        if found.margin <= STRICT:
            return None
        inverse, w = np.linalg.inv(self.t), found.values["w"] / (self.delta * self.unit**2)
        metric = np.linalg.inv(found.values["p"])
        return metric, {"p": _symmetric(inverse.T @ found.values["p"] @ inverse), "w": _symmetric(w)}

    def tube(self, degree: int) -> tuple[np.ndarray, dict[str, Any]] | None:
        """Q_0 here, and the user's start and tube, of the largest margin."""
        n, p = self.injected.shape[1:]
        rows = np.concatenate([self.closed, self.injected], axis=2)
        corners = np.concatenate([rows, self.output @ rows], axis=1)

        def lmis(start, **rest):
            q = [np.pad(start, (0, p)), *rest.values()]
            found = [start, *(start - one[:n, :n] for one in q[1:])]
            for i, one in enumerate(q):
                grows = i * (one - q[i - 1]) + (degree - i) * (q[min(i + 1, degree)] - one) - 2 * self.x * one
                found += [grows - m @ one - one @ m.T for m in corners]
            return found

        later = {f"q{i}": sdp.symmetric(n + p) for i in range(1, degree + 1)}
        found = sdp.feasible({"start": sdp.symmetric(n, trace=float(n))} | later, lmis)
        if found.margin <= STRICT:
            return None
        whole = np.zeros((n + p, n + p))
        whole[:n, :n], whole[n:, n:] = self.t, self.unit * np.eye(p)
        start, tube = found.values["start"], [_symmetric(whole @ found.values[name] @ whole.T) for name in later]
        return start, {"start": _symmetric(self.t @ start @ self.t.T), "tube": sum(tube, ())}


def _symmetric(x: np.ndarray) -> tuple[Any, ...]:
    return as_tuples((x + x.T) / 2)


def _euler(system: Injected, rtol: float, origin: str) -> tuple[float, Any]:
    model = system.model

    def attempt(delta: float):
        step = dataclasses.replace(model, a=np.eye(model.n) + delta * model.a, b=delta * model.b)
        try:
            return corner_lmi.prove(step, delta * system.gain, step=True, origin=origin)
        except Infeasible:
            return None

    poles = np.linalg.eigvals(system.closed).ravel()  # |1 + delta s| < 1
    if np.max(poles.real) >= 0:
        return 0.0, None
    return _largest(attempt, float(np.min(-2 * poles.real / np.abs(poles) ** 2)), rtol)


def _largest(attempt: Callable[[float], Any], ceiling: float, rtol: float = 1e-3) -> tuple[float, Any]:
    """The largest delta below the ceiling with an outcome, and that: a proof for one period is a proof for shorter ones."""
    high = low = ceiling * (1 - rtol / 2)
    best = attempt(low)
    for _ in range(TRIALS):
        if best is not None:
            break
        high, low = low, low * SHORTER
        best = attempt(low)
    else:
        return 0.0, None
    while high > low * (1 + rtol):
        middle = float(np.sqrt(low * high))
        found = attempt(middle)
        best, low, high = (found, middle, high) if found is not None else (best, low, middle)
    return low, best
