"""What a decay rate costs: the best certified gains over a grid of required rates, and of trade-offs between two losses."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np
import optax

from jaxobs._module import check, refuse, require_integer
from jaxobs.certificates import AbstractCertificate
from jaxobs.designs import Infeasible
from jaxobs.observers import Observer
from jaxobs.tuning._checks import require_arguments, require_dependence, require_finite_loss
from jaxobs.tuning._feasible import Candidate, PhaseOne
from jaxobs.tuning._stages import WEIGHTS, End, Progress, Stages, means, proved
from jaxobs.tuning.certifiers.base import AbstractCertifier


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """An observer with the certificate of its rate; values: its losses by name; weight: of all losses but the first;
    is_dominated: whether another point is at least as good in its rate and in every loss, and better in one."""

    rate: float
    values: dict[str, float]
    weight: float
    observer: Observer
    theta: Any
    certificate: AbstractCertificate
    is_dominated: bool


@dataclasses.dataclass(frozen=True, eq=False)
class Front:
    """points by rate; missing: (rate, the rate that was reached instead) where none was proved; unit of the rates."""

    points: tuple[Point, ...]
    missing: tuple[tuple[float, float], ...]
    unit: str
    seconds: float

    def __str__(self) -> str:
        names = list(self.points[0].values)
        rows = [("rate " + self.unit, *names, "")]
        rows += [(f"{one.rate:.4g}", *(f"{one.values[name]:.5g}" for name in names), "dominated" * one.is_dominated)
                 for one in self.points]  # fmt: skip
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(text.rjust(w) for text, w in zip(row, widths, strict=True)).rstrip() for row in rows]
        return "\n".join(lines + [f"{rate:.4g}: not proved, {reached:.4g} was reached" for rate, reached in self.missing])


def pareto(
    make: Callable[[Any], Any],
    losses: Mapping[str, Callable[[Any, Any], Any]],
    theta0: Any,
    *,
    certify: AbstractCertifier,
    rates: Sequence[float],
    weights: Sequence[float] = (0.0,),
    keys: Any = None,
    optimizer: optax.GradientTransformation | None = None,
    steps: int = 100,
    progress: Callable[[Progress], None] | None = None,
) -> Front:
    """For every rate and weight   min over theta of f_1 / f_1(theta0) + weight * f_2 / f_2(theta0) + ...,   rate proved.

        front = pareto(make, {"noise": SteadyNoise(...), "peak": Peak(...)}, theta0, certify=..., rates=[...], weights=[0, 1])

    All of them side by side in one compiled search, each proved at its own rate, in exact arithmetic. losses: by name; the
    first counts with weight 1, all others with `weight`. Everything else as in `tune`. A rate that cannot be proved is listed
    in `missing` with what was reached. Infeasible if none can; ValueError for bad arguments.
    """
    if not losses:
        raise refuse("pareto", "losses", "nothing", "a loss by name", 'E.g. {"noise": SteadyNoise(...)}.')
    for name, given, least in (("rates", rates, None), ("weights", weights, 0.0)):
        if not len(given) or not np.all(np.isfinite(given)) or (least is not None and min(given) < least):
            raise refuse("pareto", name, list(given), "numbers, at least one" + ("" if least is None else ", >= 0"), "A grid.")
    require_integer("pareto", "steps", steps, 1, "It counts the steps of a stage.")
    theta = [require_arguments(theta0, (), certify, float(rate))[0][0] for rate in rates][-1]  # every rate is looked at
    make = eqx.filter_jit(make)
    mean = means(make, list(losses.values()), keys)
    check(make(theta))
    require_finite_loss(mean, theta, 0)
    require_dependence(lambda theta: mean(theta)[0].sum(), theta)
    first = np.maximum(np.abs(np.asarray(mean(theta)[0])), 1e-300)
    grid = [(float(rate), float(weight)) for rate in rates for weight in weights]
    asked = [
        Candidate(i, theta, rate, mix=tuple(np.array([1.0, *[weight] * (len(losses) - 1)]) / first))
        for i, (rate, weight) in enumerate(grid)
    ]
    ready, dropped = PhaseOne(make, certify).ready(asked)
    run = Stages(mean, make, certify, optimizer, steps, progress)
    ends = run.descend(ready, WEIGHTS) + [End(run.loss(one), one) for one in ready]
    missing = [(asked[start].rate, reached) for start, reached in dropped]
    found: list[tuple[Candidate, Any]] = []
    for start in [one.start for one in ready]:
        try:
            end, certificate = proved([end for end in ends if end.candidate.start == start], make, certify)
        except Infeasible as error:
            missing.append((asked[start].rate, float("nan") if error.best is None else error.best))
            continue
        found.append((end.candidate, certificate))
    sign = -1.0 if certify.unit == "a step" else 1.0
    table = [np.array([-sign * one.rate, *np.asarray(mean(one.theta)[0])]) for one, _ in found]
    points = [
        Point(
            one.rate, dict(zip(losses, map(float, row[1:]), strict=True)), grid[one.start][1],
            make(one.theta), one.theta, certificate, any(np.all(other <= row) and np.any(other < row) for other in table),
        )
        for (one, certificate), row in zip(found, table, strict=True)
    ]  # fmt: skip
    return Front(tuple(sorted(points, key=lambda one: one.rate)), tuple(missing), certify.unit, run.seconds)
