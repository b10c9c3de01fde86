"""Certificates from files."""

import dataclasses
import json
import typing
from os import PathLike
from pathlib import Path
from typing import Any

from jaxobs.certificates.base import FORMAT, AbstractCertificate, decode
from jaxobs.certificates.checker import digest, once
from jaxobs.certificates.condition5 import Condition5
from jaxobs.certificates.corners import Corners, StepCorners
from jaxobs.certificates.frozen_instability import FrozenInstability
from jaxobs.certificates.gain_floor import GainFloor
from jaxobs.certificates.h2 import H2Level
from jaxobs.certificates.high_gain_lmi import HighGainLmi
from jaxobs.certificates.kalman_floor import KalmanFloor
from jaxobs.certificates.l2 import L2Level
from jaxobs.certificates.mismatch import Mismatch
from jaxobs.certificates.no_gain import NoGain
from jaxobs.certificates.no_high_gain_lmi import NoHighGainLmi
from jaxobs.certificates.regional import Regional
from jaxobs.certificates.sampled import Sampled, SampledTube
from jaxobs.certificates.switching_instability import SwitchingInstability
from jaxobs.certificates.undetectable import Undetectability

THEOREMS: dict[str, type[AbstractCertificate]] = {
    kind.theorem: kind
    for kind in (
        Condition5,
        Corners,
        FrozenInstability,
        GainFloor,
        H2Level,
        HighGainLmi,
        KalmanFloor,
        L2Level,
        Mismatch,
        NoGain,
        NoHighGainLmi,
        Regional,
        Sampled,
        SampledTube,
        StepCorners,
        SwitchingInstability,
        Undetectability,
    )
}


def load(path: str | PathLike[str]) -> AbstractCertificate:
    """The certificate in a file. ValueError if it is no certificate, of an unknown theorem, or damaged (hash).

    Loading proves nothing: `verify()` does.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"), object_pairs_hook=once)
    except (ValueError, RecursionError) as error:  # no UTF-8, no JSON, nested or long without measure
        raise ValueError(f"{path}: given text that is not JSON ({error}); expected a {FORMAT} file") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise ValueError(f"{path}: given no {FORMAT} file; expected one written by Certificate.to_json")
    if data.get("sha256") != digest(data):
        raise ValueError(f"{path}: given contents that do not match their SHA-256; expected an undamaged file")
    kind = THEOREMS.get(str(data.get("theorem")))
    if kind is None:
        raise ValueError(f"{path}: given theorem {data.get('theorem')!r}; expected one of {', '.join(THEOREMS)}")
    certificate = kind(**_fields(path, kind, data))
    for part, own in (("claim", certificate.claim), ("assumptions", list(certificate.assumptions))):
        if data.get(part) != own:
            raise ValueError(
                f"{path}: {part}: given text of its own; expected that of theorem {kind.theorem} for these numbers"
            )
    return certificate


def _fields(path: Any, kind: type[AbstractCertificate], data: dict[str, Any]) -> dict[str, Any]:
    hints = typing.get_type_hints(kind)
    values = {}
    for field in dataclasses.fields(kind):
        if field.name not in data:
            raise ValueError(f"{path}: given no {field.name!r}; expected it for theorem {kind.theorem}")
        try:
            values[field.name] = decode(data[field.name], hints[field.name])
        except (ValueError, OverflowError) as error:
            raise ValueError(f"{path}: {field.name}: {error}") from error
    return values
