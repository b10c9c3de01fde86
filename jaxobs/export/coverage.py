"""What is proved of exported code: the certificate for exactly its numbers, and the theorem that covers it, or none."""

import dataclasses
from typing import Any

import numpy as np

from jaxobs._module import refuse
from jaxobs.certificates import AbstractCertificate, Travelling
from jaxobs.designs import Infeasible
from jaxobs.designs.polytope import as_tuples
from jaxobs.export.corrections import corrects, is_behind, places, stored_table
from jaxobs.observers import AbstractStepObserver, Sampled, StepIntegral
from jaxobs.plants import Discretised

ROUNDED = 2.0**-20  # gains this near to those of a certificate are those, in another precision

Certificate = AbstractCertificate | Travelling


@dataclasses.dataclass(frozen=True)
class Coverage:
    """covered: whether a theorem speaks of the recursion that the code is. sentence: which, or why none.

    certificate: re-proved for exactly the numbers in the code; None if none was given.
    """

    covered: bool
    sentence: str
    certificate: Certificate | None


def coverage(observer: AbstractStepObserver, tables: dict[str, np.ndarray], certificate: Certificate | None) -> Coverage:
    """What `certificate` says of the code with these `tables`.

    ValueError if it is about another gain or about none, Infeasible if the rounded gain is no longer proved.
    """
    if certificate is None:
        return Coverage(False, "No theorem covers this code: it came without a certificate.", None)
    proved = reproved(certificate, observer, tables)
    covered, sentence = _theorem(observer, _inner(proved))
    return Coverage(covered, sentence, proved)


def reproved(certificate: Certificate, observer: AbstractStepObserver, tables: dict[str, np.ndarray]) -> Certificate:
    """The same claim, of the gain in `tables`: exact arithmetic decides it anew, with the matrices that were stored."""
    about = _inner(certificate)
    if not hasattr(about, "gain"):
        fix = "jaxobs.designs.corner_lmi.prove(model, gain) makes one, and so do most designs."
        raise refuse("export", "certificate", f"theorem {about.theorem}", "a theorem about one gain", fix)
    if "gain" not in tables or _hidden(observer):
        what = "a gain inside an exponential" if "gain" in tables else "a gain that is no constant"
        fix = "Export it without a certificate, or an observer with a constant gain and RK4."
        raise refuse("export", "observer", f"{type(observer).__name__} with {what}", "a gain that the code has as a table", fix)
    changes = {}
    for name in places(about):
        stored = stored_table(about, name)
        table = tables.get(name)
        if table is None and not np.size(stored):
            continue
        changes |= _placed(about, name, _exact(name, stored, table))
    made = dataclasses.replace(about, **changes)
    found: Certificate = dataclasses.replace(certificate, certificate=made) if isinstance(certificate, Travelling) else made
    verdict = found.verify()
    if not verdict:
        margin = min(verdict.margins.values(), default=float("nan"))
        reason = f"theorem {about.theorem} is not proved for the gain as the code has it: {verdict.why}"
        raise Infeasible(reason, margin, "Export float64, or design for a slightly higher rate: it leaves room for rounding.")
    return found


def _inner(certificate: Certificate) -> Any:
    return certificate.certificate if isinstance(certificate, Travelling) else certificate


def _hidden(observer: AbstractStepObserver) -> bool:
    """Whether the gain is in the matrices of an exponential integrator too."""
    return isinstance(observer, Sampled) and observer.integrator.needs_uniform_grid


def _exact(name: str, stored: np.ndarray, table: np.ndarray | None) -> np.ndarray:
    """The numbers of the table in the shape of the certificate's."""
    fix = "Take the certificate that the design returned with this observer."
    if table is None or stored.size != table.size:
        has = "none" if table is None else f"shape {table.shape}"
        raise refuse("export", "certificate", f"{name} of shape {stored.shape}", f"that of the observer, {has}", fix)
    numbers = table.astype(float).reshape(stored.shape)
    if np.any(np.abs(numbers - stored) > ROUNDED * np.max(np.abs(stored))):
        raise refuse("export", "certificate", f"{name} = {stored.tolist()}", f"{numbers.tolist()}, as the observer has it", fix)
    return numbers


def _placed(about: Any, name: str, numbers: np.ndarray) -> dict[str, Any]:
    """The fields of the certificate in which these numbers stand."""
    if name == "gain" and is_behind(about):
        a = np.array(about.a)
        a[:, 0] = -numbers
        return {"a": as_tuples(a)}
    return {name: as_tuples(numbers)}


def _theorem(observer: AbstractStepObserver, certificate: Any) -> tuple[bool, str]:
    name, none = f"theorem {certificate.theorem!r}", "No theorem covers this code: "
    sampled = isinstance(observer, Sampled)
    covered, sentence = (_sampled if sampled else _stepped)(observer, certificate, name, none)
    if not covered:
        return False, sentence
    corrected = observer.observer if sampled else observer
    expected = corrects(corrected, certificate)
    if expected is None:
        return False, f"{none}of {type(corrected).__name__} jaxobs does not know which error dynamics {name} would be about."
    if not np.array_equal(np.asarray(certificate.output, float), expected):
        given = f"the output {np.asarray(certificate.output).tolist()} in its model"
        return False, f"{none}{name} has {given}, and what this observer corrects by is {expected.tolist()}."
    return True, sentence


def _stepped(observer: Any, certificate: Any, name: str, none: str) -> tuple[bool, str]:
    if not hasattr(certificate, "factor"):
        return False, f"{none}it runs from sample to sample, and {name} is about continuous measurements."
    model = getattr(observer, "model", None)
    if isinstance(model, Discretised):
        method, period = type(model.integrator).__name__, float(model.dt)
    elif isinstance(observer, StepIntegral):
        method, period = "Euler", float(observer.dt)
    else:
        return True, f"T{name[1:]} covers this recursion, in exact arithmetic."
    return True, (
        f"T{name[1:]} covers this recursion for its model, {method} of the plant over {period:.6g} s. It says nothing of the "
        f"plant itself: jaxobs.designs.model_gap bounds how far that is."
    )


def _sampled(observer: Any, certificate: Any, name: str, none: str) -> tuple[bool, str]:
    period, method = float(observer.dt), type(observer.integrator).__name__
    euler = "" if method != "Euler" else " The Euler model has one: StepLuenberger on Discretised(plant, Euler(), dt)."
    if not hasattr(certificate, "delta"):
        fix = "jaxobs.designs.sampled_data proves periods, with Sampled(..., holds='innovation')."
        what = "steps from sample to sample" if hasattr(certificate, "factor") else "continuous measurements"
        return False, f"{none}it holds samples for {period:.6g} s, and {name} is about {what}. {fix}{euler}"
    if observer.holds != "innovation":
        fix = "Take Sampled(..., holds='innovation')."
        return False, f"{none}{name} is about a held innovation, and this code holds the measurement. {fix}{euler}"
    if period > certificate.delta * (1 + float(np.finfo(np.asarray(observer.dt).dtype).eps)):
        return False, f"{none}its period is {period:.9g} s, and {name} goes up to {certificate.delta:.9g} s.{euler}"
    return True, (
        f"T{name[1:]} covers the continuous plant with samples up to {certificate.delta:.6g} s apart and the innovation held, "
        f"for the exact flow between them; the code takes {method}, whose error no theorem here bounds."
    )
