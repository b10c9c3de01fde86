"""Grids of observers and what is computed over them."""

from jaxobs.studies.family import Family as Family
from jaxobs.studies.family import grid as grid
from jaxobs.studies.family import over as over
