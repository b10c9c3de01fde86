"""Claims that anyone can re-check: numbers, witnesses, assumptions, decided in exact rational arithmetic."""

from jaxobs.certificates.base import AbstractCertificate as AbstractCertificate
from jaxobs.certificates.base import Verdict as Verdict
from jaxobs.certificates.condition5 import Condition5 as Condition5
from jaxobs.certificates.corners import Corners as Corners
from jaxobs.certificates.corners import StepCorners as StepCorners
from jaxobs.certificates.euler_model import EulerModel as EulerModel
from jaxobs.certificates.frozen_instability import FrozenInstability as FrozenInstability
from jaxobs.certificates.high_gain_lmi import HighGainLmi as HighGainLmi
from jaxobs.certificates.linear_error import LinearError as LinearError
from jaxobs.certificates.no_common_quadratic import NoCommonQuadratic as NoCommonQuadratic
from jaxobs.certificates.no_high_gain_lmi import NoHighGainLmi as NoHighGainLmi
from jaxobs.certificates.s_lemma import SLemma as SLemma
from jaxobs.certificates.standard_high_gain import StandardHighGain as StandardHighGain
from jaxobs.certificates.store import load as load
from jaxobs.certificates.switching_instability import SwitchingInstability as SwitchingInstability
from jaxobs.certificates.triangular_gain import TriangularGain as TriangularGain
