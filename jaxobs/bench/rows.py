"""A gain and all that is known of it, as one row; and two rows at the same proved rate."""

import dataclasses
import time
from typing import Literal

import numpy as np

from jaxobs.bench import measures
from jaxobs.certificates import AbstractCertificate, H2Level
from jaxobs.designs import H2, Infeasible, prove_level, synthesize
from jaxobs.designs.polytope import Polytope, as_tuples

TIE = 1e-3  # relative difference of levels below which nobody wins
STEPS = 40  # of a descent: the first ones bring most

Outcome = Literal["wins", "ties", "loses", "neither proved"]


@dataclasses.dataclass(frozen=True)
class Problem:
    """The error dynamics, the noise that counts, and where the bounds come from."""

    name: str
    model: Polytope
    objective: H2
    origin: str

    @property
    def factors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(E (s, n), the factor of the process noise (n, m), that of the measurement noise (p, k)), identities if not given."""
        one, sizes = self.objective, (self.model.n, self.model.n, self.model.p)
        given = (one.weight, one.process, one.noise)
        e, w, v = (np.eye(k) if part is None else np.asarray(part, float) for k, part in zip(sizes, given, strict=True))
        return e, w, v


@dataclasses.dataclass(frozen=True)
class GainRow:
    """gain L (n, p) and its Frobenius norm; what is proved for all rho(t) in the box: `rate` [1/s] and `level`, sqrt of the
    bound on E |E e|^2, None where nothing is; what is computed at constant rho: `nominal`, sqrt(E |E e|^2) in the middle of the
    box, its `channels`, the standard deviations of the states there, `frozen` at the worst corner, and the `peak` of the
    transient there. seconds: of the design, None for a gain from print. verdict: of the exact check."""

    problem: str
    method: str
    gain: tuple[tuple[float, ...], ...]
    norm: float
    rate: float | None
    level: float | None
    nominal: float
    channels: tuple[float, ...]
    frozen: float
    peak: float
    seconds: float | None
    verdict: str
    certificate: AbstractCertificate | None = dataclasses.field(default=None, repr=False)


@dataclasses.dataclass(frozen=True)
class Pair:
    """A gain from elsewhere and ours at the rate that is proved for it; ours is None where none is proved."""

    theirs: GainRow
    ours: GainRow | None

    @property
    def ratio(self) -> float | None:
        """Our guaranteed level over theirs."""
        if self.ours is None or self.ours.level is None or self.theirs.level is None:
            return None
        return self.ours.level / self.theirs.level

    @property
    def outcome(self) -> Outcome:
        """`ties` within TIE; a gain without a proof of its own is no rival, and none for ours is a loss."""
        if self.theirs.level is None:
            return "neither proved"
        if self.ratio is None:
            return "loses"
        return "wins" if self.ratio < 1 - TIE else "ties" if self.ratio <= 1 + TIE else "loses"


def given(problem: Problem, method: str, gain: np.ndarray, *, seconds: float | None = None) -> GainRow:
    """The row of a gain from elsewhere: the largest rate that one P proves for it, and the least noise level."""
    try:
        proof = prove_level(problem.model, gain, objective=problem.objective, cover="corners", origin=problem.origin)
    except Infeasible:
        return _row(problem, method, gain, None, None, None, seconds)
    assert isinstance(proof, H2Level)
    return _row(problem, method, gain, proof, proof.rate, float(np.sqrt(proof.level)), seconds)


@dataclasses.dataclass(frozen=True)
class Design:
    """A gain (n, p) of ours, sqrt of its guaranteed E |E e|^2, the certificate of both, and the time of it all."""

    gain: np.ndarray
    level: float
    certificate: AbstractCertificate
    seconds: float


def design(problem: Problem, rate: float) -> Design:
    """Found by the cheapest cover, one inequality for the whole box; then its level once more, at all corners: sharper.
    Infeasible where no gain is found that proves the rate."""
    begin, shared = time.perf_counter(), {"objective": problem.objective, "rate": rate, "origin": problem.origin}
    found = synthesize(problem.model, cover="multiplier", steps=STEPS, **shared)
    level, certificate = found.level, found.certificate
    try:
        sharper = prove_level(problem.model, found.gain, cover="corners", **shared)
        if isinstance(sharper, H2Level) and sharper.level < level:
            level, certificate = sharper.level, sharper
    except Infeasible:
        pass  # that of the synthesis stands
    return Design(found.gain, float(np.sqrt(level)), certificate, time.perf_counter() - begin)


def beside(problem: Problem, theirs: GainRow) -> Pair:
    """Ours at the rate that is proved for theirs."""
    if theirs.rate is None:
        return Pair(theirs, None)
    try:
        ours = design(problem, theirs.rate)
    except Infeasible:
        return Pair(theirs, None)
    name = f"ours, at the rate of {theirs.method.partition(',')[0]}"
    return Pair(theirs, _row(problem, name, ours.gain, ours.certificate, theirs.rate, ours.level, ours.seconds))


def _row(
    problem: Problem, method: str, gain: np.ndarray, certificate: AbstractCertificate | None, rate, level, seconds
) -> GainRow:
    """The noise and the peak of a gain computed, its certificate checked once more."""
    (e, w, v), model, gain = problem.factors, problem.model, np.asarray(gain, float)
    middle = measures.noise_at(model, gain, (model.lower + model.upper) / 2, w, v)
    channels = (np.inf,) * model.n if middle is None else as_tuples(np.sqrt(np.diag(middle)))
    nominal = np.inf if middle is None else float(np.sqrt(np.trace(e @ middle @ e.T)))
    frozen = float(np.sqrt(measures.worst_at_corners(model, gain, e, w, v)))
    verdict = "verified" if certificate is not None and certificate.verify() else "not certified"
    return GainRow(
        problem.name, method, as_tuples(gain), float(np.linalg.norm(gain)), rate, level, nominal, channels, frozen,
        measures.peak(model, gain), seconds, verdict, certificate,
    )  # fmt: skip
