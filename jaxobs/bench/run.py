"""All of it in one go, as one object."""

import dataclasses
import time
from collections.abc import Iterator

import numpy as np

from jaxobs.bench import chain_table, frontier
from jaxobs.bench.chain_table import Report, chain_pairs
from jaxobs.bench.dmvt_table import DmvtRow, dmvt_rows
from jaxobs.bench.frontier import Curve
from jaxobs.bench.growth import COVERS, Growth, growth
from jaxobs.bench.least_gain import LeastGain, least_gains
from jaxobs.bench.rows import Pair
from jaxobs.certificates import AbstractCertificate

GROWTH_BUDGET = 20.0  # s for a design here; benchmarks/synthesis_growth.py has more


@dataclasses.dataclass(frozen=True)
class SynthesisBench:
    """pairs: paper 002's chain; least: the least certified |L|; dmvt: paper 004's examples; curves: the frontier;
    growth: time against n. seconds: of each part."""

    pairs: tuple[Pair, ...]
    least: tuple[LeastGain, ...]
    dmvt: tuple[DmvtRow, ...]
    curves: tuple[Curve, ...]
    growth: tuple[Growth, ...]
    seconds: dict[str, float]
    budget: float = GROWTH_BUDGET

    def certificates(self) -> Iterator[tuple[str, AbstractCertificate]]:
        """A file name without ending, and the certificate."""
        for pair in self.pairs:
            for one in filter(None, (pair.theirs, pair.ours)):
                if one.certificate is not None:
                    yield _slug(f"chain {one.problem} {one.method}"), one.certificate
        for one in self.least:
            for kind, proof in zip(("gain", "floor"), one.certificates, strict=True):
                yield _slug(f"least {kind} k_f {one.k_f}"), proof
        for one in self.dmvt:
            for proof in one.certificates:
                yield _slug(f"{one.example} {one.bound.partition(',')[0]} {one.method} {proof.theorem}"), proof
        for curve in self.curves:
            name = f"frontier n {curve.n} k_f {curve.k_f:g}"
            yield _slug(f"{name} floor"), curve.below
            for point in curve.points:
                yield _slug(f"{name} rate {point.rate:.4g}"), point.certificate


def run(*, short: bool = False, progress: Report = lambda what: None) -> SynthesisBench:
    """short: one gain of the paper, n = 2 (of the growth also 3), two rates, one example: to see that it runs."""
    seconds: dict[str, float] = {}

    def timed(what, job):
        begin = time.perf_counter()
        found = tuple(job)
        seconds[what] = round(time.perf_counter() - begin, 1)
        return found

    strengths = (1,) if short else chain_table.STRENGTHS
    parts = {"printed": (3,), "honest": ()} if short else {}
    pairs = timed("chain", (p for k_f in strengths for p in chain_pairs(k_f, **parts, progress=progress)))
    least = timed("least gain", least_gains(strengths, progress=progress))
    dmvt = timed("examples of paper 004", dmvt_rows(short=short, progress=progress))
    cut = {"sizes": (2,), "strengths": (1,), "rates": np.array([0.3, 3.0])} if short else {}
    curves = timed("frontier", frontier.frontier(**cut, progress=progress))
    sizes = range(2, 4) if short else range(2, 13)
    grown = timed("growth", (one for cover in COVERS for one in growth(cover, sizes, budget=GROWTH_BUDGET, progress=progress)))
    return SynthesisBench(pairs, least, dmvt, curves, grown, seconds)


def _slug(text: str) -> str:
    kept = "".join(c if c.isalnum() or c in ".-" else "_" for c in text)
    return "_".join(filter(None, kept.split("_")))
