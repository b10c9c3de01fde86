"""The methods of a config that examine rather than design: a given gain, and what no gain can do."""

import dataclasses
from typing import Any, Literal

import numpy as np
from rich.console import Console

from jaxobs import designs
from jaxobs.certificates import AbstractCertificate
from jaxobs.cli.reading import Matrix, options, read, unknown
from jaxobs.cli.subject import Subject, subject_from
from jaxobs.designs import Infeasible


def found(certificate: Any, what: str, change: str) -> Any:
    """The certificate; Infeasible, which decides nothing, where the search came back without one."""
    if certificate is None:
        raise Infeasible(f"no proof was found {what}, which decides nothing", float("nan"), change)
    return certificate


@dataclasses.dataclass(frozen=True)
class Analyse:
    """designs.analyse: the best that can be proved for a given gain; `proof` says which of its certificates is written."""

    gain: Matrix
    proof: Literal["rate", "h2", "l2"] = "rate"
    weight: Matrix | None = None
    process: Matrix | None = None
    noise: Matrix | None = None

    def certificate(self, subject: Subject) -> AbstractCertificate:
        analysis = designs.analyse(subject.polytope(), origin=subject.origin, **options(self, "proof"))
        Console(stderr=True).print(str(analysis), markup=False, highlight=False)
        change = "Ask for another proof, or for narrower bounds."
        return found(analysis.certificates.get(self.proof), f"of a bound on {self.proof}", change)


@dataclasses.dataclass(frozen=True)
class NoGain:
    """designs.no_gain: no quadratic Lyapunov function for this gain, for any, or for any with |L| <= radius."""

    gain: Matrix | None = None
    rate: float | None = None
    radius: float | None = None

    def certificate(self, subject: Subject) -> AbstractCertificate:
        absent = designs.no_gain(subject.polytope(), step=subject.step, **options(self))
        return found(absent, "that no gain will do", "Try `synthesize`: there may be one; or a smaller radius.")


@dataclasses.dataclass(frozen=True)
class GainFloor:
    """designs.gain_floor: every gain that makes the error decay is larger than a floor."""

    rate: float = 0.0

    def certificate(self, subject: Subject) -> AbstractCertificate:
        return designs.gain_floor(subject.polytope(), rate=self.rate)[1]


@dataclasses.dataclass(frozen=True)
class KalmanFloor:
    """designs.kalman_floor: no filter has less noise."""

    weight: Matrix
    process: Matrix
    noise: Matrix

    def certificate(self, subject: Subject) -> AbstractCertificate:
        return designs.kalman_floor(subject.polytope(), *map(np.array, (self.weight, self.process, self.noise)))


@dataclasses.dataclass(frozen=True)
class Undetectable:
    """designs.undetectable: parameters at which the outputs do not see a mode that does not decay at the rate."""

    rate: float = 0.0

    def certificate(self, subject: Subject) -> AbstractCertificate:
        point = designs.undetectable(subject.polytope(), rate=self.rate, step=subject.step)
        absent = None if point is None else point.certificate
        return found(absent, "of an undetectable mode", "Ask for a higher rate, or search for a gain: `synthesize`.")


@dataclasses.dataclass(frozen=True)
class Audited:
    """[audit]: a gain, and the rate [1/s], or the factor a step, that it is to prove."""

    gain: Matrix
    rate: float | None = None


def audited(tables: dict[str, Any]) -> tuple[Subject, designs.Audit]:
    """The audit that a config asks for. ValueError names the key."""
    design = tables.get("design")
    if "audit" not in tables and isinstance(design, dict) and "gain" in design:
        tables = tables | {"audit": {name: design[name] for name in ("gain", "rate") if name in design}}
    for name in tables:
        if name not in ("plant", "bounds", "model", "design", "audit"):
            raise unknown(name, name, ["plant", "bounds", "model", "audit"])
    asked = read(Audited, tables.get("audit", {}), "audit")
    subject = subject_from(tables)
    return subject, designs.audit(subject.polytope(), np.array(asked.gain), rate=asked.rate, step=subject.step)


METHODS: dict[str, Any] = {
    "analyse": Analyse,
    "gain_floor": GainFloor,
    "kalman_floor": KalmanFloor,
    "no_gain": NoGain,
    "undetectable": Undetectable,
}
