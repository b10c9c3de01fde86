"""`jaxobs export`: an observer from a config as C99, NumPy and StableHLO, with its proof."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from jaxobs.cli import screen


def export(
    config: Annotated[Path, tyro.conf.Positional],
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None,
    certificate: Path | None = None,
    precision: Literal["float32", "float64"] | None = None,
    kinds: tuple[Literal["c", "numpy", "stablehlo"], ...] = ("c", "numpy", "stablehlo"),
    changes: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="KEY=VALUE"), tyro.conf.UseAppendAction] = (),
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """Writes one sample of an observer for a controller. Exit code 0 if a theorem covers the code or none was asked for, 1 if
    the proof that was asked for fails or does not cover it, 2 if the config is wrong or an operation cannot be written.

    Args:
        config: a TOML file: [observer], [bounds] and [proof] if it is to be proved, [record] for the test vectors, [export];
            or the name of an example of the package.
        out: folder of the files, that of the observer's name if not given.
        certificate: a jaxobs-cert/1 file about this observer, in the place of [proof].
        precision: of the code; that in [export], or float64, if not given.
        kinds: which of them to write.
        changes: a key of the config with another value, --set export.name=left; may be given several times.
        as_json: print what was written as JSON on standard output.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs.cli.examples import parse
    from jaxobs.cli.export_config import export_config
    from jaxobs.cli.override import override
    from jaxobs.designs import Infeasible
    from jaxobs.export import export as write

    try:
        case = export_config(override(parse(config, "export"), changes), certificate)
        with screen.waiting("proof and code"):
            proof = case.certificate()
            folder = out or Path(case.settings.name)
            made = write(case.observer, folder, certificate=proof, kinds=kinds, **case.options(precision))
    except Infeasible as error:
        return screen.complain(f"not certified: {error}", 1)
    except (OSError, ValueError) as error:
        return screen.complain(f"{config}: {error}")
    told: dict[str, Any] = {"covered": made.coverage.covered, "coverage": made.coverage.sentence}
    if made.coverage.certificate is not None:
        told["sha256"] = made.coverage.certificate.to_dict()["sha256"]
    sizes = {str(path): path.stat().st_size for path in made.files.values()}
    if as_json:
        print(json.dumps(told | {"numbers_of_state": made.state, "files": sizes}, indent=2))
    else:
        console = Console()
        style = "green" if made.coverage.covered else "red" if proof is not None else None
        console.print(made.coverage.sentence, style=style, markup=False, highlight=False, soft_wrap=True)
        screen.print_pairs(console, {path: f"{size:,} bytes" for path, size in sizes.items()})
    return 0 if proof is None or made.coverage.covered else 1
