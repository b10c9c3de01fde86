"""The command line: one function a command, each in its own file."""

import sys
from collections.abc import Callable
from typing import Annotated, Any, Union

import tyro
from rich.console import Console

from jaxobs.cli.audit import audit
from jaxobs.cli.bench import bench
from jaxobs.cli.catalogue import observers, plants
from jaxobs.cli.certify import certify
from jaxobs.cli.demo import demo
from jaxobs.cli.design import design
from jaxobs.cli.differentiate import differentiate
from jaxobs.cli.export import export
from jaxobs.cli.init import init
from jaxobs.cli.reproduce import reproduce
from jaxobs.cli.study import study
from jaxobs.cli.tune import tune
from jaxobs.cli.verify import verify

COMMANDS: dict[str, tuple[Callable[..., int], str]] = {
    "demo": (demo, "a recorded walk and a Monte Carlo study, as one report: start here"),
    "init": (init, "write an example to start from: a config, or a plant of your own"),
    "plants": (plants, "the plants of the package, one line each"),
    "observers": (observers, "the observers of the package, one line each"),
    "design": (design, "observers for a plant, by every design that applies, with proofs"),
    "certify": (certify, "one design from a config, its certificate into a file"),
    "verify": (verify, "certificates, checked again in exact arithmetic"),
    "audit": (audit, "a gain of yours: proved, disproved, or neither"),
    "study": (study, "Monte Carlo over gains, noise and seeds, from a config"),
    "tune": (tune, "less noise at the same proved rate, by gradient"),
    "export": (export, "an observer as C99, NumPy and StableHLO, with its proof"),
    "differentiate": (differentiate, "derivatives of a recorded signal: CSV in, CSV and picture out"),
    "reproduce": (reproduce, "five papers, claim by claim"),
    "bench": (bench, "what can be proved, and how fast this machine runs it"),
}
DESCRIPTION = """State observers for nonlinear systems: design, proof, tuning and study. `jaxobs COMMAND --help` says more.

Exit codes: 0 done, and proved where something was to be proved; 1 not proved, or failed under way; 2 an option, a config or a
file that does not fit; 130 stopped by Ctrl-C."""
CONFIG = (tyro.conf.FlagCreatePairsOff,)


def main() -> None:
    """The entry point `jaxobs`."""
    try:
        code = _run(sys.argv[1:])
    except KeyboardInterrupt:
        Console(stderr=True).print("stopped")
        code = 130
    except BrokenPipeError:  # `jaxobs ... | head`
        sys.stderr.close()
        code = 141
    sys.exit(code)


def _run(arguments: list[str]) -> Any:
    if arguments and arguments[0] in COMMANDS:
        name, *rest = arguments
        return tyro.cli(COMMANDS[name][0], prog=f"jaxobs {name}", args=rest, config=CONFIG)
    if arguments == ["--version"]:
        from jaxobs import __version__

        print(__version__)
        return 0
    every = [
        Annotated[Any, tyro.conf.subcommand(name=name, constructor=command, description=words)]
        for name, (command, words) in COMMANDS.items()
    ]
    union: Any = Union[tuple(every)]  # noqa: UP007
    return tyro.cli(union, prog="jaxobs", description=DESCRIPTION, args=arguments, config=CONFIG)
