"""What can be proved of a given gain: its decay rate, its noise levels, its region, by each cover, next to what no proof
exceeds."""

import dataclasses
import time
from typing import Any

import numpy as np

from jaxobs._module import refuse, require_instance
from jaxobs.certificates import AbstractCertificate, Corners, H2Level, L2Level
from jaxobs.designs._descent import judged
from jaxobs.designs._dynamics import Dynamics, stationary
from jaxobs.designs._proofs import certified
from jaxobs.designs._rates import fastest
from jaxobs.designs.covers import Cover, cover_of
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.ladder import Rung, ladder
from jaxobs.designs.objectives import H2, L2, Gain, Objective, dynamics
from jaxobs.designs.polytope import Polytope
from jaxobs.designs.regional import regional
from jaxobs.plants import AbstractChain

SHORT = 1 - 1e-4  # of the largest rate: where certificates are made, so that they hold strictly


@dataclasses.dataclass(frozen=True)
class Proved:
    """One way of proof: the largest rate [1/s], the least root of E|E e|^2 (h2) and the least energy gain (l2) by it, None
    where there is none; seconds that it took."""

    name: str
    rate: float | None
    h2: float | None
    l2: float | None
    seconds: float


@dataclasses.dataclass(frozen=True, eq=False)
class Analysis:
    """Of the gain of a Polytope. rate [1/s], h2, l2, radius: the best that is proved, each by `certificates` under the same
    name, None where nothing is. rungs: the ways of proof, cheapest first. frozen_rate, frozen_h2: the slowest decay and the
    largest root of E|E e|^2 over constant rho at the corners: no certificate can say more. chain: the ladder of a chain's own
    proofs.
    """

    rate: float | None
    h2: float | None
    l2: float | None
    radius: float | None
    certificates: dict[str, AbstractCertificate]
    rungs: tuple[Proved, ...]
    frozen_rate: float
    frozen_h2: float
    chain: tuple[Rung, ...]

    def __str__(self) -> str:
        rows = [("proof", "rate 1/s", "H2", "L2", "s")]
        rows += [(one.name, *map(_shown, (one.rate, one.h2, one.l2)), f"{one.seconds:.2f}") for one in self.rungs]
        rows.append(("no proof exceeds", _shown(self.frozen_rate), _shown(self.frozen_h2), "", ""))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        if self.radius is not None:
            lines.append(f"initial errors up to |e(0)| = {self.radius:.6g} stay in the region of the bounds")
        for one in self.chain:
            state = "certified" if one.certificate is not None else "not certified"
            lines.append(f"{one.name}: {state}")
        return "\n".join([*lines, f"certificates: {', '.join(self.certificates) or 'none'}"])


def prove_level(
    lpv: Polytope,
    gain: Any,
    *,
    objective: Objective | None = None,
    rate: float | None = None,
    cover: Cover = "lazy",
    inner: Any = None,
    origin: str = "given",
) -> H2Level | L2Level | Corners:
    """The exact certificate of the least level of a given gain L (n, p), with K (r, p) if any, that is found at `rate`.

    rate [1/s] >= 0, the largest that is proved if not given. Everything else as in `synthesize`. Infeasible, with the largest
    rate as `best`, where the rate is not proved; ValueError for bad arguments.
    """
    objective = H2() if objective is None else objective
    require_instance("prove_level", "objective", objective, H2 | L2 | Gain, "For instance H2(process=..., noise=...).")
    require_instance("prove_level", "lpv", lpv, Polytope, "Make it with jaxobs.designs.lpv_model(plant, channels).")
    if rate is not None and not (np.isfinite(rate) and rate >= 0):
        raise refuse("prove_level", "rate", repr(rate), "a number >= 0, in 1/s", "Leave it out for the largest one.")
    d = dynamics("prove_level", lpv, np.asarray(gain, float), None if inner is None else np.asarray(inner, float), objective)
    way = cover_of("prove_level", lpv, cover)
    proof = fastest(d, way)
    wanted = max(proof.rate * SHORT, 0.0) if rate is None else float(rate)
    forms = _forms(objective, d)
    point = judged(proof, forms, way) if proof.rate > 0 and proof.rate >= wanted else None
    if point is None:
        best = proof.rate if proof.rate > 0 else None
        change = "Ask for less, narrow the bounds, or change the gain." if best else "Narrow the bounds, or change the gain."
        reason = f"no P was found that proves the decay rate {wanted:.6g} 1/s of this gain"
        raise Infeasible(reason, proof.rate - wanted, change, best=best, tried=(f"cover {cover}",))
    certificate, _ = certified(point, wanted, cover, origin)
    assert isinstance(certificate, H2Level | L2Level | Corners)
    return certificate


def analyse(
    lpv: Polytope,
    gain: Any,
    *,
    inner: Any = None,
    weight: Any = None,
    process: Any = None,
    noise: Any = None,
    covers: tuple[Cover, ...] = ("multiplier", "lazy"),
    region: tuple[Any, Any] | None = None,
    plant: AbstractChain | None = None,
    lipschitz: float | None = None,
    origin: str = "given",
) -> Analysis:
    """The best rate, noise levels and region that can be proved for the gain L (n, p), and K (r, p) if given, of

        e' = F(rho) e + process w - (L + b diag(rho) K) noise v,     levels of weight e as in H2 and L2, at the rate zero.

    region: (where the state stays, where the bounds hold), as `inner` and `outer` of `regional`. plant and lipschitz: of a
    chain whose model lpv is; the ladder of its own proofs at this gain is then added. Nothing proved is None, never "unstable".
    ValueError for arguments that do not fit.
    """
    require_instance("analyse", "lpv", lpv, Polytope, "Make it with jaxobs.designs.lpv_model(plant, channels).")
    gain = np.asarray(gain, float)
    inner = None if inner is None else np.asarray(inner, float)
    injected = inner is not None and bool(np.any(inner))  # then the covariance form is the only one there is
    objectives = {"h2": H2(weight, process, noise, independent=injected), "l2": L2(weight, process, noise)}
    d = dynamics("analyse", lpv, gain, inner, objectives["h2"])
    rungs, certificates = [], {}
    for cover in covers:
        started = time.perf_counter()
        found: dict[str, float | None] = {"rate": None, "h2": None, "l2": None}
        for name, objective in {"rate": Gain(), **objectives}.items():
            rate = None if name == "rate" else 0.0
            try:
                one = prove_level(lpv, gain, objective=objective, rate=rate, cover=cover, inner=inner, origin=origin)
            except Infeasible:
                continue
            found[name] = value = _value(one)
            better = certificates.get(name) is None or (value > _value(certificates[name])) == (name == "rate")
            certificates |= {name: one} if better else {}
        rungs.append(Proved(cover if cover == "multiplier" else "corners", **found, seconds=time.perf_counter() - started))
    radius = None
    if region is not None:
        try:
            certificates["region"] = own = regional(lpv, gain, inner=region[0], outer=region[1], injection=inner, origin=origin)
            radius = own.radius
        except Infeasible:
            pass
    best = {name: _value(certificates[name]) if name in certificates else None for name in ("rate", "h2", "l2")}
    return Analysis(**best, radius=radius, certificates=certificates, rungs=tuple(rungs), frozen_rate=_slowest(d),
                    frozen_h2=frozen_level(d), chain=_ladder(lpv, gain, plant, lipschitz))  # fmt: skip


def frozen_level(d: Dynamics) -> float:
    """The largest root of E|E e|^2 over the corners with rho constant, infinite where one is not Hurwitz: F S + S F' + G G' =
    0. A lower bound of every guaranteed one."""
    largest = 0.0
    for f, rho in zip(d.at_corners(), d.model.parameters(), strict=True):
        side = np.concatenate([d.process, (d.gain + (d.model.b * rho) @ d.inner) @ d.noise], 1)
        x = stationary(f, side)
        if x is None:
            return float("inf")
        largest = max(largest, float(np.trace(d.weight @ x @ d.weight.T)))
    return float(np.sqrt(largest))


def _slowest(d: Dynamics) -> float:
    return -float(np.linalg.eigvals(d.at_corners()).real.max())


def _forms(objective: Objective, d: Dynamics) -> tuple[str, ...]:
    return tuple(form for form in getattr(objective, "forms", ()) if form != "energy" or not np.any(d.inner))


def _value(one: AbstractCertificate) -> float:
    """The rate, the root of the variance, or the energy gain."""
    match one:
        case H2Level():
            return float(np.sqrt(one.level))
        case L2Level():
            return one.level
        case Corners():
            return one.rate
    raise TypeError(one.theorem)


def _ladder(lpv: Polytope, gain: np.ndarray, plant: AbstractChain | None, lipschitz: float | None) -> tuple[Rung, ...]:
    if plant is None:
        return ()
    n = plant.n
    chain = lpv.n == n and np.array_equal(lpv.a, np.eye(n, k=1)) and np.array_equal(lpv.output, np.eye(1, n))
    if lipschitz is None or not chain:
        fix = "Give the Lipschitz constant of phi, and the model of this chain."
        raise refuse("analyse", "plant", f"{plant} with lipschitz = {lipschitz}", "a chain, its constant, its own model", fix)
    slopes, last = np.zeros((n, 2)), np.eye(n)[:, -1:]
    entering = [int(j) for j in np.argmax(lpv.c, axis=1)]
    if not (np.array_equal(lpv.b, np.tile(last, (1, lpv.r))) and np.array_equal(lpv.c, np.eye(n)[entering])):
        return ladder(plant, alphas=gain[:, 0], lipschitz=lipschitz, gamma=1.0)
    for j, low, high in zip(entering, lpv.lower, lpv.upper, strict=True):
        slopes[j] += low, high
    states = [j + 1 for j in sorted(set(entering))]
    return ladder(plant, alphas=gain[:, 0], lipschitz=lipschitz, states=states, slopes=slopes, gamma=1.0)


def _shown(x: float | None) -> str:
    return "-" if x is None else f"{x:.5g}"
