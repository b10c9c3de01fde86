"""A tuning problem with its check: before and after at the same proved rate, judged on seeds that no search has seen."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from jaxobs.certificates import AbstractCertificate
from jaxobs.designs import Infeasible
from jaxobs.observers import Observer
from jaxobs.tuning._tune import tune
from jaxobs.tuning.certifiers import AbstractCertifier
from jaxobs.tuning.tuned import Tuned

SHORT = 1e-3  # by which the rate that is asked for stays below the largest one of the gain before, so that its proof is strict


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """make, loss, theta0, starts, keys, certify: those of `tune`. theta0 is the gain before.

    rate: to be proved of both; if None the largest one that is found for the gain before, less a thousandth. check: {label:
    observer} -> their comparison, on fresh seeds or on data that was not used (see `compare`); it prints as a table.
    """

    name: str
    make: Callable[[Any], Observer]
    theta0: Any
    loss: Callable[[Any, Any], Any]
    certify: AbstractCertifier | None
    check: Callable[[Mapping[str, Observer]], Any]
    rate: float | None = None
    keys: Any = None
    starts: Sequence[Any] = ()
    options: Mapping[str, Any] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, eq=False)
class Outcome:
    """observers: "before" and "after"; before: the certificate of the gain before, at the same rate (None without one);
    comparison: what `check` found."""

    observers: dict[str, Observer]
    tuned: Tuned
    before: AbstractCertificate | None
    comparison: Any


def run(case: Case, *, progress: Callable[[Any], None] | None = None) -> Outcome:
    """Tunes, proves both gains at one rate, and compares them. Infeasible as in `tune`.

    The gain before may prove less than a rate that was asked for: then `before` is None, and the comparison is not at equal
    rates.
    """
    before, rate = None, case.rate
    if case.certify is not None:
        observer = case.make(case.theta0)
        start = case.certify.start(observer, 0.0 if rate is None else rate)
        rate = _short(start.rate, case.certify.unit) if rate is None else rate
        try:
            before = case.certify.prove(observer, start.fixed, start.free, rate)
        except Infeasible:
            if case.rate is None:
                raise
    tuned = tune(
        case.make, case.loss, case.theta0, certify=case.certify, rate=rate, keys=case.keys, starts=case.starts,
        progress=progress, **case.options,
    )  # fmt: skip
    observers = {"before": case.make(case.theta0), "after": tuned.observer}
    return Outcome(observers, tuned, before, case.check(observers))


def _short(rate: float, unit: str) -> float:
    """A little less than the largest rate, a little more than the least factor."""
    short = min(1.0, rate + SHORT * (1 - rate)) if unit == "a step" else rate * (1 - SHORT)
    if not (0 < short <= 1 if unit == "a step" else 0 <= short < float("inf")):
        reason = f"the gain before proves no decay: {rate:.6g} {unit} at best"
        raise Infeasible(reason, -abs(rate), "Give a rate, or start from another gain.", best=None)
    return short
