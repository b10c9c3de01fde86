"""Grids of observers, what is computed over them, and Monte Carlo studies in data sets with named axes."""

import importlib
from typing import TYPE_CHECKING, Any

from jaxobs.studies.axes import Seeds as Seeds
from jaxobs.studies.devices import compile_cache as compile_cache
from jaxobs.studies.devices import use_all_cores as use_all_cores
from jaxobs.studies.durable import StoreError as StoreError
from jaxobs.studies.family import Family as Family
from jaxobs.studies.family import grid as grid
from jaxobs.studies.family import over as over
from jaxobs.studies.progress import Progress as Progress
from jaxobs.studies.variants import variants as variants

if TYPE_CHECKING:
    from jaxobs.studies.gradient import MeanGradient as MeanGradient
    from jaxobs.studies.gradient import Slope as Slope
    from jaxobs.studies.gradient import mean_gradient as mean_gradient
    from jaxobs.studies.montecarlo import study as study
    from jaxobs.studies.reductions import tree_mean as tree_mean
    from jaxobs.studies.reductions import tree_sum as tree_sum
    from jaxobs.studies.store import open_study as open_study
    from jaxobs.studies.workers import study_on as study_on

# They need xarray, which a grid does not.
_LATER = {"study": "montecarlo", "tree_mean": "reductions", "tree_sum": "reductions", "open_study": "store"}
_LATER |= {"study_on": "workers"}
_LATER |= {"mean_gradient": "gradient", "MeanGradient": "gradient", "Slope": "gradient"}


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(importlib.import_module(f"jaxobs.studies.{_LATER[name]}"), name)
    raise AttributeError(f"module 'jaxobs.studies' has no attribute {name!r}")
