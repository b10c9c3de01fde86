"""The smallest |L| that is certified for the chain, beside a floor that every gain exceeds whose frozen errors decay."""

import dataclasses
import time
from collections.abc import Iterator

import numpy as np

from jaxobs.bench.chain_table import STRENGTHS, Report, chain
from jaxobs.certificates import AbstractCertificate
from jaxobs.designs import Gain, synthesize
from jaxobs.designs.gain_floor import gain_floor
from jaxobs.papers.p002.paper import N

STEPS = 200  # of the descent, which stops earlier when it has come to rest


@dataclasses.dataclass(frozen=True)
class LeastGain:
    """|L| of a certified gain, and `floor`: no gain with |L| <= floor makes the error decay at all constant rho (proved)."""

    k_f: int
    gain: tuple[float, ...]
    norm: float
    floor: float
    seconds: float
    verdict: str
    certificates: tuple[AbstractCertificate, ...] = dataclasses.field(repr=False)


def least_gain(k_f: int) -> LeastGain:
    """min |L| over the gains with one P for the whole box, as far as the search comes."""
    problem = chain(N, k_f)
    begin = time.perf_counter()
    found = synthesize(problem.model, objective=Gain(), cover="lazy", steps=STEPS, origin=problem.origin)
    seconds = time.perf_counter() - begin
    floor, below = gain_floor(problem.model)
    proofs = (found.certificate, below)
    verdict = "verified" if all(proof.verify() for proof in proofs) else "not certified"
    entries = tuple(float(x) for x in np.ravel(found.gain))
    return LeastGain(k_f, entries, float(np.linalg.norm(found.gain)), float(floor), seconds, verdict, proofs)


def least_gains(strengths=STRENGTHS, *, progress: Report = lambda what: None) -> Iterator[LeastGain]:
    """A row for each k_f."""
    for k_f in strengths:
        progress(f"least gain, k_f = {k_f}")
        yield least_gain(k_f)
