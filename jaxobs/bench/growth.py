"""Time of a design and of its exact check as the state grows, for each way of covering the box."""

import dataclasses
import time
from collections.abc import Iterator
from typing import Literal

from jaxobs.bench.chain_table import Report, chain
from jaxobs.designs import Infeasible, synthesize

Cover = Literal["multiplier", "lazy", "corners"]
COVERS: tuple[Cover, ...] = ("multiplier", "lazy", "corners")
SIZES = range(2, 13)
STRENGTH, RATE = 1.0, 0.5  # k_f, 1/s
STEPS = 12  # of a descent
BUDGET = 60.0  # s for a design, beyond which a cover counts as not practical


@dataclasses.dataclass(frozen=True)
class Growth:
    """design and check in seconds; level = sqrt of the guaranteed E |e|^2, None where nothing was found."""

    n: int
    cover: Cover
    corners: int
    design: float
    check: float | None
    level: float | None
    verdict: str


def growth(cover: Cover, sizes=SIZES, *, budget: float = BUDGET, progress: Report = lambda what: None) -> Iterator[Growth]:
    """The chain with k_f = STRENGTH at RATE for n after n, up to the first design that takes longer than the budget [s]."""
    for n in sizes:
        progress(f"growth, {cover}: n = {n}")
        problem = chain(n, STRENGTH)
        begin = time.perf_counter()
        try:
            found = synthesize(
                problem.model, objective=problem.objective, rate=RATE, cover=cover, steps=STEPS, origin=problem.origin
            )
        except Infeasible:
            found = None
        design = time.perf_counter() - begin
        if found is None:
            yield Growth(n, cover, 2**n, design, None, None, "not certified")
        else:
            begin = time.perf_counter()
            verdict = "verified" if found.certificate.verify() else "not certified"
            yield Growth(n, cover, 2**n, design, time.perf_counter() - begin, float(found.norm), verdict)
        if design > budget:
            return


def last_practical(rows, cover: Cover, budget: float = BUDGET) -> int | None:
    """The largest n with a verified design within the budget, None if there is none."""
    return max(
        (one.n for one in rows if one.cover == cover and one.verdict == "verified" and one.design <= budget), default=None
    )
