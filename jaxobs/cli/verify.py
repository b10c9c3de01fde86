"""`jaxobs verify`: certificates re-checked, and the bounds that travel with them."""

import json
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

HOLDS = "holds for the stored model and bounds"


def verify(
    files: Annotated[tuple[Path, ...], tyro.conf.Positional],
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Re-checks certificates in exact arithmetic. Exit code 0 if all hold, 1 if one does not, 2 if one is none.

    Args:
        files: jaxobs-cert/1 files, written by Certificate.to_json or by `jaxobs certify`.
        as_json: print a JSON list on standard output instead.
    """
    results = [judged(path) for path in files]
    if as_json:
        print(json.dumps(results, indent=2))
    else:
        for result in results:
            show(result)
    if not files:
        Console(stderr=True).print("verify: given no file; expected the names of jaxobs-cert/1 files", style="red")
    return 2 if not files or any("error" in result for result in results) else int(not all(r["holds"] for r in results))


def judged(path: Path) -> dict[str, Any]:
    """What the exact check says about a file: plain data, with `error` where the file is no certificate."""
    from jaxobs.certificates import load

    try:
        certificate = load(path)
    except (OSError, ValueError) as error:
        return {"file": str(path), "holds": False, "error": str(error)}
    verdict = certificate.verify()
    result = {"file": str(path), "theorem": certificate.theorem, "claim": certificate.claim}
    result |= {"assumptions": list(certificate.assumptions), "holds": bool(verdict), "why": verdict.why}
    result |= {"margins": verdict.margins} | _bounds(path)
    result["holds"] = bool(verdict) and result.get("bounds_hold", True)
    return result | {"verdict": HOLDS if result["holds"] else "not certified"}


def _bounds(path: Path) -> dict[str, Any]:
    """What the second checker says about the bounds that travel in the file; nothing where none do."""
    from jaxobs.certificates import checker_bounds

    data = json.loads(path.read_text(encoding="utf-8"))
    if "bounds" not in data:
        return {}
    found = checker_bounds.check(data)
    return {"bounds": found["why"], "formulas": list(found["lines"]), "bounds_hold": found["holds"]}


def show(result: dict[str, Any]) -> None:
    """The result as lines: claim, assumptions, verdict."""
    console = Console()

    def line(what: str, text: str, style: str | None = None) -> None:
        console.print(what, text, style=style, markup=False, highlight=False, soft_wrap=True)

    if "error" in result:
        Console(stderr=True).print(result["error"], style="red", markup=False, highlight=False, soft_wrap=True)
        return
    line("file:", result["file"])
    line("claim:", result["claim"])
    for assumption in result["assumptions"]:
        line("assumes:", assumption)
    line("verdict:", result["why"], "green" if result["why"].startswith(HOLDS) else "red")
    if "bounds" in result:
        line("bounds:", result["bounds"], None if result["bounds_hold"] else "red")
        for formula in result["formulas"]:
            line("  ", formula)
