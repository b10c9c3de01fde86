"""Which paper this is."""

from jaxobs.papers.claims import Paper

PAPER = Paper("003", "Dufour, Flila and Hammouri, Nonlinear observers synthesis based on strongly persistent inputs (2010)")
