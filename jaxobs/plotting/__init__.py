"""Pictures for people: each is one function of a run, a data set, a search, an observer or a certificate.

    figure = jaxobs.plotting.estimate(trajectory);     figure.savefig("estimate.png")

Every function returns a matplotlib Figure that notebooks show by themselves. `ax=` (pictures of one panel) or `figure=` (a
Figure or a SubFigure, for pictures of several) put the picture among others; nothing here uses pyplot or changes its
settings. States, outputs and their panels are counted from 1, as in the formulas.
"""

import importlib
from typing import TYPE_CHECKING, Any

from jaxobs.plotting.style import Picture as Picture
from jaxobs.plotting.style import canvas as canvas
from jaxobs.plotting.style import series as series

if TYPE_CHECKING:
    from jaxobs.plotting.estimates import estimate as estimate
    from jaxobs.plotting.innovations import innovation as innovation
    from jaxobs.plotting.ladders import proof_ladder as proof_ladder
    from jaxobs.plotting.pole_map import poles as poles
    from jaxobs.plotting.regions import certified_region as certified_region
    from jaxobs.plotting.searches import comparison as comparison
    from jaxobs.plotting.searches import front as front
    from jaxobs.plotting.searches import history as history
    from jaxobs.plotting.studies import convergence as convergence
    from jaxobs.plotting.studies import noise_curve as noise_curve
    from jaxobs.plotting.studies import noise_map as noise_map
    from jaxobs.plotting.transients import peaking as peaking

# A picture of a run needs neither the designs nor the tuning: each is loaded with what it shows.
_LATER = {
    "certified_region": "regions",
    "comparison": "searches",
    "convergence": "studies",
    "estimate": "estimates",
    "front": "searches",
    "history": "searches",
    "innovation": "innovations",
    "noise_curve": "studies",
    "noise_map": "studies",
    "peaking": "transients",
    "poles": "pole_map",
    "proof_ladder": "ladders",
}


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(importlib.import_module(f"jaxobs.plotting.{_LATER[name]}"), name)
    raise AttributeError(f"module 'jaxobs.plotting' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_LATER])
