"""Noise against proved rate for the chain of n states, from both sides: certified designs above, a proved floor below.

The floor is the worst Kalman filter: at constant parameters rho no causal linear unbiased estimate has a smaller E |e|^2, and
the observers here know neither rho nor whether it is constant. What lies between is the price of one gain, of the rate and of
the proof together; `frozen` tells them apart: the least noise that was found for a constant gain whose error decays at the rate
at the worst constant rho alone (found, not proved).
"""

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from jaxobs.bench.chain_table import Report, chain
from jaxobs.bench.frozen import frozen_optimum
from jaxobs.bench.rows import design
from jaxobs.certificates import AbstractCertificate
from jaxobs.designs import Infeasible, kalman_floor

SIZES, STRENGTHS = (2, 3, 4, 5), (1, 10)
RATES = np.geomspace(0.1, 30.0, 11)  # 1/s
Rates = Sequence[float] | np.ndarray


@dataclasses.dataclass(frozen=True)
class Point:
    """A certified gain: rate [1/s], level = sqrt of the bound on E |e|^2, and the same found at a constant rho."""

    rate: float
    level: float
    frozen: float
    gain: tuple[float, ...]
    seconds: float
    verdict: str
    certificate: AbstractCertificate = dataclasses.field(repr=False)


@dataclasses.dataclass(frozen=True)
class Curve:
    """points by increasing rate; floor = sqrt of the proved floor on E |e|^2, `below` its certificate, at the constant rho."""

    n: int
    k_f: float | int
    points: tuple[Point, ...]
    floor: float
    rho: tuple[float, ...]
    verdict: str
    below: AbstractCertificate = dataclasses.field(repr=False)


def curve(n: int, k_f: float | int, rates: Rates = RATES, *, progress: Report = lambda what: None) -> Curve:
    """A design for each rate; where one for a faster rate is quieter, it stands here too, since it proves the slower rate."""
    problem = chain(n, k_f)
    below = kalman_floor(problem.model, *problem.factors)
    rho, points, best = np.array(below.rho), [], None
    for rate in sorted(map(float, rates), reverse=True):
        progress(f"frontier, n = {n}, k_f = {k_f:g}: {rate:.3g} /s")
        try:
            found = design(problem, rate)
        except Infeasible:
            continue
        best = found if best is None or found.level < best.level else best
        frozen = float(np.sqrt(frozen_optimum(problem.model, rho, rate, *problem.factors)))
        entries, proof = tuple(map(float, np.ravel(best.gain))), best.certificate
        points.append(Point(rate, best.level, frozen, entries, found.seconds, _verdict(proof), proof))
    return Curve(n, k_f, tuple(points[::-1]), float(np.sqrt(below.level)), tuple(map(float, rho)), _verdict(below), below)


def frontier(
    sizes=SIZES, strengths=STRENGTHS, rates: Rates = RATES, *, progress: Report = lambda what: None
) -> Iterator[Curve]:
    """A curve for each k_f and n."""
    for k_f in strengths:
        for n in sizes:
            yield curve(n, k_f, rates, progress=progress)


def _verdict(certificate: AbstractCertificate) -> str:
    return "verified" if certificate.verify() else "not certified"
