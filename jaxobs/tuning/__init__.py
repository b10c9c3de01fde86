"""Gains found by gradient, and what an order is worth against noise."""

from jaxobs.tuning.descent import Descent as Descent
from jaxobs.tuning.descent import descend as descend
from jaxobs.tuning.noise_law import MEASURES as MEASURES
from jaxobs.tuning.noise_law import Measure as Measure
from jaxobs.tuning.noise_law import Quietest as Quietest
from jaxobs.tuning.noise_law import noise_constant as noise_constant
from jaxobs.tuning.noise_law import quietest as quietest
from jaxobs.tuning.noise_law import settling_time as settling_time
from jaxobs.tuning.noise_law import speed as speed
from jaxobs.tuning.noise_law import squared_error as squared_error
