"""The config of `jaxobs export`."""

import dataclasses
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import Travelling, load
from jaxobs.cli.parts import Reader
from jaxobs.cli.reading import Vector, read, unknown
from jaxobs.cli.records import read_record
from jaxobs.cli.subject import Bounds, Subject
from jaxobs.datasets import shank_walk
from jaxobs.export import prove
from jaxobs.observers import AbstractStepObserver

TABLES = ("observer", "bounds", "proof", "record", "export")


@dataclasses.dataclass(frozen=True)
class Proof:
    """rate [1/s] of a sampled flow observer, or the factor a step; the best, or mere decay, if not given."""

    rate: float | None = None


@dataclasses.dataclass(frozen=True)
class Record:
    """The measurements of the test vectors: "shank_walk", or a CSV file and its column."""

    data: str
    column: str | None = None


@dataclasses.dataclass(frozen=True)
class Settings:
    """name: a C identifier, the prefix of all that the files define. samples: of the test vectors. xhat0: where they start."""

    name: str = "observer"
    precision: Literal["float32", "float64"] = "float64"
    samples: int = 1000
    xhat0: Vector | None = None


@dataclasses.dataclass(frozen=True)
class ExportCase:
    """What is exported, how it is proved, and with what it is compared."""

    observer: Any
    subject: Subject
    proof: Proof | None
    given: Path | None
    record: Record | None
    settings: Settings

    def certificate(self) -> Any:
        """That of a file, or of [proof]; None if neither is there. Infeasible if it is not proved."""
        if self.given is not None:
            found, data = load(self.given), json.loads(self.given.read_text(encoding="utf-8"))
            return Travelling(found, data["bounds"]) if "bounds" in data else found
        if self.proof is None:
            return None
        model = None if self.subject.bounds is None else self.subject.polytope()
        return prove(self.observer, model, rate=self.proof.rate, origin=self.subject.origin)

    def options(self, precision: str | None) -> dict[str, Any]:
        """The rest of what `jaxobs.export.export` takes."""
        made: dict[str, Any] = {"name": self.settings.name, "precision": precision or self.settings.precision}
        made |= {"samples": self.settings.samples, "xhat0": self.settings.xhat0}
        if self.record is not None:
            made["ys"] = self._measured(self.record)
            made["us"] = np.zeros((len(made["ys"]), self.observer.m))
        return made

    def _measured(self, record: Record) -> np.ndarray:
        if self.observer.p != 1:
            fix = "Leave [record] out: random numbers take its place."
            raise refuse("config", "record", f"one signal for {self.observer.p} outputs", "an observer with one output", fix)
        if record.data == "shank_walk":
            return shank_walk().angle[:, None]
        return read_record(Path(record.data), None, record.column)[0].to_numpy()[:, None]


def export_config(tables: dict[str, Any], certificate: Path | None) -> ExportCase:
    """The case of a config. ValueError naming the key, what was given and what is expected."""
    for name in tables:
        if name not in TABLES:
            raise unknown(name, name, list(TABLES))
    if "observer" not in tables:
        raise refuse("config", "observer", "nothing", "a table", 'Write [observer] with name = "Sampled" and its parts.')
    if certificate is not None and "proof" in tables:
        raise refuse("config", "proof", "a table beside --certificate", "one of the two", "Leave one out.")
    observer = Reader().part(AbstractStepObserver, "a step observer", tables["observer"], "observer").build({}, {})
    bounds = read(Bounds, tables["bounds"], "bounds") if "bounds" in tables else None
    inside = getattr(observer, "observer", observer)
    return ExportCase(
        observer,
        Subject(getattr(inside, "model", None), bounds),
        read(Proof, tables["proof"], "proof") if "proof" in tables else None,
        certificate,
        read(Record, tables["record"], "record") if "record" in tables else None,
        read(Settings, tables.get("export", {}), "export"),
    )
