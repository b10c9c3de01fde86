"""Paper 002, claim by claim, in its order."""

from jaxobs.papers.p002 import problem as problem  # isort: skip
from jaxobs.papers.p002 import method as method  # isort: skip
from jaxobs.papers.p002 import example as example  # isort: skip
from jaxobs.papers.p002 import table as table  # isort: skip
from jaxobs.papers.p002 import figure as figure  # isort: skip
from jaxobs.papers.p002.figure import PICTURES as PICTURES
from jaxobs.papers.p002.paper import PAPER as PAPER
