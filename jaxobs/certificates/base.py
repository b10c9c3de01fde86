"""What a certificate is: stored numbers, and a verdict reached from them alone."""

import abc
import dataclasses
import hashlib
import json
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

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
class AbstractCertificate(abc.ABC):
    """A claim about stored numbers. Subclasses add the numbers (floats, or tuples of them), claim, assumptions and verify.

    Claim and assumptions are sentences of the theorem, made from the numbers: a file cannot bring its own.
    """

    theorem: ClassVar[str]

    @property
    @abc.abstractmethod
    def claim(self) -> str:
        """What is certified, with every number in full."""

    @property
    @abc.abstractmethod
    def assumptions(self) -> tuple[str, ...]:
        """What is taken for granted."""

    @abc.abstractmethod
    def verify(self) -> Verdict:
        """Decides the claim on the stored numbers only, in exact rational arithmetic; no solver, no rounding."""

    def to_dict(self) -> dict[str, Any]:
        """Plain data: floats as hex strings (exact), and the SHA-256 of everything else in canonical form."""
        body = {"format": FORMAT, "theorem": self.theorem, "claim": self.claim, "assumptions": list(self.assumptions)}
        body |= {field.name: _encode(getattr(self, field.name)) for field in dataclasses.fields(self)}
        return body | {"sha256": digest(body)}

    def to_json(self, path: str | PathLike[str]) -> None:
        Path(path).write_text(json.dumps(self.to_dict(), indent=2) + "\n", encoding="utf-8")


def digest(body: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


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
