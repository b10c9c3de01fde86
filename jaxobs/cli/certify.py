"""`jaxobs certify`: a design from a config file, its certificate into another."""

import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from jaxobs.cli import screen


def certify(
    config: Annotated[Path, tyro.conf.Positional],
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("certificate.json"),
    plant: Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.py:NAME")] = None,
    changes: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="KEY=VALUE"), tyro.conf.UseAppendAction] = (),
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Designs an observer and writes the proof. Exit code 0 if it is proved, 1 if not, 2 if the config is wrong.

    Args:
        config: a TOML file: [plant] or [model], [bounds], [design]; or the name of an example of the package.
        out: the certificate, a jaxobs-cert/1 file.
        plant: in the place of [plant], without its parameters.
        changes: a key of the config with another value, --set design.rate=2.0; may be given several times.
        as_json: print the result as JSON on standard output.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs.cli.examples import parse
    from jaxobs.cli.override import override, replace_plant
    from jaxobs.cli.verify import judged, show
    from jaxobs.designs import Infeasible

    try:
        certificate = design(override(replace_plant(parse(config, "certify"), plant), changes))
        certificate.to_json(out)
    except Infeasible as error:
        return _unproved(error, out, as_json=as_json)
    except (OSError, ValueError) as error:
        return screen.complain(f"{config}: {error}")
    result = judged(out)
    if as_json:
        print(json.dumps(result, indent=2))
    else:
        show(result)
        Console().print("written:", str(out), markup=False, highlight=False)
    return 0 if result["holds"] else 1


def design(tables: dict[str, Any]) -> Any:
    """The certificate that the config asks for. ValueError naming the key, or Infeasible."""
    from jaxobs.cli.methods import method_from
    from jaxobs.cli.reading import unknown
    from jaxobs.cli.subject import subject_from

    for name in tables:
        if name not in ("plant", "bounds", "model", "design"):
            raise unknown(name, name, ["plant", "bounds", "model", "design"])
    method = method_from(tables.get("design"))
    subject = subject_from(tables)
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
