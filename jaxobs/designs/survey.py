"""One plant, one region, one required rate: what every design that applies makes of it, side by side.

All gains are proved on the same error dynamics, with bounds that interval arithmetic proves of the plant's own Jacobian, at the
same decay rate; then their guaranteed noise can be compared.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxobs._module import refuse, require_instance
from jaxobs.certificates import AbstractCertificate, Corners, StepCorners, with_bounds
from jaxobs.designs import corner_lmi
from jaxobs.designs._system import exact
from jaxobs.designs.analysis import prove_level
from jaxobs.designs.detectability import undetectable
from jaxobs.designs.high_gain_lmi import high_gain_lmi
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.lpv_from import Lpv, lpv_from
from jaxobs.designs.objectives import H2
from jaxobs.designs.polytope import Polytope
from jaxobs.designs.synthesis import synthesize
from jaxobs.hurwitz import binomial
from jaxobs.observers import Luenberger, StepLuenberger
from jaxobs.plants import AbstractChain, AbstractFlowPlant, AbstractStepPlant
from jaxobs.plants._depends import require_timeless

ROOM = 1e-3  # by which bounds are wider than the best ones, so that plain arithmetic proves them again
LARGEST_GAMMA = 1e6
SPREAD = 0.05  # of the bisection in log gamma


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """One design's gain L (n, p), with its exact certificate, and, for flows, the guaranteed mean of |e|^2 under the noises of
    the survey, at the required rate; or, without a gain, the `reason` why the design gave none (which never means that the
    plant cannot be observed)."""

    name: str
    observer: Luenberger | StepLuenberger | None = None
    certificate: AbstractCertificate | None = None
    level: float | None = None
    reason: str = ""
    change: str = ""

    @property
    def gain(self) -> np.ndarray | None:
        return None if self.observer is None else np.asarray(self.observer.gain, float)


@dataclasses.dataclass(frozen=True, eq=False)
class Survey:
    """candidates: in the order of their guaranteed noise, those without a proof last. lpv: the error dynamics they are proved
    on, and what its bounds stand on. rate [1/s], or the factor a step: what all of them prove. noise, process: the intensities
    under which `level` is the mean of |e|^2. absence: the exact proof that no constant gain can work, where one was found."""

    candidates: tuple[Candidate, ...]
    lpv: Lpv
    rate: float
    noise: np.ndarray
    process: np.ndarray
    absence: AbstractCertificate | None
    travelling: Callable[[AbstractCertificate], Any]

    @property
    def best(self) -> Candidate | None:
        """The proved one with the least guaranteed noise; None if none is proved."""
        return next((one for one in self.candidates if one.certificate is not None), None)


def survey(
    plant: AbstractFlowPlant | AbstractStepPlant,
    within: tuple[Any, Any],
    *,
    inputs: Any = None,
    rate: float | None = None,
    noise: Any = None,
    process: Any = None,
    progress: Callable[[str], None] | None = None,
) -> Survey:
    """Gains L of z' = f(z, u) + L (y - C z), or of z+, by every design that applies, all proved to decay at `rate` for

        e' = (J(x, z, u) - L C) e,      J a mean of df/dx over the box `within` and the inputs,

    with bounds on J that are proved (`lpv_from`). For a chain: the gains binomial_i gamma^i of the smallest gamma that proves
    the rate, and HG/LMI at its best j0; for every plant: LPV/LMI; for flows: the least guaranteed noise (`synthesize`).

    within: (lower, upper), both (n,), where the state and its estimate stay; infinite where nothing bounds them. inputs:
    (lower, upper), both (m,). rate [1/s] >= 0, for step plants the factor a step in ]0, 1]; if not given, the largest real
    part of an eigenvalue of J at a corner, but at least 1 /s (0.99 a step). noise (p, p) and process (n, w): square roots of
    intensities of the white noises on y and on x', by which candidates are ranked; 0.1 I and the plant's disturbance matrix if
    not given.

    ValueError for an output that is not linear (see `plants.NormalForm`), a slope that nothing bounds (the box is named), and
    arguments of the wrong shape. `travelling` of the result lets a certificate carry the proof of its bounds. Sources: those of
    `corner_lmi.prove`, `high_gain_lmi`, `lpv_lmi` and `synthesize`.
    """
    require_instance("survey", "plant", plant, AbstractFlowPlant | AbstractStepPlant, "Build it: jaxobs.plants.Pendulum().")
    step = isinstance(plant, AbstractStepPlant)
    low, high = (np.atleast_1d(np.asarray(end, float)) for end in within)
    if low.shape != (plant.n,) or high.shape != (plant.n,):
        expected = f"(lower, upper), one number for each of the {plant.n} states"
        raise refuse("survey", "within", f"shapes {low.shape} and {high.shape}", expected, "Infinite where nothing bounds it.")
    if rate is not None and not (np.isfinite(rate) and (0 < rate <= 1 if step else rate >= 0)):
        expected = "a factor a step in ]0, 1]" if step else "a number >= 0, in 1/s"
        raise refuse("survey", "rate", repr(rate), expected, "Leave it out for a rate that suits the plant.")
    lpv = lpv_from(plant, None, (low, high), inputs=inputs, room=ROOM)
    model = lpv.model
    wanted = _own_rate(model, step) if rate is None else float(rate)
    v = 0.1 * np.eye(model.p) if noise is None else np.atleast_2d(np.asarray(noise, float))
    w = np.asarray(plant.disturbance_matrix(), float) if process is None else np.atleast_2d(np.asarray(process, float))
    say = progress or (lambda done: None)
    absent = undetectable(model, rate=wanted, step=step)
    found = []
    for name, way in _ways(plant, lpv, wanted, w, v).items():
        say(name)
        found.append(_candidate(name, way, plant, lpv, wanted, w, v))
    found.sort(key=lambda one: (one.certificate is None, one.level is None, one.level))
    inside = functools.partial(_travelling, plant=plant, low=low, high=high, inputs=inputs)
    return Survey(tuple(found), lpv, wanted, v, w, None if absent is None else absent.certificate, inside)


def _own_rate(model: Polytope, step: bool) -> float:
    """A rate that suits the plant: that of its fastest growth."""
    growth = max(float(np.linalg.eigvals(model.at(rho)).real.max()) for rho in model.parameters())
    return 0.99 if step else max(1.0, growth)


def _ways(plant: Any, lpv: Lpv, rate: float, w: np.ndarray, v: np.ndarray) -> dict[str, Callable[[], np.ndarray]]:
    """What can be tried: name and the gain it gives, or raises Infeasible."""
    model, step = lpv.model, isinstance(plant, AbstractStepPlant)
    ways: dict[str, Callable[[], np.ndarray]] = {}
    if isinstance(plant, AbstractChain):
        ways["high_gain"] = lambda: _smallest_gamma(model, rate)
        ways["high_gain_lmi"] = lambda: _high_gain(plant, model, rate, w, v)
    ways["lpv_lmi"] = lambda: corner_lmi.synthesise(model, rate=rate, step=step, process=w @ w.T, noise=v @ v.T)[0]
    if not step:
        ways["synthesize"] = lambda: synthesize(model, objective=H2(process=w, noise=v), rate=rate).gain
    return ways


def _candidate(name: str, way: Callable[[], np.ndarray], plant: Any, lpv: Lpv, rate: float, w: np.ndarray, v: np.ndarray):
    """The gain with its proof on the shared model."""
    try:
        if isinstance(plant, AbstractStepPlant):
            observer: Luenberger | StepLuenberger = StepLuenberger(plant, jnp.asarray(way()))
            certificate = _proved(lpv, np.asarray(observer.gain, float), rate, True)
            return Candidate(name, observer, certificate)
        observer = Luenberger(plant, jnp.asarray(way()))
        gain = np.asarray(observer.gain, float)  # as it is carried, in the plant's precision
        certificate: Any = prove_level(lpv.model, gain, objective=H2(process=w, noise=v), rate=rate, origin=lpv.origin)
        return Candidate(name, observer, certificate, float(certificate.level))
    except Infeasible as error:
        return Candidate(name, reason=error.reason, change=error.change)


def _proved(lpv: Lpv, gain: np.ndarray, rate: float, step: bool) -> Corners | StepCorners:
    return corner_lmi.prove(lpv.model, gain, rate=rate, step=step, origin=lpv.origin)


def _smallest_gamma(model: Polytope, rate: float) -> np.ndarray:
    """binomial_i gamma^i for a gamma that proves the rate at all corners, within 5 % of the smallest one."""
    alphas, powers = np.asarray(binomial(model.n), float), np.arange(1.0, model.n + 1)

    def gain(gamma: float) -> np.ndarray:
        return (alphas * gamma**powers)[:, None]

    def holds(gamma: float) -> bool:
        try:
            return bool(corner_lmi.prove(model, gain(gamma), rate=rate))
        except Infeasible:
            return False

    high = max(rate, 1.0)
    while not holds(high):
        high *= 2
        if high > LARGEST_GAMMA:
            change = "Ask for a lower rate, or narrow the box."
            raise Infeasible(f"no gamma up to {LARGEST_GAMMA:g} proves the rate {rate:.6g} 1/s", float("nan"), change)
    low = high / 2
    while low > 1e-9 and holds(low):  # only where the first gamma held already
        low, high = low / 2, low
    while high / low > 1 + SPREAD:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if holds(middle) else (middle, high)
    return gain(high)


def _high_gain(plant: AbstractChain, model: Polytope, rate: float, w: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The gain of the j0 with the least guaranteed noise among those that prove the rate on the shared model."""
    last = np.stack([model.at(rho)[-1] for rho in model.parameters()])
    slopes = np.stack([np.minimum(last.min(axis=0), 0), np.maximum(last.max(axis=0), 0)], axis=1)  # each contains 0
    best: tuple[float, np.ndarray] | None = None
    failed: Infeasible | None = None
    for j0 in range(plant.n + 1):
        try:
            gain = np.asarray(high_gain_lmi(plant, bounds=slopes, j0=j0, rate=rate)[0].gain, float)
            proof: Any = prove_level(model, gain, objective=H2(process=w, noise=v), rate=rate)
        except Infeasible as error:
            failed = error
            continue
        best = (proof.level, gain) if best is None or proof.level < best[0] else best
    if best is None:
        assert failed is not None
        raise failed
    return best[1]


def _travelling(certificate: AbstractCertificate, *, plant: Any, low: np.ndarray, high: np.ndarray, inputs: Any) -> Any:
    """The certificate with the proof of its bounds; ValueError where plain arithmetic cannot repeat it."""
    own, zero = exact(plant), np.zeros(())
    move: Callable[..., Any] = own.step if isinstance(own, AbstractStepPlant) else own.flow
    require_timeless("survey", own)
    if plant.m == 0:
        return with_bounds(certificate, lambda x: move(zero, x, np.zeros(0)), low, high)
    u = (np.full(plant.m, -np.inf), np.full(plant.m, np.inf)) if inputs is None else inputs
    ends = np.append(low, np.atleast_1d(np.asarray(u[0], float))), np.append(high, np.atleast_1d(np.asarray(u[1], float)))
    return with_bounds(certificate, lambda x, u: move(zero, x, u), *ends)
