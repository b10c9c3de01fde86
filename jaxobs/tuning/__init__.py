"""Gains found by gradient."""

from jaxobs.tuning.descent import Descent as Descent
from jaxobs.tuning.descent import descend as descend
