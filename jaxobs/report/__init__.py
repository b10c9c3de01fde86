"""What a person looks at: tables on the terminal, pictures, and one HTML page that needs no network."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxobs.report.page import Section as Section
    from jaxobs.report.things import sections as sections
    from jaxobs.report.writing import write as write

# The tables of the command line need none of what draws a page.
_LATER = {"Section": "page", "sections": "things", "write": "writing"}


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(importlib.import_module(f"jaxobs.report.{_LATER[name]}"), name)
    raise AttributeError(f"module 'jaxobs.report' has no attribute {name!r}")
