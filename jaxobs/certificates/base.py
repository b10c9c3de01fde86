"""What a certificate is: stored numbers, and a verdict reached from them alone."""

import dataclasses
import json
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

from jaxobs.certificates import checker_more

FORMAT = "jaxobs-cert/1"
FloatMatrix = tuple[tuple[float, ...], ...]


@dataclasses.dataclass(frozen=True)
class Verdict:
    """holds: whether the claim follows from the stored numbers and assumptions, in exact arithmetic.

    margins: by how much (floats, for reading only). why: one sentence; a claim that does not hold is "not certified", which
    never means "unstable".
    """

    holds: bool
    margins: dict[str, float]
    why: str

    def __bool__(self) -> bool:
        return self.holds


@dataclasses.dataclass(frozen=True)
class AbstractCertificate:
    """A claim about stored numbers: a subclass adds the theorem's name and its fields (floats, integers, text, tuples of them).

    Claim, assumptions and verdict are those of `checker` and `checker_more`, which a stranger can run on the file without
    jaxobs: sentences of the theorem made from the numbers, since a file cannot bring its own.
    """

    theorem: ClassVar[str]

    @property
    def claim(self) -> str:
        """What is certified, with every number in full."""
        return checker_more.statement(self.theorem, self._fields())["claim"]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What is taken for granted."""
        return tuple(checker_more.statement(self.theorem, self._fields())["assumptions"])

    def verify(self) -> Verdict:
        """Decides the claim on the stored numbers only, in exact rational arithmetic; no solver, no rounding."""
        found: dict[str, Any] = checker_more.check(self.to_dict())
        return Verdict(found["holds"], found["margins"], found["why"])

    def to_dict(self) -> dict[str, Any]:
        """Plain data: floats as hex strings (exact), and the SHA-256 of everything else in canonical form."""
        body = {"format": FORMAT, "theorem": self.theorem, "claim": self.claim, "assumptions": list(self.assumptions)}
        body |= {name: _encode(value) for name, value in self._fields().items()}
        return body | {"sha256": checker_more.digest(body)}

    def to_json(self, path: str | PathLike[str]) -> None:
        Path(path).write_text(json.dumps(self.to_dict(), indent=2) + "\n", encoding="utf-8")

    def _fields(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}


def _encode(value: Any) -> Any:
    if isinstance(value, float):
        return value.hex()
    return [_encode(item) for item in value] if isinstance(value, tuple) else value


def decode(value: Any, kind: Any) -> Any:
    """The inverse of the encoding, for a field of the given type; ValueError for anything else."""
    if kind is float and isinstance(value, str):
        return float.fromhex(value)
    if kind is int and isinstance(value, int) and not isinstance(value, bool):
        return value
    if kind == tuple[float, ...] and isinstance(value, list) and all(isinstance(item, str) for item in value):
        return tuple(float.fromhex(item) for item in value)
    if kind == tuple[int, ...] and isinstance(value, list):
        return tuple(decode(item, int) for item in value)
    if kind == FloatMatrix and isinstance(value, list):
        return tuple(decode(row, tuple[float, ...]) for row in value)
    if kind is str and isinstance(value, str):
        return value
    if kind == tuple[str, ...] and isinstance(value, list) and all(isinstance(item, str) for item in value):
        return tuple(value)
    raise ValueError(f"expected {kind}, given {value!r}")
