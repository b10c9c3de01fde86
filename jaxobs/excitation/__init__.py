"""What can be seen, and through which inputs: Gramians of an input along a plant, and tests of observability for every input.

found = jaxobs.excitation.classify(plant, signal, horizon=(2.0, 32.0))
print(found.why)
"""

from jaxobs.excitation.classify import Excitation as Excitation
from jaxobs.excitation.classify import classify as classify
from jaxobs.excitation.gramian import Gramians as Gramians
from jaxobs.excitation.gramian import fading_gramians as fading_gramians
from jaxobs.excitation.gramian import window_gramians as window_gramians
from jaxobs.excitation.structure import Structure as Structure
from jaxobs.excitation.structure import require_triangular as require_triangular
from jaxobs.excitation.structure import structure as structure
