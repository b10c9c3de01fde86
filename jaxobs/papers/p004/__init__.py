"""Paper 004, claim by claim, in its order."""

from jaxobs.papers.p004 import theory as theory  # isort: skip
from jaxobs.papers.p004 import duffing as duffing  # isort: skip
from jaxobs.papers.p004 import joint as joint  # isort: skip
from jaxobs.papers.p004 import lorenz as lorenz  # isort: skip
from jaxobs.papers.p004 import figures as figures  # isort: skip
from jaxobs.papers.p004 import others as others  # isort: skip
from jaxobs.papers.p004.figures import PICTURES as PICTURES
from jaxobs.papers.p004.paper import PAPER as PAPER
