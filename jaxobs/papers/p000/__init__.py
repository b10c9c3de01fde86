"""Paper 000, claim by claim."""

# ruff: noqa: I001 (the claims register in the order of the paper)
from jaxobs.papers.p000 import preliminaries as preliminaries
from jaxobs.papers.p000 import weights as weights
from jaxobs.papers.p000 import convergence as convergence
from jaxobs.papers.p000 import integral as integral
from jaxobs.papers.p000 import noise as noise
from jaxobs.papers.p000 import discrete as discrete
from jaxobs.papers.p000 import example as example
from jaxobs.papers.p000.figures import PICTURES as PICTURES
from jaxobs.papers.p000.paper import PAPER as PAPER
