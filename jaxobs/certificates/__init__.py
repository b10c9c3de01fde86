"""Claims that anyone can re-check: numbers, witnesses, assumptions, decided in exact rational arithmetic."""

from jaxobs.certificates.base import AbstractCertificate as AbstractCertificate
from jaxobs.certificates.base import Verdict as Verdict
from jaxobs.certificates.condition5 import Condition5 as Condition5
from jaxobs.certificates.store import load as load
