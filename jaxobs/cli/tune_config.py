"""The config of `jaxobs tune`, read and checked by its types: cases, what is free, what shall be proved and made small."""

import copy
import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from jaxobs import observers
from jaxobs._module import refuse
from jaxobs.cli.parts import Part, Reader
from jaxobs.cli.reading import Integers, Matrix, Vector, read, unknown
from jaxobs.cli.study_config import StudyConfig, study_config
from jaxobs.cli.subject import Bounds

WORLD = ("plant", "observer", "signal", "noise", "disturbance", "time", "start", "run")
OWN = ("free", "bounds", "certify", "objective", "check", "search", "record")
QUICK = 10  # by which `--quick` divides steps and seeds


@dataclasses.dataclass(frozen=True)
class Free:
    """The chart of one leaf. Affine: in units of scale, the sizes of its numbers if not given."""

    chart: Literal["LogQ", "Positive", "PoleSector", "Affine", "Box"]
    damping: float = 0.0
    slowest: float = 0.0
    lower: float | None = None
    upper: float | None = None
    scale: Vector | None = None


@dataclasses.dataclass(frozen=True)
class Certify:
    """What is proved. rate [1/s], the factor a step for step observers; the largest of the gain before if not given."""

    kind: Literal["quadratic", "condition5", "linear", "none"] = "none"
    rate: float | None = None
    lipschitz: float | None = None
    cover: Literal["corners", "multiplier"] | None = None


@dataclasses.dataclass(frozen=True)
class Objective:
    """What is made small. state: one (1 is the first), or weight: a number for each; all if neither is given. points, inputs:
    where the error is linearised, the origin if not given. seeds, key, after, spread: of Monte Carlo runs. fastest [1/s]: a cap
    on the fastest pole."""

    kind: Literal["steady_noise", "monte_carlo", "innovation", "recorded"]
    state: int | None = None
    weight: Vector | None = None
    points: Matrix | None = None
    inputs: Matrix | None = None
    with_bias: bool = True
    seeds: int = 32
    key: int = 0
    after: float = 0.0
    spread: Vector | None = None
    fastest: float | None = None


@dataclasses.dataclass(frozen=True)
class Check:
    """The comparison, on seeds that no search has seen. states: 1 is the first; all if not given. floor: what no filter can
    beat, "kalman" where the plant is linear, "posterior" where it is not; note: a sentence about it."""

    seeds: int = 200
    key: int = 1
    after: float = 0.0
    states: Integers | None = None
    band: float = 0.05
    floor: Literal["kalman", "posterior", "none"] = "none"
    note: str = ""


@dataclasses.dataclass(frozen=True)
class Search:
    """steps: of each stage, at most. optimizer: L-BFGS with backtracking, or Adam at a learning rate that falls. starts: "h2"
    starts from the gain of designs.synthesize at the same rate, too; nearby: further starts at a distance of `spread` in the
    coordinates of the charts. price: search once more without the proof, to say what it costs."""

    steps: int = 100
    optimizer: Literal["lbfgs", "adam"] = "lbfgs"
    learning_rate: float = 2e-2
    price: bool = True
    starts: Literal["h2", "none"] = "none"
    nearby: int = 0
    spread: float = 0.3


@dataclasses.dataclass(frozen=True)
class Record:
    """A recorded signal with a second sensor as its truth. train, check: pairs (start, stop) of samples, those of the demo if
    not given. state: the one that the second sensor sees, 1 is the first."""

    data: Literal["shank_walk"]
    state: int = 2
    train: Integers | None = None
    check: Integers | None = None


@dataclasses.dataclass(frozen=True)
class CaseConfig:
    """One case: an observer, its world (a study's, or a record), and the rest of its tables."""

    label: str
    observer: Part
    world: StudyConfig | None
    record: Record | None
    free: dict[str, Free]
    bounds: Bounds | None
    certify: Certify
    objective: Objective
    check: Check
    search: Search


def tune_config(tables: dict[str, Any], *, quick: bool = False) -> list[CaseConfig]:
    """The cases of the config. ValueError naming the key, what was given and what is expected."""
    found = []
    for label, one in _cases(tables).items():
        try:
            case = _case(label, one)
        except ValueError as error:
            if label:
                error.add_note(f"It is about the case {label!r}.")
            raise
        found.append(_quick(case) if quick else case)
    return found


def _cases(tables: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The tables of each case: [observers.LABEL] brings another observer, [cases.LABEL] anything, over the common tables."""
    for name in tables:
        if name not in (*WORLD, *OWN, "observers", "cases"):
            raise unknown(name, name, [*WORLD, "observers", "cases", *OWN])
    common = {name: one for name, one in tables.items() if name not in ("observers", "cases")}
    several = [name for name in ("observer", "observers", "cases") if name in tables]
    if several == ["observer"]:
        return {"": common}
    if "observers" in tables and len(several) > 1:
        given, fix = " and ".join(several), "Write [observer], or [observers.LABEL] for each; other changes in [cases.LABEL]."
        raise refuse("config", "observers", given, "one of them", fix)
    name = next((one for one in ("observers", "cases") if one in tables), "observer")
    labelled = tables.get(name, {})
    if not isinstance(labelled, dict) or not labelled or not all(isinstance(one, dict) for one in labelled.values()):
        fix = 'Write [observer] and name = "HighGain"; or [observers.LABEL] for each of several.'
        raise refuse("config", name, repr(labelled), "a table for each label", fix)
    over = {label: {"observer": one} if name == "observers" else one for label, one in labelled.items()}
    for label, one in over.items():
        for section in one:
            if section not in (*WORLD, *OWN):
                raise unknown(f"cases.{label}.{section}", section, [*WORLD, *OWN])
    return {label: _over(common, one) for label, one in over.items()}


def _over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Tables over tables; a table that names another class replaces the whole."""
    merged = copy.deepcopy(dict(below))
    for name, value in above.items():
        own = merged.get(name)
        whole = isinstance(own, dict) and isinstance(value, dict) and value.get("name", own.get("name")) == own.get("name")
        merged[name] = _over(own, value) if whole and isinstance(own, dict) else value
    return merged


def _case(label: str, tables: dict[str, Any]) -> CaseConfig:
    for name, example in (("observer", 'name = "HighGain"'), ("free", 'alphas = "LogQ"'), ("objective", "kind")):
        if name not in tables:
            raise refuse("config", name, "nothing", "a table", f"Write [{name}] with {example}.")
    check = read(Check, tables.get("check", {}), "check")
    objective = read(Objective, tables["objective"], "objective")
    record = read(Record, tables["record"], "record") if "record" in tables else None
    if record is not None:
        for name in WORLD:
            if name in tables and name != "observer":
                fix = "A record brings samples and times; the observer has its model in [observer.model]."
                raise refuse("config", name, "beside [record]", "one of them", fix)
        observer = Reader().part(observers.Observer, "an observer", tables["observer"], "observer")
        world = None
    else:
        world = _world(tables, check)
        observer = world.observers[""]
    _require_fitting(objective, check, record, world)
    return CaseConfig(
        label, observer, world, record, _free(tables["free"]),
        read(Bounds, tables["bounds"], "bounds") if "bounds" in tables else None,
        read(Certify, tables.get("certify", {}), "certify"), objective, check,
        read(Search, tables.get("search", {}), "search"),
    )  # fmt: skip


def _world(tables: Mapping[str, Any], check: Check) -> StudyConfig:
    """The plant, its noises, signal, times and starts: those of a study with the seeds of [check]."""
    if "noise" not in tables:
        fix = 'Without noise there is nothing to weigh speed against: [noise] name = "Gaussian", sigma = 0.1.'
        raise refuse("config", "noise", "nothing", "a table", fix)
    run = tables.get("run", {})
    if not isinstance(run, dict) or any(name != "integrator" for name in run):
        raise refuse("config", "run", repr(run), "integrator alone", "Seeds belong into [check] and [objective].")
    more = {"metrics": {"rmse": "RMSE"}, "run": run | {"seeds": check.seeds, "key": check.key}}
    found = study_config({name: tables[name] for name in WORLD if name in tables} | more)
    observer = found.observers[""]
    for name, one in (*observer.axes(), *observer.counts(), *found.plant.counts()):
        fix = "An axis of the plant's numbers is a mismatch; several observers are cases: [observers.LABEL]."
        raise refuse("config", one.where, f"several values of {name}", "one", fix)
    return found


def _require_fitting(objective: Objective, check: Check, record: Record | None, world: StudyConfig | None) -> None:
    on_record = objective.kind in ("innovation", "recorded")
    if on_record != (record is not None):
        expected = "innovation or recorded" if record is not None else "steady_noise or monte_carlo"
        fix = "Records are judged by the first two, simulated plants by the others."
        raise refuse("config", "objective.kind", repr(objective.kind), expected, fix)
    if objective.state is not None and objective.weight is not None:
        raise refuse("config", "objective.weight", "both", "state or weight", "A weight has one number for each state.")
    if objective.kind == "monte_carlo" and objective.key == check.key:
        fix = "The comparison is on seeds that the search has not seen."
        raise refuse("config", "check.key", check.key, "another one than objective.key", fix)
    for where, count in (("check.seeds", check.seeds), ("objective.seeds", objective.seeds)):
        if count < 2:
            raise refuse("config", where, count, "a whole number >= 2", "Intervals are over seeds.")
    several = world is not None and any(True for _ in world.plant.axes())
    if world is not None and world.disturbance is None and not several:
        fix = "Add [disturbance], or several values of a plant's number: a = { values = [0.9, 1.1], nominal = 1.0 }."
        expected = "a disturbance, or a plant that differs from the model"
        raise refuse("config", "disturbance", "nothing", expected, "Without either the least gain is always best. " + fix)


def _free(table: Any, where: str = "free") -> dict[str, Free]:
    """Leaves by their dotted names."""
    if not isinstance(table, dict) or not table:
        raise refuse("config", where, repr(table), "a chart for each free number", 'Write alphas = "LogQ" below it.')
    found = {}
    for name, one in table.items():
        at = f"{where}.{name}"
        if isinstance(one, dict) and "chart" not in one:
            found |= {f"{name}.{leaf}": chart for leaf, chart in _free(one, at).items()}
        else:
            found[name] = read(Free, {"chart": one} if isinstance(one, str) else one, at)
            lower, upper = found[name].lower, found[name].upper
            if (found[name].chart == "Box") != (lower is not None and upper is not None):
                fix = 'Write { chart = "Box", lower = 0.1, upper = 10.0 }.'
                raise refuse("config", f"{at}.lower", f"{lower}, {upper}", "both bounds of a Box, and for it alone", fix)
    return found


def _quick(case: CaseConfig) -> CaseConfig:
    """A tenth of the steps and seeds."""
    check = dataclasses.replace(case.check, seeds=max(2, case.check.seeds // QUICK))
    objective = dataclasses.replace(case.objective, seeds=max(2, case.objective.seeds // QUICK))
    search = dataclasses.replace(case.search, steps=max(1, case.search.steps // QUICK))
    world = case.world and dataclasses.replace(case.world, run=dataclasses.replace(case.world.run, seeds=check.seeds))
    return dataclasses.replace(case, check=check, objective=objective, search=search, world=world)


def weight_of(case: CaseConfig, n: int) -> np.ndarray:
    """(n,): of the states in the objective."""
    state, weight = case.objective.state, case.objective.weight
    if state is not None:
        if not 1 <= state <= n:
            raise refuse("config", "objective.state", state, f"a number from 1 to {n}", "x_1 is the first state.")
        return np.eye(n)[state - 1]
    if weight is not None and len(weight) != n:
        raise refuse("config", "objective.weight", f"{len(weight)} numbers", f"{n}", "One for each state.")
    return np.ones(n) if weight is None else np.array(weight)
