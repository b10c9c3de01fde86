"""Paper 001, claim by claim: the tracker, its noise, its peaking, its discrete form, the algebraic observer."""

# fmt: off
# isort: off
from jaxobs.papers.p001 import tracker as tracker
from jaxobs.papers.p001 import theorem1 as theorem1
from jaxobs.papers.p001 import noise as noise
from jaxobs.papers.p001 import peaking as peaking
from jaxobs.papers.p001 import digital as digital
from jaxobs.papers.p001 import fading as fading
from jaxobs.papers.p001 import algebraic as algebraic
from jaxobs.papers.p001 import observer as observer
# isort: on
# fmt: on
from jaxobs.papers.p001.paper import PAPER as PAPER
from jaxobs.papers.p001.pictures import PICTURES as PICTURES
