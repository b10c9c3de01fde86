"""What a tuned case says on the screen and in the JSON, and the files it leaves."""

import dataclasses
import functools
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

from jaxobs import plotting
from jaxobs.cli.tune_case import Job
from jaxobs.cli.tune_floor import WORDS
from jaxobs.cli.tune_free import attribute
from jaxobs.tuning.case import Outcome
from jaxobs.tuning.tuned import change as relative


@dataclasses.dataclass(frozen=True)
class Result:
    """One case and what became of it; files: those written, by what they hold; notes: sentences about its starts."""

    job: Job
    outcome: Outcome
    files: dict[str, str]
    notes: tuple[str, ...]

    @property
    def what(self) -> str:
        """What was proved of both, or of the tuned one alone."""
        tuned = self.outcome.tuned
        if tuned.certificate is None:
            return "nothing is proved"
        rate = f"{'factor' if tuned.unit == 'a step' else 'decay rate'} {tuned.rate:.6g} {tuned.unit}"
        who = (
            "of both gains" if self.outcome.before is not None else "of the tuned gain alone: the gain before does not prove it"
        )
        return f"proved in exact arithmetic {who}: {rate}, {tuned.certificate.theorem}"

    @property
    def rows(self) -> tuple[Any, Any]:
        """The rows before and after, of the state of the summary."""
        found = self.outcome.comparison
        return found.row("before", self.job.state), found.row("after", self.job.state)


def write(job: Job, outcome: Outcome, out: Path, notes: Sequence[str]) -> Result:
    """Certificates of before and after, and the picture of the search."""
    files, words = {}, list(notes)
    history = outcome.tuned.history
    if np.min(history.best[:, -1]) >= np.min(history.loss[:, 0]) * (1 - 1e-9):
        words.append(f"no step of the search was better than where it began: start {outcome.tuned.start} is returned as given")
    if not np.isfinite(outcome.comparison.row("after", job.state).rmse):
        words.append("no run of the tuned gain came to its end: cap its poles, objective.fastest, or shorten time.dt")
    stem = slug(job.case.name)
    for name, certificate in (("before", outcome.before), ("after", outcome.tuned.certificate)):
        if certificate is None:
            continue
        path = out / f"{stem}.{name}.json"
        try:
            job.finish(certificate).to_json(path)
        except ValueError as error:
            certificate.to_json(path)
            words.append(f"{name}: the proof of the bounds does not travel: {error}")
        files[name] = str(path)
    picture = out / f"{stem}.history.png"
    plotting.history(outcome.tuned, title=job.case.name).savefig(picture)
    return Result(job, outcome, files | {"history": str(picture)}, tuple(words))


def slug(name: str) -> str:
    """A file name of a case's name."""
    return re.sub(r"[^\w.-]+", "_", name.replace(" = ", "")).strip("_.")


def tell(result: Result, console: Console) -> None:
    """What was proved, the table before and after, the cost of the proof, where the files are."""

    def line(text: str, style: str | None = None) -> None:
        console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)

    outcome = result.outcome
    console.rule(result.job.case.name)
    line(result.what, "green" if outcome.tuned.certificate is not None else "yellow")
    line(str(outcome.comparison))
    line(WORDS[result.job.config.check.floor])
    for text in (*filter(None, [result.job.config.check.note]), *result.notes):
        line(text)
    line(str(outcome.tuned))
    for name, values in numbers(outcome).items():
        line(f"{name}: {_short(values['before'])} -> {_short(values['after'])}")
    for name, path in result.files.items():
        line(f"{'picture' if path.endswith('.png') else f'certificate {name}'}: {path}")


def summary(results: Sequence[Result], console: Console) -> None:
    """One line a case."""
    table = Table(show_edge=False, pad_edge=False)
    for i, name in enumerate(("case", "proved rate", "state", "RMSE before", "after", "change [95 %]", "floor", "proof costs")):
        table.add_column(name, justify="right" if i else "left", no_wrap=True)
    for result in results:
        tuned, (before, after) = result.outcome.tuned, result.rows
        rate = "none" if tuned.certificate is None else f"{tuned.rate:.4g} {tuned.unit}"
        change = f"{after.change:+.1%} [{100 * after.change_low:+.1f}, {100 * after.change_high:+.1f}]"
        cost = "" if tuned.free_loss is None else relative(tuned.loss, tuned.free_loss)
        floor = "" if after.floor is None else f"{after.floor:.4g}"
        row = (result.job.case.name, rate, f"x{after.state}", f"{before.rmse:.4g}", f"{after.rmse:.4g}", change, floor, cost)
        table.add_row(*row)
    console.rule("before and after, at one proved rate each")
    console.print(table)


def pictures(results: Sequence[Result], out: Path) -> str:
    """The picture of all cases."""
    path = out / "comparison.png"
    shown = [(result.job.case.name, *result.rows) for result in results]
    plotting.comparison(shown).savefig(path)
    return str(path)


def numbers(outcome: Outcome) -> dict[str, dict[str, Any]]:
    """The free leaves before and after."""
    found = {}
    for name in outcome.tuned.theta:
        at = {key: functools.reduce(attribute, name.split("."), one) for key, one in outcome.observers.items()}
        found[name] = {key: np.asarray(value).tolist() for key, value in at.items()}
    return found


def data(result: Result) -> dict[str, Any]:
    """All numbers of a case, as plain data."""
    outcome, job = result.outcome, result.job
    tuned, history = outcome.tuned, outcome.tuned.history
    best = np.min(history.best, axis=0)
    certificate = tuned.certificate
    return {
        "case": job.case.name,
        "rate": None if certificate is None else tuned.rate,
        "unit": tuned.unit,
        "theorem": None if certificate is None else certificate.theorem,
        "claim": None if certificate is None else certificate.claim,
        "proved_before": outcome.before is not None,
        "state": job.state,
        "numbers": numbers(outcome),
        "loss": {"before": tuned.first_loss, "after": tuned.loss, "without_proof": tuned.free_loss},
        "comparison": outcome.comparison.to_dict(),
        "floor": job.config.check.floor,
        "search": {
            "starts": history.loss.shape[0], "steps": history.loss.shape[1], "calls": history.calls, "seconds": history.seconds,
            "compile_seconds": history.compile_seconds, "best_start": tuned.start, "repaired": list(tuned.repaired),
            "dropped": [list(one) for one in tuned.dropped], "stopped": tuned.stopped, "best": best.tolist(),
        },
        "notes": [*filter(None, [job.config.check.note]), *result.notes],
        "files": result.files,
    }  # fmt: skip


def finite(value: Any) -> Any:
    """JSON has no infinity, and no NaN."""
    if isinstance(value, dict):
        return {name: finite(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [finite(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return "inf" if value == math.inf else None
    return value.item() if isinstance(value, np.generic | jax.Array) else value


def _short(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_short, value)) + "]"
    return f"{value:.5g}"
