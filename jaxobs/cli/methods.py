"""The designs that a config can ask for: one dataclass a method, its fields the keys of [design]."""

import dataclasses
from typing import Any, Literal

import numpy as np

from jaxobs import designs
from jaxobs._module import refuse
from jaxobs.certificates import AbstractCertificate
from jaxobs.cli import examine
from jaxobs.cli.reading import Matrix, Vector, options, read, unknown
from jaxobs.cli.subject import Slope, Subject
from jaxobs.designs import corner_lmi


@dataclasses.dataclass(frozen=True)
class Riccati:
    """designs.riccati: gains alphas_i gamma^i, condition (5) or (44)."""

    lipschitz: float
    alphas: Vector | None = None
    gamma: float | None = None
    q: int = 0

    def certificate(self, subject: Subject) -> AbstractCertificate:
        return designs.riccati(subject.require_plant(), **options(self))[1]


@dataclasses.dataclass(frozen=True)
class SLemma:
    """designs.s_lemma: every phi with a norm-bounded slope."""

    alphas: Vector
    slope: Slope
    gamma: float | None = None
    q: int = 0
    rate: float = 0.0

    def certificate(self, subject: Subject) -> AbstractCertificate:
        plant = subject.require_plant()
        return designs.s_lemma(plant, slope=self.slope.norm_bounded(plant.n), **options(self, "slope"))[1]


@dataclasses.dataclass(frozen=True)
class EulerRiccati:
    """designs.euler_riccati: (63), for the Euler model."""

    alphas: Vector
    gamma: float
    dt: float
    slope: Slope
    q: int = 0

    def certificate(self, subject: Subject) -> AbstractCertificate:
        plant = subject.require_plant()
        return designs.euler_riccati(plant, slope=self.slope.norm_bounded(plant.n), **options(self, "slope"))[1]


@dataclasses.dataclass(frozen=True)
class EulerFree:
    """designs.euler_free: (62) with the gain set free."""

    dt: float
    slope: Slope
    q: int = 0
    unit: float | None = None
    factor: float = 1.0

    def certificate(self, subject: Subject) -> AbstractCertificate:
        plant = subject.require_plant()
        return designs.euler_free(plant, slope=self.slope.norm_bounded(plant.n), **options(self, "slope"))[1]


@dataclasses.dataclass(frozen=True)
class HighGainLmi:
    """designs.high_gain_lmi: a chain whose slopes lie in the rows (lowest, highest) of `slopes`."""

    slopes: Matrix
    j0: int = 0
    theta: float | None = None
    sigma: float | None = None
    gain: Vector | None = None
    constant: float | None = None
    rate: float = 0.0

    def certificate(self, subject: Subject) -> AbstractCertificate:
        return designs.high_gain_lmi(subject.require_plant(), bounds=np.array(self.slopes), **options(self, "slopes"))[1]


@dataclasses.dataclass(frozen=True)
class StandardHighGain:
    """designs.standard_high_gain."""

    slopes: Matrix
    theta: float | None = None
    constant: float | None = None

    def certificate(self, subject: Subject) -> AbstractCertificate:
        found = designs.standard_high_gain(subject.require_plant(), bounds=np.array(self.slopes), **options(self, "slopes"))
        return found[1]


@dataclasses.dataclass(frozen=True)
class Triangular:
    """designs.triangular: theorem 1 of paper 003."""

    slopes: Matrix
    lower: Vector | None = None
    upper: Vector | None = None
    theta: float | None = None
    rate: float = 0.0
    gain: Vector | None = None
    origin: str = "given"

    def certificate(self, subject: Subject) -> AbstractCertificate:
        couplings = None if self.lower is None or self.upper is None else (np.array(self.lower), np.array(self.upper))
        more = options(self, "slopes", "lower", "upper")
        found = designs.triangular(subject.require_plant(), slopes=np.array(self.slopes), couplings=couplings, **more)
        return found[1]


@dataclasses.dataclass(frozen=True)
class LpvLmi:
    """designs.lpv_lmi: a gain for the plant and all slopes within [bounds]; gain: that one."""

    rate: float | None = None
    gain: Matrix | None = None
    inner: bool = False

    def certificate(self, subject: Subject) -> AbstractCertificate:
        plant, bounds = subject.require_plant(), subject.require_bounds()
        return designs.lpv_lmi(plant, bounds=bounds.channels(getattr(plant, "plant", plant)), **options(self))[1]


@dataclasses.dataclass(frozen=True)
class Prove:
    """designs.corner_lmi.prove: a given gain decays at the rate [1/s] (the factor a step) at all corners."""

    gain: Matrix
    rate: float | None = None

    def certificate(self, subject: Subject) -> AbstractCertificate:
        return corner_lmi.prove(subject.polytope(), step=subject.step, origin=subject.origin, **options(self))


@dataclasses.dataclass(frozen=True)
class Objective:
    """What `synthesize` makes small: noise in the mean ("h2"), energy ("l2"), or the gain itself ("gain")."""

    kind: Literal["h2", "l2", "gain"] = "h2"
    weight: Matrix | None = None
    process: Matrix | None = None
    noise: Matrix | None = None

    def objective(self) -> Any:
        if self.kind == "gain":
            return designs.Gain()
        return {"h2": designs.H2, "l2": designs.L2}[self.kind](**options(self, "kind"))


@dataclasses.dataclass(frozen=True)
class Synthesize:
    """designs.synthesize: the gain with the least proved noise (or energy, or norm) at a required rate."""

    rate: float = 0.0
    objective: Objective = Objective()
    cover: Literal["multiplier", "lazy", "corners"] = "lazy"
    seed: Matrix | None = None
    inner: bool = False

    def certificate(self, subject: Subject) -> AbstractCertificate:
        more: dict[str, Any] = options(self, "objective") | {"origin": subject.origin}
        found = designs.synthesize(subject.polytope(), objective=self.objective.objective(), **more)
        return found.certificate


@dataclasses.dataclass(frozen=True)
class SampledData:
    """designs.sampled_data: the innovation held between samples at most delta [s] apart."""

    gain: Matrix
    delta: float
    rate: float = 0.0
    degree: int = 5

    def certificate(self, subject: Subject) -> AbstractCertificate:
        return designs.sampled_data(subject.polytope(), origin=subject.origin, **options(self))


@dataclasses.dataclass(frozen=True)
class Regional:
    """designs.regional: for bounds that hold in the box `outer` and a state that stays in the box `inner`, both (2, n)."""

    gain: Matrix
    inner: Matrix
    outer: Matrix
    rate: float = 0.0
    aim: Literal["ball", "volume"] = "ball"

    def certificate(self, subject: Subject) -> AbstractCertificate:
        sets: dict[str, Any] = {"inner": tuple(map(np.array, self.inner)), "outer": tuple(map(np.array, self.outer))}
        return designs.regional(subject.polytope(), **(options(self) | sets), origin=subject.origin)


@dataclasses.dataclass(frozen=True)
class UltimateBound:
    """designs.ultimate_bound: what is left of the error where the model is wrong by `size`, the measurement by `noise_size`."""

    gain: Matrix
    disturbance: Matrix
    size: float
    noise_size: float = 0.0
    weight: Matrix | None = None
    alpha: float | None = None

    def certificate(self, subject: Subject) -> AbstractCertificate:
        return designs.ultimate_bound(subject.polytope(), origin=subject.origin, **options(self))


METHODS: dict[str, Any] = {
    "euler_free": EulerFree,
    "euler_riccati": EulerRiccati,
    "high_gain_lmi": HighGainLmi,
    "lpv_lmi": LpvLmi,
    "prove": Prove,
    "regional": Regional,
    "riccati": Riccati,
    "s_lemma": SLemma,
    "sampled_data": SampledData,
    "standard_high_gain": StandardHighGain,
    "synthesize": Synthesize,
    "triangular": Triangular,
    "ultimate_bound": UltimateBound,
} | examine.METHODS


def method_from(table: Any) -> Any:
    """[design] method = "riccati" and its options."""
    if not isinstance(table, dict) or not isinstance(table.get("method"), str):
        raise refuse("config", "design.method", repr(table), "the name of a design", f"One of {', '.join(METHODS)}.")
    if table["method"] not in METHODS:
        raise unknown("design.method", table["method"], list(METHODS))
    return read(METHODS[table["method"]], {name: given for name, given in table.items() if name != "method"}, "design")
