"""`jaxobs certify`: a design from a config file, its certificate into another."""

import json
import math
import sys
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console


def certify(
    config: Annotated[Path, tyro.conf.Positional],
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("certificate.json"),
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Designs an observer and writes the proof. Exit code 0 if it is proved, 1 if not, 2 if the config is wrong.

    Args:
        config: a TOML file: [plant] or [model], [bounds], [design]; or the name of an example of the package.
        out: the certificate, a jaxobs-cert/1 file.
        as_json: print the result as JSON on standard output.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs.cli.verify import judged, show
    from jaxobs.designs import Infeasible

    try:
        certificate = design(parse(config))
        certificate.to_json(out)
    except Infeasible as error:
        return _unproved(error, out, as_json=as_json)
    except (OSError, ValueError) as error:
        Console(stderr=True).print(f"{config}: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        return 2
    result = judged(out)
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        show(result)
        Console().print("written:", str(out), markup=False, highlight=False)
    return 0 if result["holds"] else 1


def examples(*, study: bool = False, tune: bool = False) -> dict[str, str]:
    """The configs that the package brings, for this command, for `jaxobs study` or for `jaxobs tune`: name and text."""
    folder = resources.files("jaxobs") / "configs"
    found = [one for one in folder.iterdir() if one.name.endswith(".toml") and _kind(one.name) == (study, tune)]
    return {one.name.removesuffix(".toml"): one.read_text(encoding="utf-8") for one in sorted(found, key=lambda one: one.name)}


def _kind(name: str) -> tuple[bool, bool]:
    return name.startswith("study_"), name.startswith("tune_")


def parse(config: Path, *, study: bool = False, tune: bool = False) -> dict[str, Any]:
    """The tables of the file, or of the example of that name. ValueError if it is no TOML, or there is none."""
    known = examples(study=study, tune=tune)
    try:
        text = known[str(config)] if str(config) in known and not config.exists() else config.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ValueError(f"no such file; expected a TOML file or one of the examples {', '.join(known)}") from error
    return tomllib.loads(text)


def design(tables: dict[str, Any]) -> Any:
    """The certificate that the config asks for. ValueError naming the key, or Infeasible."""
    from jaxobs.cli.methods import method_from
    from jaxobs.cli.reading import read, unknown
    from jaxobs.cli.subject import Bounds, Model, Subject, plant_from

    for name in tables:
        if name not in ("plant", "bounds", "model", "design"):
            raise unknown(name, name, ["plant", "bounds", "model", "design"])
    method = method_from(tables.get("design"))
    plant = plant_from(tables["plant"]) if "plant" in tables else None
    bounds = read(Bounds, tables["bounds"], "bounds") if "bounds" in tables else None
    model = read(Model, tables["model"], "model") if "model" in tables else None
    subject = Subject(plant, bounds, model)
    return subject.finished(method.certificate(subject))


def _unproved(error: Any, out: Path, *, as_json: bool) -> int:
    """Says why, what to change, and writes the proof that there is none where there is such a proof."""
    absent = getattr(error, "certificate", None)
    place = out.with_name(f"{out.stem}.absent{out.suffix}") if absent is not None else None
    if absent is not None and place is not None:
        absent.to_json(place)
    if as_json:
        margin = error.margin if math.isfinite(error.margin) else None
        told = {"holds": False, "reason": error.reason, "margin": margin, "change": error.change, "best": error.best}
        print(json.dumps(told | {"absence": str(place) if place else None}, indent=2))
        return 1
    console = Console(file=sys.stdout)
    console.print("not certified:", error.reason, style="red", markup=False, highlight=False, soft_wrap=True)
    console.print("to change:", error.change, markup=False, highlight=False)
    if place is not None:
        console.print("proof that there is none:", str(place), markup=False, highlight=False)
    return 1
