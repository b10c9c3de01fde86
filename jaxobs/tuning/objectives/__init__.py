"""What a tuner can minimise: loss(observer, key), differentiable with respect to every number in the observer.

Where nothing is random the key is not used, loss(observer) will do, and every number is to first order around operating points;
MonteCarlo simulates; Innovation and Recorded judge a record.
"""

from jaxobs.tuning.objectives.gain import Bandwidth as Bandwidth
from jaxobs.tuning.objectives.gain import L1Gain as L1Gain
from jaxobs.tuning.objectives.gain import NoiseBandwidth as NoiseBandwidth
from jaxobs.tuning.objectives.monte_carlo import MonteCarlo as MonteCarlo
from jaxobs.tuning.objectives.recorded import Innovation as Innovation
from jaxobs.tuning.objectives.recorded import Recorded as Recorded
from jaxobs.tuning.objectives.steady import SteadyNoise as SteadyNoise
from jaxobs.tuning.objectives.transient import Peak as Peak
from jaxobs.tuning.objectives.transient import Settling as Settling
from jaxobs.tuning.objectives.transient import SquaredError as SquaredError
from jaxobs.tuning.objectives.weighted import Weighted as Weighted
