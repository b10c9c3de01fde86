"""jaxobs: nonlinear state observers in JAX, their design, proof, tuning and study.

    plant --design--> (observer, certificate) --simulate--> figures and tables

Every name is loaded at its first use; importing jaxobs sets no global configuration.
"""

import importlib
from typing import TYPE_CHECKING, Any

from jaxobs._version import __version__ as __version__

if TYPE_CHECKING:
    # fmt: off
    from jaxobs import certificates as certificates
    from jaxobs import chain_bounds as chain_bounds
    from jaxobs import datasets as datasets
    from jaxobs import designs as designs
    from jaxobs import excitation as excitation
    from jaxobs import export as export
    from jaxobs import hurwitz as hurwitz
    from jaxobs import integrators as integrators
    from jaxobs import interop as interop
    from jaxobs import intervals as intervals
    from jaxobs import linalg as linalg
    from jaxobs import metrics as metrics
    from jaxobs import monitors as monitors
    from jaxobs import noise as noise
    from jaxobs import observers as observers
    from jaxobs import papers as papers
    from jaxobs import plants as plants
    from jaxobs import plotting as plotting
    from jaxobs import report as report
    from jaxobs import signals as signals
    from jaxobs import streaming as streaming
    from jaxobs import structure as structure
    from jaxobs import studies as studies
    from jaxobs import tuning as tuning
    from jaxobs._differentiate import Derivatives as Derivatives
    from jaxobs._differentiate import differentiate as differentiate
    from jaxobs._module import Module as Module
    from jaxobs._module import Scalar as Scalar
    from jaxobs._module import astype as astype
    from jaxobs._module import param as param
    from jaxobs._module import static as static
    from jaxobs._observe import Estimate as Estimate
    from jaxobs._observe import observe as observe
    from jaxobs._simulate import Trajectory as Trajectory
    from jaxobs._simulate import score as score
    from jaxobs._simulate import simulate as simulate
    from jaxobs.streaming import Runner as Runner
    from jaxobs.studies import Family as Family
    from jaxobs.studies import Seeds as Seeds
    from jaxobs.studies import compile_cache as compile_cache
    from jaxobs.studies import grid as grid
    from jaxobs.studies import mean_gradient as mean_gradient
    from jaxobs.studies import over as over
    from jaxobs.studies import study as study
    from jaxobs.studies import use_all_cores as use_all_cores
    from jaxobs.studies import variants as variants
    from jaxobs.tuning import Tuned as Tuned
    from jaxobs.tuning import tune as tune
    # fmt: on

_MODULES = (
    "certificates", "chain_bounds", "datasets", "designs", "excitation", "export", "hurwitz", "integrators", "interop",
    "intervals", "linalg", "metrics", "monitors", "noise", "observers", "papers", "plants", "plotting", "report", "signals",
    "streaming", "structure", "studies", "tuning",
)  # fmt: skip
_NAMES = {
    "Derivatives": "_differentiate",
    "Estimate": "_observe",
    "Family": "studies",
    "Module": "_module",
    "Runner": "streaming",
    "Scalar": "_module",
    "Seeds": "studies",
    "Trajectory": "_simulate",
    "astype": "_module",
    "differentiate": "_differentiate",
    "grid": "studies",
    "mean_gradient": "studies",
    "observe": "_observe",
    "over": "studies",
    "param": "_module",
    "score": "_simulate",
    "simulate": "_simulate",
    "static": "_module",
    "Tuned": "tuning",
    "tune": "tuning",
    "compile_cache": "studies",
    "study": "studies",
    "use_all_cores": "studies",
    "variants": "studies",
}


def __getattr__(name: str) -> Any:
    if name in _NAMES:
        return getattr(importlib.import_module(f"jaxobs.{_NAMES[name]}"), name)
    if name in _MODULES:
        return importlib.import_module(f"jaxobs.{name}")
    raise AttributeError(f"module 'jaxobs' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(["__version__", *_MODULES, *_NAMES])
