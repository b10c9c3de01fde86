"""What a paper says and what comes out when it is computed: claims, evidence, verdicts."""

import dataclasses
import math
import time
from collections.abc import Callable
from decimal import Decimal, InvalidOperation
from typing import Any, Literal

OURS = "not in the print"  # what stands for the print in rows that the paper leaves to its readers
Verdict = Literal["reproduced", "conservative", "slip", "scan?", "false as stated", "open"]
Kind = Literal["value", "bound", "feasible", "identity", "universal", "figure"]


@dataclasses.dataclass(frozen=True)
class Value:
    """A printed number, computed again. Agreement to half the last printed digit is `reproduced`, else `slip`."""

    ours: float
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Bound:
    """A printed bound and the sharp value it bounds, from above or from below.

    Equal to half the last printed digit is `reproduced`, valid but not tight `conservative`, not valid `false as stated`.
    """

    ours: float
    side: Literal["upper", "lower"] = "upper"
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Point:
    """A printed point (a gain, a matrix, a step) that is said to satisfy a condition: whether it `holds`, and the best value.

    `ours` is what the optimum is (None: nothing was said to be optimal). A point that holds is `reproduced` if the printed
    value is the best one, else `conservative`; one that fails is `false as stated`, and `why` says by how much.
    """

    holds: bool
    ours: float | None = None
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Statement:
    """An identity, a property, a figure. holds: True when proved or, for a figure or an identity, recomputed; False only with
    a counterexample or an exact proof that was just run again; None when neither is at hand (`open`).

    ours: the number that shows it (a residual, a margin, the counterexample's value), or a few words.
    """

    holds: bool | None
    ours: float | str = ""
    why: str = ""


Evidence = Value | Bound | Point | Statement
EVIDENCE: dict[str, type] = {
    "value": Value, "bound": Bound, "feasible": Point,
    "identity": Statement, "universal": Statement, "figure": Statement,
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Row:
    """One line of the audit of a paper, in the order of the JSON output."""

    paper: str
    claim: str
    kind: Kind
    printed: str
    ours: float | str | None
    verdict: Verdict
    why: str
    seconds: float


@dataclasses.dataclass(frozen=True)
class Claim:
    """What is printed, and the function that computes it again. scan: a mismatch is likelier lost in the scan of the paper
    than the author's. long: left out of the short form."""

    paper: str
    name: str
    kind: Kind
    printed: str
    compute: Callable[[], Evidence]
    scan: bool = False
    long: bool = False

    def check(self) -> Row:
        begin = time.perf_counter()
        evidence = self.compute()
        if not isinstance(evidence, EVIDENCE[self.kind]):
            raise TypeError(f"{self.paper} {self.name}: given {type(evidence).__name__} for a claim of kind {self.kind}")
        seconds = round(time.perf_counter() - begin, 3)
        found = _verdict(self, evidence)
        if self.scan and found in ("slip", "false as stated"):
            found = "scan?"
        ours = evidence.ours if not isinstance(evidence.ours, float) else float(evidence.ours)
        return Row(self.paper, self.name, self.kind, self.printed, ours, found, evidence.why, seconds)


class Paper:
    """The claims of one paper, in its order. `claim` registers the function below it:

    @paper.claim("(71) lambda_min", "value", printed="3.5620")
    def _():
        return Value(...)
    """

    def __init__(self, number: str, title: str):
        self.number, self.title = number, title
        self.claims: list[Claim] = []

    def claim(self, name: str, kind: Kind, printed: str, *, scan: bool = False, long: bool = False) -> Callable[[Any], Any]:
        def register(compute: Callable[[], Evidence]) -> Callable[[], Evidence]:
            if any(claim.name == name for claim in self.claims):
                raise ValueError(f"paper {self.number}: given the claim {name!r} twice; expected different names")
            self.claims.append(Claim(self.number, name, kind, printed, compute, scan, long))
            return compute

        return register


def half_digit(printed: str) -> tuple[float, float]:
    """The number printed and half a unit of its last digit: '0.0915' -> (0.0915, 0.00005), '1.3e6' -> (1.3e6, 5e4)."""
    try:
        number = Decimal(printed)
    except InvalidOperation as error:
        raise ValueError(f"printed: given {printed!r}; expected a plain number for claims of kind value and bound") from error
    exponent = number.as_tuple().exponent
    if not isinstance(exponent, int):
        raise ValueError(f"printed: given {printed!r}; expected a finite number")
    return float(number), float(Decimal(5).scaleb(exponent - 1))


def _agrees(printed: str, ours: float) -> bool:
    number, half = half_digit(printed)
    return abs(ours - number) <= half * (1 + 1e-9)


def _verdict(claim: Claim, evidence: Evidence) -> Verdict:
    match evidence:
        case Value(ours):
            return "open" if math.isnan(ours) else "reproduced" if _agrees(claim.printed, ours) else "slip"
        case Bound(ours, side):
            number, _ = half_digit(claim.printed)
            valid = number >= ours if side == "upper" else number <= ours
            return "reproduced" if _agrees(claim.printed, ours) else "conservative" if valid else "false as stated"
        case Point(False):
            return "false as stated"
        case Point(True, ours):
            return "reproduced" if ours is None or _agrees(claim.printed, ours) else "conservative"
        case _:
            return "open" if evidence.holds is None else "reproduced" if evidence.holds else "false as stated"
