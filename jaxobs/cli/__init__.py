"""The command line: `jaxobs demo`, `reproduce`, `certify`, `verify`, `bench`, `study`, `tune`."""

import sys

import tyro
from rich.console import Console

from jaxobs.cli.bench import bench
from jaxobs.cli.certify import certify
from jaxobs.cli.demo import demo
from jaxobs.cli.reproduce import reproduce
from jaxobs.cli.study import study
from jaxobs.cli.tune import tune
from jaxobs.cli.verify import verify

COMMANDS = {
    "demo": demo, "reproduce": reproduce, "certify": certify, "verify": verify, "bench": bench, "study": study, "tune": tune,
}  # fmt: skip


def main() -> None:
    """The entry point `jaxobs`."""
    try:
        code = tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="jaxobs")
    except KeyboardInterrupt:
        Console(stderr=True).print("stopped")
        code = 130
    sys.exit(code)
