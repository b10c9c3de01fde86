"""Claims that anyone can re-check: numbers, witnesses, assumptions, decided in exact rational arithmetic."""

from jaxobs.certificates.base import AbstractCertificate as AbstractCertificate
from jaxobs.certificates.base import Verdict as Verdict
from jaxobs.certificates.bounds import Travelling as Travelling
from jaxobs.certificates.bounds import with_bounds as with_bounds
from jaxobs.certificates.condition5 import Condition5 as Condition5
from jaxobs.certificates.corners import Corners as Corners
from jaxobs.certificates.corners import StepCorners as StepCorners
from jaxobs.certificates.frozen_instability import FrozenInstability as FrozenInstability
from jaxobs.certificates.gain_floor import GainFloor as GainFloor
from jaxobs.certificates.h2 import H2Level as H2Level
from jaxobs.certificates.high_gain_lmi import HighGainLmi as HighGainLmi
from jaxobs.certificates.kalman_floor import KalmanFloor as KalmanFloor
from jaxobs.certificates.l2 import L2Level as L2Level
from jaxobs.certificates.mismatch import Mismatch as Mismatch
from jaxobs.certificates.no_gain import NoGain as NoGain
from jaxobs.certificates.no_high_gain_lmi import NoHighGainLmi as NoHighGainLmi
from jaxobs.certificates.regional import Regional as Regional
from jaxobs.certificates.sampled import Sampled as Sampled
from jaxobs.certificates.sampled import SampledTube as SampledTube
from jaxobs.certificates.store import load as load
from jaxobs.certificates.switching_instability import SwitchingInstability as SwitchingInstability
from jaxobs.certificates.undetectable import Undetectability as Undetectability
