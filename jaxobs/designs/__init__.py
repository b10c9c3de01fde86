"""Plant and wishes in, observer and proof out; or Infeasible, with what to change."""

from jaxobs.designs.infeasible import Infeasible as Infeasible
from jaxobs.designs.riccati import riccati as riccati
