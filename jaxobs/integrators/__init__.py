"""From one grid point to the next: explicit, exponential (stiff linear part exactly), adaptive."""

from jaxobs.integrators.adaptive import Adaptive as Adaptive
from jaxobs.integrators.base import AbstractIntegrator as AbstractIntegrator
from jaxobs.integrators.base import Field as Field
from jaxobs.integrators.base import check_step as check_step
from jaxobs.integrators.explicit import RK4 as RK4
from jaxobs.integrators.explicit import Euler as Euler
from jaxobs.integrators.exponential import Exponential as Exponential
from jaxobs.integrators.limits import UnstableStep as UnstableStep
from jaxobs.integrators.limits import largest_step as largest_step
from jaxobs.integrators.meters import ProgressMeter as ProgressMeter
from jaxobs.integrators.meters import metered_scan as metered_scan
