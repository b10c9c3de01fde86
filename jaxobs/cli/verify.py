"""`jaxobs verify`: certificates re-checked, and the bounds that travel with them."""

import json
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

HOLDS = "holds for the stored model and bounds"


def verify(
    files: Annotated[tuple[Path, ...], tyro.conf.Positional],
    against: Path | None = None,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Re-checks certificates in exact arithmetic. Exit code 0 if all hold, 1 if one does not, 2 if one is none.

    Args:
        files: jaxobs-cert/1 files, written by Certificate.to_json or by `jaxobs certify`.
        against: a C file written by `jaxobs export`: it has to be unchanged, to name this certificate, and to have the gain
            that is certified, digit by digit.
        as_json: print a JSON list on standard output instead.
    """
    results = [judged(path) for path in files]
    if against is not None:
        results = [compared(result, against) for result in results]
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


def compared(result: dict[str, Any], code: Path) -> dict[str, Any]:
    """The result, with whether the C file has what is certified."""
    from jaxobs.certificates import load
    from jaxobs.export import differences, read_c

    if "error" in result:
        return result
    path = Path(result["file"])
    try:
        found = differences(read_c(code), load(path), json.loads(path.read_text(encoding="utf-8"))["sha256"])
    except (OSError, ValueError) as error:
        return result | {"holds": False, "error": str(error)}
    told = f"{code} has the certified gain" if not found else f"{code} is not what is certified: {'; '.join(found)}"
    return result | {"against": told, "against_holds": not found, "holds": result["holds"] and not found}


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
    if "against" in result:
        line("code:", result["against"], "green" if result["against_holds"] else "red")
    if "bounds" in result:
        line("bounds:", result["bounds"], None if result["bounds_hold"] else "red")
        for formula in result["formulas"]:
            line("  ", formula)
