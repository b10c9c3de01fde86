"""Paper 000: its claims register here."""

from jaxobs.papers.claims import Paper

PAPER = Paper("000", "S. Ibrir, On observer design for nonlinear systems")
