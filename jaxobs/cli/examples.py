"""The files that the package brings to start from, and the reading of a config."""

import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from jaxobs.cli.own import beside

Command = Literal["audit", "certify", "export", "study", "tune"]
PLANT = "plant"  # the one example that is Python


def examples(command: Command) -> dict[str, str]:
    """The configs that the package brings for this command: name and text."""
    return {name: text for name, text in everything().items() if command_of(name) == command}


def everything() -> dict[str, str]:
    """All files of the package to start from: name and text, the plant first."""
    folder = resources.files("jaxobs") / "configs"
    plant = (folder / "my_plant.py").read_text(encoding="utf-8")
    files = sorted((one for one in folder.iterdir() if one.name.endswith(".toml")), key=lambda one: one.name)
    return {PLANT: plant} | {one.name.removesuffix(".toml"): one.read_text(encoding="utf-8") for one in files}


def command_of(name: str) -> str:
    """The command that runs the example."""
    first = name.split("_")[0]
    return first if first in ("audit", "export", "study", "tune") else "design" if name == PLANT else "certify"


def parse(config: Path, *commands: Command) -> dict[str, Any]:
    """The tables of the file, or of the example of that name for these commands. ValueError if it is no TOML, or none."""
    known = {name: text for command in commands for name, text in examples(command).items()}
    try:
        text = known[str(config)] if str(config) in known and not config.exists() else config.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ValueError(f"no such file; expected a TOML file or one of the examples {', '.join(known)}") from error
    return beside(tomllib.loads(text), config)
