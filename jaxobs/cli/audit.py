"""`jaxobs audit`: a gain that somebody gives, proved, disproved, or neither."""

import json
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from jaxobs.cli import screen


def audit(
    config: Annotated[Path, tyro.conf.Positional],
    plant: Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE.py:NAME")] = None,
    changes: Annotated[tuple[str, ...], tyro.conf.arg(name="set", metavar="KEY=VALUE"), tyro.conf.UseAppendAction] = (),
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("audit.json"),
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> int:
    """What can be said of a given gain: its error decays (proved for every slope within the bounds), grows (proved at a
    constant slope, or under switching), or neither could be shown. Whatever is proved is written. Exit code 0 if it is proved
    that the error decays, 1 if not, 2 if the config is wrong.

    Args:
        config: a TOML file, or an example of the package: [plant] and [bounds], or [model]; [audit] with gain and, if wanted,
            the rate [1/s], or the factor a step, that it is to prove. A config of `jaxobs certify` whose [design] has a gain
            will do.
        plant: in the place of [plant].
        changes: a key of the config with another value, --set audit.gain=[[6.0],[9.0]]; may be given several times.
        out: the certificate: of decay, of growth, or that no quadratic Lyapunov function exists.
        as_json: print the result as JSON on standard output instead.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    from jaxobs.cli.examine import audited
    from jaxobs.cli.examples import parse
    from jaxobs.cli.override import override, replace_plant

    try:
        subject, found = audited(override(replace_plant(parse(config, "audit", "certify"), plant), changes))
        certificate = found.certificate or found.counterexample or found.obstruction
        if certificate is not None:
            subject.finished(certificate).to_json(out)
    except (OSError, ValueError) as error:
        return screen.complain(f"{config}: {error}")
    told: dict[str, Any] = {"gain": found.gain.tolist(), "verdict": found.verdict, "certified": found.certificate is not None}
    told |= {"reason": found.reason or None, "claim": None, "certificate": None}
    if certificate is not None:
        told |= {"claim": certificate.claim, "certificate": str(out)}
    points = [
        {"at": one.label, "rho": list(one.rho), "stable": one.count.is_stable, "growth": one.growth} for one in found.frozen
    ]
    told |= {"frozen": points}
    if as_json:
        print(json.dumps(told, indent=2))
    else:
        console = Console()
        console.print(str(found), markup=False, highlight=False, soft_wrap=True)
        if certificate is not None:
            console.print("proved:", certificate.claim, markup=False, highlight=False, soft_wrap=True)
            console.print("written:", str(out), markup=False, highlight=False)
    return 0 if found.certificate is not None else 1
