"""Grids of observers, what is computed over them, and Monte Carlo studies in data sets with named axes."""

import importlib
from typing import TYPE_CHECKING, Any

from jaxobs.studies.axes import Seeds as Seeds
from jaxobs.studies.durable import StoreError as StoreError
from jaxobs.studies.family import Family as Family
from jaxobs.studies.family import grid as grid
from jaxobs.studies.family import over as over
from jaxobs.studies.progress import Progress as Progress
from jaxobs.studies.variants import variants as variants

if TYPE_CHECKING:
    from jaxobs.studies.montecarlo import study as study
    from jaxobs.studies.reductions import tree_mean as tree_mean
    from jaxobs.studies.reductions import tree_sum as tree_sum
    from jaxobs.studies.store import open_study as open_study

# They need xarray, which a grid does not.
_LATER = {"study": "montecarlo", "tree_mean": "reductions", "tree_sum": "reductions", "open_study": "store"}


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(importlib.import_module(f"jaxobs.studies.{_LATER[name]}"), name)
    raise AttributeError(f"module 'jaxobs.studies' has no attribute {name!r}")
