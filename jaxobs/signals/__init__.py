"""Inputs u(t): sinusoids, held and interpolated samples, none."""

from jaxobs.signals.base import AbstractSignal as AbstractSignal
from jaxobs.signals.recorded import Held as Held
from jaxobs.signals.recorded import Recorded as Recorded
from jaxobs.signals.sine import Sine as Sine
from jaxobs.signals.zero import Zero as Zero
