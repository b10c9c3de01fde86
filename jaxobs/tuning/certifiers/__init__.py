"""What a tuned observer shall be proved to do."""

from jaxobs.designs.error_gain import error_gain as error_gain
from jaxobs.tuning.certifiers.base import AbstractCertifier as AbstractCertifier
from jaxobs.tuning.certifiers.base import Start as Start
from jaxobs.tuning.certifiers.condition5 import ByCondition5 as ByCondition5
from jaxobs.tuning.certifiers.linear import Linear as Linear
from jaxobs.tuning.certifiers.quadratic import Quadratic as Quadratic
