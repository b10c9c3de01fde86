"""The config of `jaxobs study`, read and checked by its types before JAX computes anything; then the arguments of the study."""

import dataclasses
import re
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from jaxobs import integrators, metrics, noise, observers, plants, signals
from jaxobs._module import refuse
from jaxobs.cli.parts import Part, Reader
from jaxobs.cli.ranges import Counts, Several
from jaxobs.cli.reading import read, unknown

SECTIONS = ("plant", "observer", "observers", "signal", "noise", "disturbance", "time", "start", "metrics", "run")
GIVEN = ("n", "dt")  # an observer that leaves them out has those of the plant and of the grid
ARGUMENTS = {
    "ts": "time", "x0": "start.x0", "xhat0": "start.xhat0", "keys": "run.seeds", "families": "observer", "save": "run.save",
    "integrator": "run.integrator", "hold_innovation": "run.hold_innovation",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Time:
    """The grid from `start` to `end` [s], in steps of dt [s] or with so many samples."""

    end: float
    dt: float | None = None
    samples: int | None = None
    start: float = 0.0

    def grid(self) -> np.ndarray:
        span = self.end - self.start
        if not span > 0:
            raise refuse("config", "time.end", self.end, f"a time after the start, {self.start}", "Both are in seconds.")
        if (self.dt is None) == (self.samples is None):
            given = "nothing" if self.dt is None else f"{self.dt} beside time.samples"
            raise refuse("config", "time.dt", given, "a step in seconds, or time.samples, one of them", "Write dt = 0.01.")
        if self.samples is not None:
            if self.samples < 2:
                raise refuse("config", "time.samples", self.samples, "a whole number >= 2", "It counts both ends.")
            return np.linspace(self.start, self.end, self.samples)
        if self.dt is None or not 0 < self.dt <= span:
            raise refuse("config", "time.dt", self.dt, f"a step between 0 and {span} s", "It is the sampling period.")
        steps = round(span / self.dt)
        if abs(steps * self.dt - span) > 1e-6 * self.dt:
            near = f"dt = {span / steps!r} divides {span} s"
            raise refuse("config", "time.dt", self.dt, "a step that goes into the time a whole number of times", near + ".")
        return self.start + self.dt * np.arange(steps + 1)


@dataclasses.dataclass(frozen=True)
class Run:
    """seeds: how often each member runs, with the streams of `key`. save: keep every save-th sample of x and xhat."""

    seeds: int | None = None
    key: int = 0
    precision: Literal["float64", "float32"] = "float64"
    save: int | None = None
    hold_innovation: bool = False


@dataclasses.dataclass(frozen=True)
class StudyConfig:
    """What the tables say. observers: by label; that of a plain [observer] is ""."""

    plant: Part
    observers: dict[str, Part]
    signal: Part | None
    noise: Part | None
    disturbance: Part | None
    metrics: dict[str, Part]
    integrator: Part | None
    time: Time
    x0: Any
    xhat0: Any
    run: Run

    @property
    def counts(self) -> dict[str, Counts]:
        """The whole numbers that vary; the same list in the plant and in the observers is one axis. ValueError otherwise."""
        found: dict[str, dict[str, Counts]] = {}
        for label, observer in self.observers.items():
            found[label] = {}
            for name, one in (*self.plant.counts(), *observer.counts()):
                other = found[label].setdefault(name, one)
                if other.values != one.values:
                    expected = f"{other.values}, as {other.where} has"
                    raise refuse("config", one.where, one.values, expected, "Lists of one name are one axis.")
        first, *others = found.values()
        for label, each in zip(list(found)[1:], others, strict=True):
            for name in first | each:
                theirs, ours = first.get(name), each.get(name)
                if theirs is None or ours is None or theirs.values != ours.values:
                    given = "no list" if ours is None else ours.values
                    expected = "no list" if theirs is None else f"{theirs.values}"
                    fix = f"All observers have the same axes: as {next(iter(found))!r}; or make two studies."
                    raise refuse("config", f"observers.{label}.{name}", given, expected, fix)
        return first

    def study(self) -> tuple[Any, Any, dict[str, Any]]:
        """(plant, families, the other arguments) of jaxobs.study."""
        import jax

        from jaxobs.studies import Seeds, variants

        dtype, ts, counts = np.dtype(self.run.precision), self.time.grid(), self.counts
        given = {"dt": float(ts[1] - ts[0])}

        def make(**point: Any) -> tuple[Any, Any]:
            label = point.pop("observer", None)
            with_n = given | {"n": self.plant.build(point, given).n}
            every = {name: part.family(point, with_n, dtype) for name, part in self.observers.items() if label in (None, name)}
            chosen = every[""] if "" in every else every if label is None else every[label]
            return self.plant.family(point, with_n, dtype), chosen

        def whole(part: Part | None) -> Any:
            return None if part is None else part.family({}, given, dtype)

        more = {
            "ts": ts,
            "metrics": {name: whole(part) for name, part in self.metrics.items()},
            "x0": _start(self.x0),
            "xhat0": _start(self.xhat0),
            "keys": None if self.run.seeds is None else Seeds(jax.random.key(self.run.key), self.run.seeds),
            "integrator": whole(self.integrator),
            "hold_innovation": self.run.hold_innovation,
            "save": self.run.save,
        } | {name: whole(getattr(self, name)) for name in ("signal", "noise", "disturbance")}
        if not counts:
            return *make(), more
        labels = {} if "" in self.observers else {"observer": list(self.observers)}
        return None, variants(make, **labels, **{name: one.values for name, one in counts.items()}), more


def study_config(tables: dict[str, Any]) -> StudyConfig:
    """The config from its tables. ValueError naming the key, what was given and what is expected."""
    for name in tables:
        if name not in SECTIONS:
            raise unknown(name, name, list(SECTIONS))
    for name, example in (
        ("plant", 'name = "Pendulum"'),
        ("time", "end and dt"),
        ("start", "x0"),
        ("metrics", 'rmse = "RMSE"'),
    ):
        if name not in tables:
            raise refuse("config", name, "nothing", "a table", f"Write [{name}] with {example}.")
    everything = Reader(numbers=True, counts=True)
    plant = everything.part(plants.AbstractPlant, "a plant", tables["plant"], "plant")
    model = Reader(True, True, lambda where, own: _model(plant, tables["plant"], where, own), GIVEN)
    run = _table(tables.get("run", {}), "run")
    config = StudyConfig(
        plant,
        {label: model.part(observers.Observer, "an observer", one, where) for label, where, one in _observers(tables)},
        _one(signals.AbstractSignal, "a signal", tables, "signal"),
        _one(noise.AbstractNoise, "a noise", tables, "noise"),
        _one(noise.AbstractNoise, "a noise", tables, "disturbance"),
        {
            name: Reader(key="kind").part(metrics.AbstractMetric, "a metric", one, f"metrics.{name}")
            for name, one in _table(tables["metrics"], "metrics").items()
        },
        _one(integrators.AbstractIntegrator, "an integrator", run, "integrator", "run.integrator"),
        read(Time, tables["time"], "time"),
        *_starts(tables["start"]),
        read(Run, {name: value for name, value in run.items() if name != "integrator"}, "run"),
    )
    _check_seeds(config)
    return config


def named(message: str) -> str:
    """An error of jaxobs.study under the key of the config."""
    found = re.match(r"study\.(\w+): ", message)
    if found is None:
        return message
    if found[1] in ("store", "chunk", "part"):
        return f"--{found[1]}: {message[found.end() :]}"
    return f"config.{ARGUMENTS.get(found[1], found[1])}: {message[found.end() :]}"


def _table(given: Any, where: str) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise refuse("config", where, repr(given), "a table", f"Write [{where}] and its keys below.")
    return given


def _observers(tables: Mapping[str, Any]) -> list[tuple[str, str, Any]]:
    """(label, key, table) of [observer], or of each [observers.LABEL]."""
    if ("observer" in tables) == ("observers" in tables):
        given = "both" if "observer" in tables else "nothing"
        fix = 'Write [observer] and name = "HighGain", or [observers.LABEL] for each of several.'
        raise refuse("config", "observer", given, "[observer] or [observers.LABEL]", fix)
    if "observer" in tables:
        return [("", "observer", tables["observer"])]
    every = _table(tables["observers"], "observers")
    for name in [*every, *([] if every else [""])]:
        if not name:
            raise refuse("config", "observers", repr(every), "a table for each label", "Write [observers.LABEL].")
    return [(label, f"observers.{label}", one) for label, one in every.items()]


def _model(plant: Part, table: Mapping[str, Any], where: str, own: Any) -> dict[str, Any]:
    """The table of an observer's model: its own if it names a class, else that of the plant with its own keys over it."""
    own = {"name": own} if isinstance(own, str) else _table(own, where)
    if "name" in own:
        return own
    nominal: dict[str, Any] = {"name": table} if isinstance(table, str) else dict(table)
    for leaf, one in plant.axes():
        key = leaf.removeprefix("plant.") if "period" in nominal else leaf
        if one.nominal is not None and "." not in key:
            nominal[key] = one.nominal
        elif key not in own:
            fix = f"{one.where} has several: write [{where}] {key} = ..., or {one.where} = {{ values = [...], nominal = ... }}."
            fix = f"{one.where} has several: write [{where}] in full, with its name." if "." in key else fix
            raise refuse("config", f"{where}.{key}", "nothing", "the value that the model has", fix)
    return nominal | own


def _one(base: Any, what: str, tables: Mapping[str, Any], name: str, where: str = "") -> Part | None:
    """A section that may be absent; [[noise]] several times is their sum."""
    if name not in tables:
        return None
    table, reader = tables[name], Reader(numbers=not where)
    if isinstance(table, list) and base is noise.AbstractNoise:
        table = {"name": "Sum", "parts": table}
    return reader.part(base, what, table, where or name)


def _starts(table: Any) -> tuple[Any, Any]:
    """x0 and xhat0 (0 if not given)."""
    given = {"xhat0": 0.0} | _table(table, "start")
    for name in given:
        if name not in ("x0", "xhat0"):
            raise unknown(f"start.{name}", name, ["x0", "xhat0"])
    if "x0" not in given:
        raise refuse("config", "start.x0", "nothing", "a list of numbers", "It is the state at the start.")
    for name, value in given.items():
        rows = value if isinstance(value, list) and value and all(isinstance(row, list) for row in value) else [value]
        flat = [one for row in rows for one in (row if isinstance(row, list) else [row])]
        ragged = len({len(row) for row in rows if isinstance(row, list)}) > 1
        if not flat or ragged or not all(type(one) in (int, float) for one in flat):
            expected = "a list of numbers, several of them in a list, or one number for all states"
            raise refuse("config", f"start.{name}", repr(value), expected, "Write x0 = [0.5, 0.0].")
    return given["x0"], given["xhat0"]


def _start(value: Any) -> Any:
    return value if isinstance(value, list) else lambda n: np.full(n, float(value))


def _check_seeds(config: StudyConfig) -> None:
    drawn, seeds = config.noise is not None or config.disturbance is not None, config.run.seeds
    if drawn and seeds is None:
        raise refuse("config", "run.seeds", "nothing", "a whole number", "It counts the runs of each member: seeds = 100.")
    if seeds is not None and not drawn:
        fix = "Without [noise] and [disturbance] all runs of a member are the same: leave it out."
        raise refuse("config", "run.seeds", seeds, "nothing", fix)
    for name in ("seeds", "save"):
        value = getattr(config.run, name)
        if value is not None and value < 1:
            raise refuse("config", f"run.{name}", value, "a whole number >= 1", "It counts.")
    leaves = {}
    for label, observer in config.observers.items():
        leaves[label] = dict(observer.axes())
        first = next(iter(leaves.values()))
        for name in first | leaves[label]:
            theirs, ours = first.get(name), leaves[label].get(name)
            if theirs is None or ours is None or not _alike(ours, theirs):
                where = f"observers.{label}.{name}"
                given, expected = ("one value" if one is None else repr(one.values) for one in (ours, theirs))
                fix = f"All observers have the same axes, {name} = [1.0] makes one of one value; or make two studies."
                raise refuse("config", where, given, f"{expected}, as {next(iter(leaves))!r}", fix)


def _alike(ours: Several, theirs: Several) -> bool:
    """Vectors may differ: they are told apart by their numbers."""
    both = (ours.values, theirs.values)
    return len(ours.values) == len(theirs.values) and (
        ours.values == theirs.values or all(isinstance(v[0], list) for v in both)
    )
