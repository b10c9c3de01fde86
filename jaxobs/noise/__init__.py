"""Measurement noise and process disturbance: paths on the time grid, held between its points."""

from jaxobs.noise.additive import Bias as Bias
from jaxobs.noise.additive import Gaussian as Gaussian
from jaxobs.noise.additive import Silent as Silent
from jaxobs.noise.additive import Sinusoid as Sinusoid
from jaxobs.noise.additive import Uniform as Uniform
from jaxobs.noise.base import BLOCK as BLOCK
from jaxobs.noise.base import AbstractNoise as AbstractNoise
from jaxobs.noise.base import drawn as drawn
from jaxobs.noise.irregular import Dropout as Dropout
from jaxobs.noise.irregular import Outliers as Outliers
from jaxobs.noise.irregular import Sum as Sum
