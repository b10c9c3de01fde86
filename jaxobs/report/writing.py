"""Things in, one HTML file out."""

import datetime
import platform
from os import PathLike
from pathlib import Path
from typing import Any

from jaxobs._module import refuse
from jaxobs._version import __version__
from jaxobs.report.page import page
from jaxobs.report.things import sections


def write(path: str | PathLike[str], *things: Any, title: str = "jaxobs report") -> Path:
    """One HTML file about the things, in their order: no network is needed, now or later, to read it or to use its selectors.

        jaxobs.report.write("study.html", {"Noise of the pendulum": ds}, trajectory, certificate, title="Pendulum")

    things: see `jaxobs.report.sections`; a data set of `jaxobs.study` becomes curves and heat maps of its metrics with
    selectors for the axes, a run its estimates on a common time axis with a range slider, a certificate its claim,
    assumptions, verdict and margins. Charts bring plotly.js into the file, some 5 MB. Returns the path. ValueError for a
    thing of another kind, or none.
    """
    if not things:
        raise refuse("report.write", "things", "none", "at least one", "Give a data set, a run, a certificate, ...")
    found = [section for thing in things for section in sections(thing)]
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    where = Path(path)
    where.parent.mkdir(parents=True, exist_ok=True)
    footer = f"Written by jaxobs {__version__} with Python {platform.python_version()} on {now}."
    where.write_text(page(title, found, footer=footer), encoding="utf-8")
    return where
