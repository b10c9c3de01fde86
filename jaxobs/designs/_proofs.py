"""From what a search found to a certificate that holds in exact arithmetic, or nothing."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs.certificates import AbstractCertificate, Corners, H2Level, L2Level
from jaxobs.designs._descent import Point
from jaxobs.designs._dynamics import Dynamics, centred
from jaxobs.designs._injected import Injected
from jaxobs.designs._levels import Level, least
from jaxobs.designs._rates import Proof, fastest
from jaxobs.designs.covers import cover_of
from jaxobs.designs.infeasible import Infeasible
from jaxobs.designs.polytope import as_tuples

ROOM = (1e-9, 1e-7, 1e-5, 1e-3)  # by which a level is raised so that it holds in exact arithmetic, relative


def certified(point: Point, rate: float, cover: str, origin: str) -> tuple[AbstractCertificate, Point]:
    """The certificate of the rate and the level of a point, and the point as it was proved. Infeasible if P or Q pass no
    check."""
    d, level = point.proof.d, point.level
    for proof in _proofs(point.proof, rate, cover):
        if not (corners := _corners(proof, rate, cover, origin)).verify():
            continue
        if level is None:
            return corners, Point(proof, None)
        for found in _levels(d, level, cover):
            for room in ROOM:
                if (certificate := _certificate(proof, rate, found, room, cover, origin)).verify():
                    return certificate, Point(proof, dataclasses.replace(found, value=certificate.level))
    change = f"Ask for a rate below {rate:.6g} 1/s, so that the inequalities hold with a margin."
    raise Infeasible("what was found does not pass the exact check", -0.0, change, best=None)


def _proofs(proof: Proof, rate: float, cover: str):
    """The P at hand, then those found anew for the same gains."""
    yield proof
    model = proof.d.model
    yield fastest(proof.d, cover_of("synthesize", model, cover), p=proof.p, target=rate * (1 + 1e-6) + 1e-9 * proof.d.speed)
    yield fastest(proof.d, cover_of("synthesize", model, cover), p=proof.p)


def _levels(d: Dynamics, level: Level, cover: str):
    yield level
    for margin in (1e-6, 1e-5):
        found = least(d, level.form, cover_of("synthesize", d.model, cover), (level.q, level.value), margin=margin, rounds=2)
        if found is not None:
            yield found


def _box(proof: Proof, rate: float, cover: str, origin: str) -> dict[str, Any]:
    d, (p, size) = proof.d, unit_size(proof.p)
    fields = Injected(d.model, d.gain, d.inner).fields() | {"p": as_tuples(p), "rate": float(rate), "origin": origin}
    if cover == "multiplier":
        fields["taus"] = as_tuples(np.diagonal(proof.tau) / size)
    return fields


def _corners(proof: Proof, rate: float, cover: str, origin: str) -> Corners:
    return Corners(**_box(proof, rate, cover, origin))


def _certificate(proof: Proof, rate: float, level: Level, room: float, cover: str, origin: str) -> H2Level | L2Level:
    d, fields = proof.d, _box(proof, rate, cover, origin)
    fields |= {name: as_tuples(getattr(d, name)) for name in ("weight", "process", "noise")}
    q = (1 + room) * level.q
    if level.form == "covariance":
        t = centred(level.q)
        x = (1 + room) * (t @ t.T)
        bound = np.sum((d.weight @ x) * d.weight)
        return H2Level(**fields, x=as_tuples((x + x.T) / 2), level=above(bound))
    if cover == "multiplier":
        fields["taus_q"] = as_tuples(np.diagonal(level.tau) * (1 + room))
    if level.form == "energy":
        side = np.concatenate([d.process, d.gain @ d.noise], 1)
        return H2Level(**fields, q=as_tuples((q + q.T) / 2), level=above(np.sum((q @ side) * side)))
    return L2Level(**fields, q=as_tuples((q + q.T) / 2), level=above(level.value * (1 + room)))


def above(x: float) -> float:
    """A little more, for what rounding may have taken."""
    return float(x) * (1 + 1e-12)


def unit_size(p: np.ndarray) -> tuple[np.ndarray, float]:
    """P of size one, divided by a power of two, and that power."""
    size = 2.0 ** np.round(np.log2(np.max(np.abs(p))))
    return (p + p.T) / 2 / size, float(size)
