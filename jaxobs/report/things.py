"""What a page says of a thing: runs, studies, searches, certificates, pictures."""

import functools
import io
import json
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from jaxobs import plotting
from jaxobs._differentiate import Derivatives
from jaxobs._module import refuse
from jaxobs._observe import Estimate
from jaxobs._simulate import Trajectory
from jaxobs.certificates import AbstractCertificate
from jaxobs.designs.ladder import Rung
from jaxobs.plotting._runs import as_runs, is_dataset, labels
from jaxobs.plotting.estimates import several_truths
from jaxobs.report import charts
from jaxobs.report.explorer import explorer
from jaxobs.report.page import Chart, Section, Table
from jaxobs.tuning import Comparison, Front, Tuned
from jaxobs.tuning.comparison import Row

LISTED = 12  # numbers of one parameter


@functools.singledispatch
def sections(thing: Any, heading: str = "") -> list[Section]:
    """The sections of a page about a thing: a Trajectory, Estimate or Derivatives, a study's data set, Tuned, Front,
    Comparison, the rungs of a ladder, a certificate, a figure of matplotlib or plotly, a sentence, a list of these;
    {heading: thing} for headings of one's own.

    Register more kinds with `sections.register`. ValueError for anything else.
    """
    if is_dataset(thing) and "diverged_at" in thing.data_vars:
        return _study(thing, heading or "Study")
    if hasattr(thing, "to_plotly_json") and hasattr(thing, "to_json"):
        return [Section(heading or "Picture", charts=[Chart(str(thing.to_json()), heading)])]
    kinds = "a run, a study's data set, Tuned, Front, Comparison, the rungs of a ladder, a certificate, a figure or a sentence"
    raise refuse("report.write", "things", type(thing).__name__, kinds, "Or register it: jaxobs.report.sections.register.")


@sections.register(str)
def _(thing: str, heading: str = "") -> list[Section]:
    return [Section(heading or "Note", [thing])]


@sections.register(Section)
def _(thing: Section, heading: str = "") -> list[Section]:
    return [thing._replace(heading=heading) if heading else thing]


@sections.register(dict)  # a data set is a Mapping, too
def _(thing: dict[str, Any], heading: str = "") -> list[Section]:
    return [section for name, one in thing.items() for section in sections(one, str(name))]


@sections.register(Figure)
def _(thing: Figure, heading: str = "") -> list[Section]:
    return [Section(heading or "Picture", pictures=[(_png(thing), heading)])]


@sections.register(Trajectory)
@sections.register(Estimate)
@sections.register(Derivatives)
def _(thing: Any, heading: str = "") -> list[Section]:
    runs = as_runs("report", thing)
    words = [f"{len(runs.ts)} samples from {runs.ts[0]:.6g} s to {runs.ts[-1]:.6g} s."]
    if runs.count > 1:
        words.append(f"{runs.count} runs, of which {np.count_nonzero(~runs.finite)} diverged.")
    elif not runs.finite.all():
        words.append("The run diverged.")
    if runs.valid is not None and not np.all(runs.valid):
        words.append(f"{np.count_nonzero(~runs.valid)} of {runs.valid.size} samples were lost.")
    what = "error of the estimate" if several_truths(runs) else "estimate"
    caption = f"The {what} of each state; a click in the legend hides a line, the slider below chooses the times."
    chart = charts.trajectory(runs, labels("report", None, runs.n), caption)
    return [Section(heading or "Run", [" ".join(words)], _errors(runs), charts=[chart])]


def _errors(runs: Any) -> Table | None:
    """RMSE over the whole of the runs and over their second half, and the peak."""
    if runs.x is None or not runs.finite.any():
        return None
    errors = (runs.xhat - runs.x)[runs.finite]
    half = errors[:, errors.shape[1] // 2 :]
    columns = [np.sqrt(np.mean(part**2, axis=(0, 1))) for part in (errors, half)] + [np.max(np.abs(errors), axis=(0, 1))]
    rows = [[f"x{i + 1}", *(f"{value[i]:.4g}" for value in columns)] for i in range(runs.n)]
    return ["state", "RMSE", "RMSE of the second half", "largest error"], rows


def _study(ds: Any, heading: str) -> list[Section]:
    found = explorer(ds)
    gone = f"{found.diverged} diverged and are left out" if found.diverged else "none diverged"
    words = [f"{found.computed} runs, of which {gone}.", *found.notes]
    config = str(ds.attrs.get("config", ""))
    details = [("Configuration of the study", _indented(config))] if config else []
    facts = [[str(name), str(value)] for name, value in ds.attrs.items() if name not in ("config", "title")]
    source = Section("Where the numbers come from", [], (["attribute", "value"], facts), details=details)
    return [Section(heading, [" ".join(words)], found.points, charts=[found.chart]), source]


def _indented(config: str) -> str:
    try:
        return json.dumps(json.loads(config), indent=2)
    except ValueError:
        return config


@sections.register(Tuned)
def _(thing: Tuned, heading: str = "") -> list[Section]:
    leaves = jax.tree_util.tree_flatten_with_path(thing.theta)[0]
    numbers = [[jax.tree_util.keystr(path) or "theta", _listed(leaf)] for path, leaf in leaves]
    table = (["parameter, as searched", "value"], numbers)
    search = Section(heading or "Search", str(thing).split("\n"), table, charts=[charts.history(thing)])
    proof = [] if thing.certificate is None else sections(thing.certificate, "What is proved of the tuned gain")
    return [search, *proof]


def _listed(value: Any) -> str:
    flat = np.asarray(value, float).reshape(-1)
    return ", ".join(f"{v:.6g}" for v in flat[:LISTED]) + (", ..." if flat.size > LISTED else "")


@sections.register(Front)
def _(thing: Front, heading: str = "") -> list[Section]:
    names = list(thing.points[0].values)
    rows = []
    for one in thing.points:
        values = (f"{one.values[name]:.5g}" for name in names)
        rows.append([f"{one.rate:.4g}", f"{one.weight:g}", *values, "yes" if one.is_dominated else "no"])
    words = [f"A rate of {rate:.4g} {thing.unit} is not proved; {reached:.4g} was reached." for rate, reached in thing.missing]
    table = ([f"rate {thing.unit}", "weight", *names, "dominated"], rows)
    own = heading or "What a decay rate costs"
    return [Section(own, ["Every point is certified.", *words], table, charts=charts.front(thing))]


@sections.register(Comparison)
def _(thing: Comparison, heading: str = "") -> list[Section]:
    header = ["observer", "state", "RMSE", "95 %", "change", "95 %", "settling [s]", "peak", "bandwidth [rad/s]", "diverged"]
    words = f"RMSE over t >= {thing.after:.6g} s, {thing.seeds} seeds; intervals over the seeds, changes paired."
    several = len({one.observer for one in thing.rows}) > 1
    pictures = [(_png(plotting.comparison(thing)), "RMSE against that of the first observer.")] if several else []
    return [Section(heading or "Comparison", [words], (header, [_row(one) for one in thing.rows]), pictures)]


def _row(one: Row) -> list[str]:
    change = ["", ""] if one.change == 0 else [f"{one.change:+.1%}", f"{one.change_low:+.1%} to {one.change_high:+.1%}"]
    tail = [f"{one.settling_time:.3g}", f"{one.peak:.3g}", f"{one.bandwidth:.3g}", str(one.diverged)]
    return [one.observer, f"x{one.state}", f"{one.rmse:.4g}", f"{one.rmse_low:.4g} to {one.rmse_high:.4g}", *change, *tail]


@sections.register(tuple)
@sections.register(list)
def _(thing: Sequence[Any], heading: str = "") -> list[Section]:
    if not thing or not all(isinstance(one, Rung) for one in thing):
        return [section for one in thing for section in sections(one, heading)]
    rows = [[one.name, one.needs, _gamma(one.smallest_gamma), _gamma(one.gamma), _verdict(one)] for one in thing]
    table = (["proof", "needs", "smallest gamma [1/s]", "certified at", "exact certificate"], rows)
    caption = "The gamma that each kind of proof reaches. Not certified never means unstable."
    return [Section(heading or "Proofs", [], table, [(_png(plotting.proof_ladder(thing)), caption)])]


def _gamma(value: float | None) -> str:
    return "none" if value is None else f"{value:.5g}"


def _verdict(rung: Rung) -> str:
    return "none" if rung.certificate is None else "holds" if rung.certificate.verify().holds else "does not hold"


@sections.register(AbstractCertificate)
def _(thing: AbstractCertificate, heading: str = "") -> list[Section]:
    verdict, stored = thing.verify(), thing.to_dict()
    words = [
        f"Claim: {thing.claim}",
        *(f"Assumption: {one}" for one in thing.assumptions),
        f"Verdict, in exact arithmetic: {'certified' if verdict.holds else 'not certified'}: {verdict.why}",
        f"Theorem {thing.theorem}; SHA-256 of the stored numbers {stored['sha256']}.",
    ]
    margins = (["margin", "value"], [[name, f"{value:.6g}"] for name, value in verdict.margins.items()])
    more = [("The certificate, as a file that jaxobs verify reads", json.dumps(stored, indent=2))]
    return [Section(heading or "Certificate", words, margins if verdict.margins else None, details=more)]


def _png(figure: Figure) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=150)
    return stream.getvalue()
