"""What a plant is: its forms from the pattern of its Jacobian, and whether its output tells its state."""

from jaxobs.structure.forms import Forms as Forms
from jaxobs.structure.forms import Slopes as Slopes
from jaxobs.structure.forms import as_chain as as_chain
from jaxobs.structure.forms import as_lipschitz as as_lipschitz
from jaxobs.structure.forms import as_triangular as as_triangular
from jaxobs.structure.forms import forms as forms
from jaxobs.structure.normal import NormalSlopes as NormalSlopes
from jaxobs.structure.normal import normal_form as normal_form
from jaxobs.structure.normal import normal_slopes as normal_slopes
from jaxobs.structure.observability import Observability as Observability
from jaxobs.structure.observability import observability as observability
