"""Paper 003, claim by claim, in its order."""

from jaxobs.papers.p003 import forms as forms
from jaxobs.papers.p003 import gramians as gramians
from jaxobs.papers.p003 import numerics as numerics
from jaxobs.papers.p003 import proof as proof
from jaxobs.papers.p003 import rows as rows
from jaxobs.papers.p003.paper import PAPER as PAPER
from jaxobs.papers.p003.picture import inputs_picture

PICTURES = (inputs_picture,)
